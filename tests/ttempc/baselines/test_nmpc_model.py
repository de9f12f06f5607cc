"""Compiled articulated model along a horizon against the plain one, and its derivatives."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.models.test_kinematics import OTHER, VEHICLE, random_cases
from tests.ttempc.numeric import central_differences
from ttempc.baselines.nmpc_model import (
    TRACTOR,
    TRAILER,
    WHOLE,
    Column,
    Row,
    Task,
    advance_period,
    articulated_horizon,
    articulated_model,
    condense,
    kept_motion,
    new_motion,
    stage_times,
)
from ttempc.errors import MissingPackage
from ttempc.guidance.controllers import make_controller
from ttempc.mpc.qp import QP
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import State

PERIOD_S = 0.2
HORIZON, MOVES = 20, 6
ORDER = [State[row.name] for row in Row]


@pytest.mark.parametrize("vehicle", [VEHICLE, OTHER])
@pytest.mark.parametrize("steering_step", [0.02, 2.0])  # within and far beyond the rate limits
def test_a_period_is_that_of_the_plain_model(vehicle, steering_step):
    model = articulated_model(vehicle, PERIOD_S)._replace(substeps=2)
    motion = new_motion(model, 1)[0]
    scratch = np.empty((3, len(Row), len(Column))), np.empty((3, len(Column)))
    for state, inputs, disturbance in random_cases(steering_step=steering_step):
        expected, end = state, state[ORDER]
        for _ in range(2):
            expected = advance(expected, inputs, vehicle, PERIOD_S / 2, disturbance)
        advance_period(end, inputs, disturbance, model, motion, *scratch, np.empty((7, 8)))
        np.testing.assert_allclose(end, expected[ORDER], rtol=1e-12, atol=1e-12)


def gentle(generator):
    """Return a state, inputs (Np, 3), a disturbance and poses (Np, 6) to predict with."""
    state = generator.normal(size=7) * [3, 3, 1, 0.1, 0.1, 0.1, 0.1]
    state[State.PSI_I] += state[State.PSI_T]
    state[State.V] += 1.0
    inputs = np.cumsum(generator.uniform(-0.1, 0.1, size=(HORIZON, 3)), axis=0)
    inputs[:, 2] += 0.7
    disturbance = generator.normal(size=5) * [0.05, 0.05, 0.02, 0.05, 0.0]
    return state, inputs, disturbance, generator.normal(size=(HORIZON, 6))


def task(generator, model):
    """Return a task, and the steps under which it has the inputs of `gentle`."""
    state, inputs, disturbance, poses = gentle(generator)
    inputs[MOVES:] = inputs[MOVES - 1]
    previous = generator.uniform(-0.05, 0.05, size=3)
    inputs_e = 0.3 - inputs  # u_e under a feedforward of 0.3
    steps = np.diff(inputs_e[:MOVES], axis=0, prepend=previous[None])
    posed = Task(
        k=0,
        state=state,
        disturbance=np.tile(disturbance, (HORIZON, 1)),
        poses=poses,
        feedforward=np.full_like(inputs, 0.3),
        previous=previous,
        last_plan=np.zeros((MOVES, 3)),
        motion=new_motion(model, HORIZON),
    )
    return posed, steps[:, model.block.inputs].ravel()


def evaluated(model, problem, steps):
    """Return the outputs (Np, p) and their derivatives by the steps, (Np, p, m Nc)."""
    count = len(model.block.outputs)
    errors, jacobian = np.empty((HORIZON, count)), np.empty((HORIZON, count, len(steps)))
    articulated_horizon(model, problem, steps, errors, jacobian)
    return errors, jacobian


@pytest.mark.parametrize("block", [WHOLE, TRACTOR, TRAILER])
def test_derivatives_along_the_horizon(block):
    model = articulated_model(VEHICLE, PERIOD_S, block)
    problem, steps = task(np.random.default_rng(8), model)
    steps *= 0.2  # no rate limit, whose kinks have no derivative
    problem.motion[:] = np.random.default_rng(9).normal(1.0, 0.1, problem.motion.shape)
    _, jacobian = evaluated(model, problem, steps)
    numeric = central_differences(lambda s: evaluated(model, problem, s)[0].reshape(-1), steps)
    np.testing.assert_allclose(jacobian.reshape(numeric.shape), numeric, atol=1e-7)


def test_the_bodies_of_a_plan_move_as_in_the_whole_model():
    """The tractor alone, then the trailer behind the motion that it has written."""
    whole, tractor, trailer = (
        articulated_model(VEHICLE, PERIOD_S, block) for block in (WHOLE, TRACTOR, TRAILER)
    )
    problem, steps = task(np.random.default_rng(8), whole)
    expected, _ = evaluated(whole, problem, steps)
    by_input = steps.reshape(MOVES, 3)
    problem.motion[:] = np.nan
    of_tractor, _ = evaluated(tractor, problem, by_input[:, tractor.block.inputs].ravel())
    of_trailer, _ = evaluated(trailer, problem, by_input[:, trailer.block.inputs].ravel())
    np.testing.assert_allclose(of_tractor, expected[:, :2], atol=1e-12)
    np.testing.assert_allclose(of_trailer, expected[:, 2:], atol=1e-3)
    finer = trailer._replace(substeps=whole.substeps)
    of_trailer, _ = evaluated(finer, problem, by_input[:, trailer.block.inputs].ravel())
    np.testing.assert_allclose(of_trailer, expected[:, 2:], atol=1e-12)


def test_a_tractor_that_keeps_its_distance_moves_as_its_reference_turned_and_shifted():
    reference = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
    model = articulated_model(VEHICLE, PERIOD_S)
    times = 30.0 + PERIOD_S * np.arange(3)[:, None] + stage_times(model)
    sample = reference.at(times.ravel())
    rows = np.column_stack([sample.state[:, [State.PSI_T, State.V]], sample.yaw_rate_t])
    given = rows.reshape(3, -1, 3)
    ends = reference.at(30.0 + PERIOD_S * np.arange(1, 4)).state[:, :3]
    given[:, -1] = ends
    now = reference.at(30.0).state
    motion = new_motion(model, 3)
    kept_motion(given, now[:3], now, motion)
    np.testing.assert_allclose(motion, given, atol=1e-12)  # on the reference: the reference
    beside = now.copy()
    beside[:2] += 0.2 * np.array([-np.sin(now[2]), np.cos(now[2])])  # 0.2 m to its left
    kept_motion(given, now[:3], beside, motion)
    left = np.column_stack([-np.sin(ends[:, 2]), np.cos(ends[:, 2])])
    np.testing.assert_allclose(motion[:, -1, :2], ends[:, :2] + 0.2 * left, atol=1e-12)


def test_the_condensed_qp_has_the_cost_of_the_linearised_outputs():
    generator = np.random.default_rng(10)
    errors, jacobian = generator.normal(size=(5, 2)), generator.normal(size=(5, 2, 6))
    weight, step_weight = generator.uniform(size=2), generator.uniform(size=6)
    hessian, gradient = np.empty((6, 6)), np.empty(6)
    at, other = generator.normal(size=6), generator.normal(size=6)
    weights = np.tile(weight, (len(errors), 1))
    cost = condense(errors, jacobian, weights, step_weight, 0.0, at, hessian, gradient)

    def linearised(steps):
        outputs = errors + jacobian @ (steps - at)
        return np.sum(weight * outputs**2) + np.sum(step_weight * steps**2)

    nothing = np.empty(0)
    free = np.full(6, np.inf)
    qp = QP(hessian, gradient, np.empty((0, 6)), nothing, nothing, -free, free)
    assert cost == pytest.approx(linearised(at), rel=1e-12)
    descent = qp.objective(at) - qp.objective(other)
    assert descent == pytest.approx(linearised(at) - linearised(other), rel=1e-10)
    np.testing.assert_array_equal(hessian, hessian.T)


@pytest.mark.parametrize("name", ["nmpc", "nmpc-distributed", "nmpc-path"])
def test_refused_in_one_line_where_daqp_is_not_installed(name, monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    reference = Reference(straight(30.0), VEHICLE, ConstantSpeed(1.0))
    with pytest.raises(MissingPackage, match=r"pip install -e './ttempc\[baselines\]'"):
        make_controller(name, VEHICLE, reference, PERIOD_S)
    make_controller(name, VEHICLE, reference, PERIOD_S, options={"solver": "piqp"})
