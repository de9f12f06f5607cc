"""The tube MPC on its own model, under disturbances within its set and beyond."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE, WINDOW, admissible, along
from ttempc.errors import InvalidTube
from ttempc.guidance.controllers import make_controller
from ttempc.laws.articulated_mpc import MpcOptions
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.mpc.articulated_error import error_dynamics, rotation
from ttempc.mpc.lmpc import CondensedHorizon
from ttempc.types import Disturbance, Estimate, MapDisturbance, State
from ttempc.vehicle import CommandLimits

TICKS = 300
ALONG = along()
OPTIONS = MpcOptions()
LIMITS = CommandLimits.of(VEHICLE, PERIOD_S)
GRID = REFERENCE.on_grid(PERIOD_S)


def estimate_of(k, error, persistent):
    """The estimate whose error z_e (7,) is `error`."""
    error = error.copy()
    error[:2] = rotation(GRID.state[k, State.PSI_T]) @ error[:2]
    state = GRID.state[k] - error
    point = trailer_point(state, VEHICLE)
    zeros = np.zeros((7, 7))
    return Estimate(k * PERIOD_S, state, zeros, point, hitch_angle(state), persistent)


def drive(disturbances, persistent=None):
    """Drive the linear model under the tube MPC; return errors and diagnostics."""
    persistent = np.zeros(len(Disturbance)) if persistent is None else persistent
    controller = make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    error, errors, steps = np.zeros(7), [], []
    for k, w in enumerate(disturbances):
        errors.append(error)
        steps.append(controller.step(estimate_of(k, error, persistent), k))
        u_e = ALONG.feedforward[k] - steps[-1].command.as_array()
        state = np.concatenate([error, persistent, np.zeros(len(MapDisturbance))])
        error = ALONG.a[k, :7] @ state + ALONG.b[k, :7] @ u_e + w
    return np.array(errors), [step.diagnostics for step in steps]


def test_inside_its_set_it_stays_inside_the_tube_and_the_limits():
    generator = np.random.default_rng(11)
    worst = ALONG.tube.worst_case(150, ALONG.tube.system.c[150, 3])
    late = np.zeros((TICKS, 7))
    late[150 - len(worst) : 150] = worst
    for run in (*(admissible(WINDOW, TICKS, generator) for _ in range(3)), late):
        errors, diagnostics = drive(run)
        assert not any(tick.fallback for tick in diagnostics)
        assert not any(tick.limited.any() for tick in diagnostics)
        for k, tick in enumerate(diagnostics):
            deviation = errors[k] - tick.tube.nominal[:7]
            assert tick.tube.inside
            assert np.all(np.abs(deviation) <= ALONG.tube.states[k] * (1.0 + 1e-9))
    assert (
        min(tick.tube.margin for tick in diagnostics) < 0.05
    )  # the worst case nearly reaches the edge


def test_an_estimated_disturbance_moves_the_nominal_state_alone():
    persistent = np.zeros(len(Disturbance))
    persistent[[Disturbance.SLIP_T, Disturbance.SLIP_I, Disturbance.DRIVE]] = 0.03, 0.02, -0.03
    errors, diagnostics = drive(np.zeros((TICKS, 7)), persistent)
    assert min(tick.tube.margin for tick in diagnostics) > 1.0 - 1e-6
    assert np.abs(errors[100:, :2]).max() < 0.03
    assert max(np.abs(tick.robust).max() for tick in diagnostics) < 1e-9


def test_a_push_out_of_the_tube_restarts_the_nominal_state_and_is_reported():
    push = np.zeros((TICKS, 7))
    push[100, State.Y] = 1.0
    errors, diagnostics = drive(push)
    assert [k for k, tick in enumerate(diagnostics) if tick.fallback] == [101]
    assert "restarted" in diagnostics[101].fallback
    assert diagnostics[101].tube.margin < -1.0
    assert not diagnostics[101].robust.any()
    assert diagnostics[102].tube.margin > 0.99
    assert np.abs(errors[200:, :2]).max() < 0.05


def test_a_missed_tick_starts_anew_at_the_estimate():
    controller = make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    persistent = np.zeros(len(Disturbance))
    controller.step(estimate_of(0, np.zeros(7), persistent), 0)
    restarted = controller.step(estimate_of(2, np.full(7, 0.2), persistent), 2).diagnostics
    assert restarted.tube.margin == 1.0


def test_the_nominal_loop_contracts_over_a_lap():
    """No terminal cost is needed: away from the bounds, the gain of the horizon is stable."""
    ticks = 690
    a, b, c = error_dynamics(REFERENCE, PERIOD_S, ticks + OPTIONS.horizon)
    horizon = CondensedHorizon(a, b, OPTIONS, PERIOD_S, c)
    n, total = a.shape[1], np.eye(10)
    for k in range(ticks):
        # The first step is linear in (z, u_{k-1}); the next stage starts from (z, u_k).
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
