"""Tube MPC and `ttempc` in a growing tube, on their own model."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE, WINDOW, admissible, along
from ttempc.guidance.controllers import make_controller
from ttempc.laws import articulated_law
from ttempc.laws.options import ArticulatedOptions
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.mpc.articulated_error import HITCH, rotation
from ttempc.mpc.condensing import solve_in_closed_form
from ttempc.mpc.qp import BOUND_ACTIVE, CheckedSolver, QPSolution
from ttempc.tube.reference_tube import steered_system
from ttempc.types import Disturbance, Estimate, MapDisturbance, SolverReport, State
from ttempc.vehicle import CommandLimits

TICKS = 300
ALONG = along()
GRID = REFERENCE.on_grid(PERIOD_S)
NONE = np.zeros(len(Disturbance))


def estimate_of(k, error, persistent):
    """The estimate whose error z_e (7,) is `error`."""
    error = error.copy()
    error[:2] = rotation(GRID.state[k, State.PSI_T]) @ error[:2]
    state = GRID.state[k] - error
    point = trailer_point(state, VEHICLE)
    zeros = np.zeros((7, 7))
    return Estimate(k * PERIOD_S, state, zeros, point, hitch_angle(state), persistent)


def drive(disturbances, persistent=NONE, follower=None, start=None):
    """Drive the linear model, by default under the tube MPC."""
    follower = follower or make_controller("ttempc-tube", VEHICLE, REFERENCE, PERIOD_S, DESIGN)
    error = np.zeros(7) if start is None else start
    errors = []
    steps = []
    for k, w in enumerate(disturbances):
        errors.append(error)
        steps.append(follower.step(estimate_of(k, error, persistent), k))
        u_e = ALONG.feedforward[k] - steps[-1].command.as_array()
        state = np.concatenate([error, persistent, np.zeros(len(MapDisturbance))])
        error = ALONG.a[k, :7] @ state + ALONG.b[k, :7] @ u_e + w
    commands = np.array([step.command.as_array() for step in steps])
    return np.array(errors), commands, [step.diagnostics for step in steps]


def test_inside_its_set_it_stays_inside_the_tube_and_the_limits():
    generator = np.random.default_rng(11)
    worst = ALONG.tube.worst_case(150, ALONG.tube.system.c[150, 3])
    late = np.zeros((TICKS, 7))
    late[150 - len(worst) : 150] = worst
    for run in (*(admissible(WINDOW, TICKS, generator) for _ in range(3)), late):
        errors, _, diagnostics = drive(run)
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
    errors, _, diagnostics = drive(np.zeros((TICKS, 7)), persistent)
    assert min(tick.tube.margin for tick in diagnostics) > 1.0 - 1e-6
    assert np.abs(errors[100:, :2]).max() < 0.03
    assert max(np.abs(tick.robust).max() for tick in diagnostics) < 1e-9


def test_a_push_out_of_the_tube_restarts_the_nominal_state_and_is_reported():
    push = np.zeros((TICKS, 7))
    push[100, State.Y] = 1.0
    errors, _, diagnostics = drive(push)
    assert [k for k, tick in enumerate(diagnostics) if tick.fallback] == [101]
    assert "restarted" in diagnostics[101].fallback
    assert diagnostics[101].tube.margin < -1.0
    assert not diagnostics[101].robust.any()
    assert diagnostics[102].tube.margin > 0.99
    assert np.abs(errors[200:, :2]).max() < 0.05


TICKS_KEPT_PLAN = 120
FAILED = QPSolution(None, SolverReport("max_iter_reached", False, 0, 0.0, 0.0, 0.0))
STEERED, REACH = steered_system(
    DESIGN,
    ALONG.a,
    ALONG.b,
    ALONG.c,
    CommandLimits.of(VEHICLE, PERIOD_S),
    ArticulatedOptions().horizon,
)
CLOSED = STEERED.closed
SPREAD = REACH.hitch


def test_no_admissible_disturbance_moves_the_hitch_angle_beyond_its_spread():
    """Random runs, bang-bang and square waves, and the worst case, which nearly reaches it."""
    generator = np.random.default_rng(93)
    k = 150
    stages = len(SPREAD)
    runs = np.array([admissible(WINDOW, stages, generator) for _ in range(3000)])
    for j in range(1, stages):
        row = HITCH
        to_hitch = np.empty((j, 7))
        for i in range(j - 1, -1, -1):  # the effect of w(k - j + i) on the angle at tick k
            to_hitch[i] = row
            row = row @ CLOSED[k - j + i]
        reached = np.abs(np.einsum("ij,rij->r", to_hitch, runs[:, :j])).max()
        worst = np.sum(to_hitch * WINDOW.worst(to_hitch))
        assert max(reached, worst) <= SPREAD[j, k] * (1.0 + 1e-9)
        if j <= WINDOW.window:
            assert worst > 0.99 * SPREAD[j, k]


def controller():
    return make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S, DESIGN)


def leave_every_problem_to_the_solver(monkeypatch):
    """As if a bound were active at every tick."""

    def drive(k, row, sent, law, stages, work, memory, tick):
        articulated_law.compute_error(k, row, sent, law, stages, work, memory, tick)
        solve_in_closed_form(k, stages, work)
        return BOUND_ACTIVE

    monkeypatch.setattr(articulated_law, "try_in_closed_form", drive)


def test_its_commands_are_never_cut_by_the_limits_however_it_is_disturbed():
    generator = np.random.default_rng(91)
    for scale in (1.0, 30.0):
        run = scale * admissible(WINDOW, TICKS_KEPT_PLAN, generator)
        _, commands, diagnostics = drive(run, follower=controller())
        totals = [d.feedforward + d.feedback + d.robust for d in diagnostics]
        np.testing.assert_allclose(totals, commands, atol=1e-9)
        assert not any(d.fallback for d in diagnostics)
    assert any(d.limited.any() for d in diagnostics)  # pressed against its bounds


@pytest.mark.parametrize("tube", [True, False])
@pytest.mark.parametrize("robust", [True, False])
def test_robust_law_and_tube_are_switched_on_and_off_apart(robust, tube):
    """The tanh action is in `robust` alone; the tightened bounds and the backup plan in `tube`."""
    options = {"robust": robust, "tube": tube}
    made = make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S, DESIGN, options)
    plain = make_controller("ttempc-nominal", VEHICLE, REFERENCE, PERIOD_S)
    last = -2  # trailer steering of the last free stage
    ranges = []
    for each in (made, plain):
        bounds = each.feedback.mpc.horizon.stages.bounds
        ranges.append(bounds.upper[150, last] - bounds.lower[150, last])
    assert (ranges[1] - ranges[0] > np.radians(1.0)) == tube
    assert (len(made.feedback.law.reserve) > 0) == tube

    residuals = np.zeros((60, 7))
    residuals[:, State.Y] = 0.01  # autocorrelated
    _, _, diagnostics = drive(residuals, follower=made)
    acting = max(np.abs(tick.robust).max() for tick in diagnostics)
    assert (acting > 1e-3) == robust
    assert all(tick.tube is not None for tick in diagnostics)  # the monitor needs the design alone


@pytest.mark.parametrize("stages", [3, 15])
def test_without_a_solver_the_plan_and_its_ancillary_gain_keep_to_the_tube(monkeypatch, stages):
    """What the later disturbances add obeys A + B K, and no limit cuts the inputs."""
    generator = np.random.default_rng(92)
    fails = 60  # tick from which the solver fails
    run = admissible(WINDOW, TICKS_KEPT_PLAN, generator)
    solve = CheckedSolver.solve_bounded
    leave_every_problem_to_the_solver(monkeypatch)

    def drive_failing(disturbances):
        calls = iter(range(TICKS_KEPT_PLAN))
        monkeypatch.setattr(
            CheckedSolver,
            "solve_bounded",
            lambda solver, qp: solve(solver, qp) if next(calls) < fails else FAILED,
        )
        start = np.array([0.3, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
        return drive(disturbances, NONE, controller(), start)

    ticks = fails + stages
    until = np.where(np.arange(ticks)[:, None] < fails, run[:ticks], 0.0)
    plain, _, _ = drive_failing(until)
    errors, commands, diagnostics = drive_failing(run[:ticks])
    deviation = np.zeros(7)
    for k in range(fails, ticks):
        assert "last plan kept" in diagnostics[k].fallback
        np.testing.assert_allclose(errors[k] - plain[k], deviation, atol=1e-9)
        deviation = CLOSED[k] @ deviation + run[k]
    totals = [d.feedforward + d.feedback + d.robust for d in diagnostics]
    np.testing.assert_allclose(totals, commands, atol=1e-9)


def test_without_a_plan_or_beyond_its_horizon_the_previous_feedback_is_held(monkeypatch):
    leave_every_problem_to_the_solver(monkeypatch)
    monkeypatch.setattr(CheckedSolver, "solve_bounded", lambda solver, qp: FAILED)
    _, _, diagnostics = drive(np.zeros((3, 7)), follower=controller())
    assert all("previous feedback held" in d.fallback for d in diagnostics)
