"""Compiled articulated model along a horizon against the plain one, and its derivatives."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.models.test_kinematics import OTHER, VEHICLE, random_cases
from tests.ttempc.numeric import central_differences
from ttempc.baselines.nmpc_model import (
    ArticulatedModel,
    Task,
    advance_period,
    condense,
)
from ttempc.errors import MissingPackage
from ttempc.guidance.controllers import make_controller
from ttempc.models.augmented_state import vehicle_parameters
from ttempc.mpc.condensing import StageBounds
from ttempc.mpc.qp import QP
from ttempc.reference.path import straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import State

PERIOD_S = 0.2
HORIZON, MOVES = 20, 6
NO_BOUNDS = StageBounds(*[np.empty(0)] * 4)


@pytest.mark.parametrize("vehicle", [VEHICLE, OTHER])
@pytest.mark.parametrize("steering_step", [0.02, 2.0])  # within and far beyond the rate limits
def test_a_period_is_that_of_the_plain_model(vehicle, steering_step):
    for state, inputs, disturbance in random_cases(steering_step=steering_step):
        expected, end = state, state.copy()
        for _ in range(2):
            expected = advance(expected, inputs, vehicle, PERIOD_S / 2, disturbance)
        arguments = inputs, disturbance, vehicle_parameters(vehicle), PERIOD_S, 2
        advance_period(end, *arguments, np.empty((7, 8)))
        np.testing.assert_allclose(end, expected, rtol=1e-12, atol=1e-12)


def gentle(generator):
    """Return a state, inputs (Np, 3), a disturbance and poses (Np, 6) to predict with."""
    state = generator.normal(size=7) * [3, 3, 1, 0.1, 0.1, 0.1, 0.1]
    state[State.PSI_I] += state[State.PSI_T]
    state[State.V] += 1.0
    inputs = np.cumsum(generator.uniform(-0.1, 0.1, size=(HORIZON, 3)), axis=0)
    inputs[:, 2] += 0.7
    disturbance = generator.normal(size=5) * [0.05, 0.05, 0.02, 0.05, 0.0]
    return state, inputs, disturbance, generator.normal(size=(HORIZON, 6))


def task(generator):
    """Return a task without bounds, and the steps under which it has the inputs of `gentle`."""
    state, inputs, disturbance, poses = gentle(generator)
    inputs[MOVES:] = inputs[MOVES - 1]
    previous = generator.uniform(-0.05, 0.05, size=3)
    inputs_e = 0.3 - inputs  # u_e under a feedforward of 0.3
    steps = np.diff(inputs_e[:MOVES], axis=0, prepend=previous[None]).reshape(-1)
    disturbance = np.tile(disturbance, (HORIZON, 1))
    return Task(state, disturbance, poses, np.full_like(inputs, 0.3), previous, NO_BOUNDS), steps


def evaluated(problem, steps):
    """Return the outputs (Np, 4) and their derivatives by the steps, (Np, 4, 3 Nc)."""
    errors, jacobian = np.empty((HORIZON, 4)), np.empty((HORIZON, 4, len(steps)))
    ArticulatedModel(VEHICLE, PERIOD_S).evaluate(problem, steps, errors, jacobian)
    return errors, jacobian


def test_derivatives_along_the_horizon():
    problem, steps = task(np.random.default_rng(8))
    steps *= 0.2  # no rate limit, whose kinks have no derivative
    _, jacobian = evaluated(problem, steps)
    numeric = central_differences(lambda s: evaluated(problem, s)[0].reshape(-1), steps)
    np.testing.assert_allclose(jacobian.reshape(numeric.shape), numeric, atol=1e-7)


def test_the_condensed_qp_has_the_cost_of_the_linearised_outputs():
    generator = np.random.default_rng(10)
    errors, jacobian = generator.normal(size=(5, 2)), generator.normal(size=(5, 2, 6))
    weight, step_weight = generator.uniform(size=2), generator.uniform(size=6)
    hessian, gradient = np.empty((6, 6)), np.empty(6)
    at, other = generator.normal(size=6), generator.normal(size=6)
    cost = condense(errors, jacobian, weight, step_weight, at, hessian, gradient)

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


@pytest.mark.parametrize("name", ["nmpc", "nmpc-rti"])
def test_refused_in_one_line_where_daqp_is_not_installed(name, monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    reference = Reference(straight(30.0), VEHICLE, ConstantSpeed(1.0))
    with pytest.raises(MissingPackage, match=r"pip install 'ttempc\[baselines\]'"):
        make_controller(name, VEHICLE, reference, PERIOD_S)
    make_controller(name, VEHICLE, reference, PERIOD_S, options={"solver": "piqp"})
