"""The tube MPC on its own model, under disturbances within its set and beyond."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE, WINDOW, admissible, along
from ttempc.errors import InvalidTube
from ttempc.guidance.controllers import make_controller
from ttempc.laws.articulated_options import MpcOptions
from ttempc.limits import CommandLimits
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.mpc.prediction import rotation
from ttempc.mpc.qp import CondensedHorizon
from ttempc.types import Disturbance, Estimate, MapDisturbance, State

TICKS = 300
ALONG = along()
OPTIONS = MpcOptions()
LIMITS = CommandLimits.of(VEHICLE, PERIOD_S)
GRID = REFERENCE.on_grid(PERIOD_S)


def estimate_of(k, error, lasting):
    """The estimate whose error z_e (7,) is `error`."""
    error = error.copy()
    error[:2] = rotation(GRID.state[k, State.PSI_T]) @ error[:2]
    state = GRID.state[k] - error
    point = trailer_point(state, VEHICLE)
    zeros = np.zeros((7, 7))
    return Estimate(k * PERIOD_S, state, zeros, point, hitch_angle(state), lasting)


def drive(disturbances, lasting=None):
    """Drive the linear model under the tube MPC; return errors and what the controller said."""
    lasting = np.zeros(len(Disturbance)) if lasting is None else lasting
    controller = make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    error, errors, said = np.zeros(7), [], []
    for k, w in enumerate(disturbances):
        errors.append(error)
        said.append(controller.step(estimate_of(k, error, lasting), k))
        u_e = ALONG.feedforward[k] - said[-1].command.as_array()
        state = np.concatenate([error, lasting, np.zeros(len(MapDisturbance))])
        error = ALONG.a[k, :7] @ state + ALONG.b[k, :7] @ u_e + w
    return np.array(errors), [one.diagnostics for one in said]


def test_inside_its_set_it_stays_inside_the_tube_and_the_limits():
    generator = np.random.default_rng(11)
    worst = ALONG.tube.worst_case(150, ALONG.tube.system.c[150, 3])
    late = np.zeros((TICKS, 7))
    late[150 - len(worst) : 150] = worst
    for run in (*(admissible(WINDOW, TICKS, generator) for _ in range(3)), late):
        errors, said = drive(run)
        assert not any(one.fallback for one in said)
        assert not any(one.limited.any() for one in said)
        for k, one in enumerate(said):
            deviation = errors[k] - one.tube.nominal[:7]
            assert one.tube.inside
            assert np.all(np.abs(deviation) <= ALONG.tube.states[k] * (1.0 + 1e-9))
    assert min(one.tube.margin for one in said) < 0.05  # the worst case nearly reaches the edge


def test_a_lasting_disturbance_that_is_known_moves_the_nominal_state_alone():
    lasting = np.zeros(len(Disturbance))
    lasting[[Disturbance.SLIP_T, Disturbance.SLIP_I, Disturbance.DRIVE]] = 0.03, 0.02, -0.03
    errors, said = drive(np.zeros((TICKS, 7)), lasting)
    assert min(one.tube.margin for one in said) > 1.0 - 1e-6
    assert np.abs(errors[100:, :2]).max() < 0.03
    assert max(np.abs(one.robust).max() for one in said) < 1e-9


def test_a_push_out_of_the_tube_restarts_the_nominal_state_and_is_said():
    push = np.zeros((TICKS, 7))
    push[100, State.Y] = 1.0
    errors, said = drive(push)
    assert [k for k, one in enumerate(said) if one.fallback] == [101]
    assert "restarted" in said[101].fallback
    assert said[101].tube.margin < -1.0
    assert not said[101].robust.any()
    assert said[102].tube.margin > 0.99
    assert np.abs(errors[200:, :2]).max() < 0.05


def test_a_missed_tick_starts_anew_at_the_estimate():
    controller = make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    lasting = np.zeros(len(Disturbance))
    controller.step(estimate_of(0, np.zeros(7), lasting), 0)
    said = controller.step(estimate_of(2, np.full(7, 0.2), lasting), 2).diagnostics
    assert said.tube.margin == 1.0


def test_the_nominal_loop_contracts_over_a_lap():
    """Why no terminal cost: away from the bounds, the horizon's own gain is stable by itself."""
    ticks = 690
    a, b, c = error_dynamics(REFERENCE, PERIOD_S, ticks + OPTIONS.horizon)
    horizon = CondensedHorizon(a, b, OPTIONS, PERIOD_S, c)
    n, total = a.shape[1], np.eye(10)
    for k in range(ticks):
        # The first step is linear in (z, u_{k-1}); what is carried on is (z, u_k).
        unit = np.eye(n + 3)
        slope = np.array([horizon.qp(k, row[:n], row[n:]).gradient for row in unit]).T
        first = -np.linalg.solve(horizon.qp(k, unit[0, :n], unit[0, n:]).hessian, slope)[:3]
        keep = [*range(7), *range(n, n + 3)]
        by_input = first[:, keep] + np.eye(10)[7:]
        forward = np.vstack([a[k, :7, :7] @ np.eye(10)[:7] + b[k, :7] @ by_input, by_input])
        total = forward @ total
        if k == 100:
            assert np.linalg.norm(total, 2) < 0.1
    assert np.linalg.norm(total, 2) < 1e-6


def test_without_a_design_it_is_refused():
    with pytest.raises(InvalidTube, match="'ttempc-tube': needs the design"):
        make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S)
