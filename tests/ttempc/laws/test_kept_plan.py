"""`ttempc` tightened by a tube: limits, and the plan that it keeps without a solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.laws.test_tube_mpc import ALONG, estimate_of
from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE, WINDOW, admissible
from ttempc.errors import InvalidTuning
from ttempc.guidance.controllers import make_controller
from ttempc.laws.articulated_mpc import ArticulatedOptions
from ttempc.mpc.qp import PersistentSolver, QPSolution
from ttempc.tube.reference_tube import steered_system
from ttempc.types import Disturbance, MapDisturbance, SolverReport
from ttempc.vehicle import CommandLimits

TICKS = 120
FAILED = QPSolution(None, SolverReport("max_iter_reached", False, 0, 0.0, 0.0, 0.0))
NONE = np.zeros(len(Disturbance))
CLOSED = steered_system(
    DESIGN,
    ALONG.a,
    ALONG.b,
    ALONG.c,
    CommandLimits.of(VEHICLE, PERIOD_S),
    ArticulatedOptions().horizon,
)[0].closed


def controller(**options):
    return make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S, DESIGN, options)


def drive(disturbances, follower, start=None):
    """Drive the linear model; return errors, commands and diagnostics."""
    error, errors, steps = np.zeros(7) if start is None else start, [], []
    for k, w in enumerate(disturbances):
        errors.append(error)
        steps.append(follower.step(estimate_of(k, error, NONE), k))
        u_e = ALONG.feedforward[k] - steps[-1].command.as_array()
        state = np.concatenate([error, NONE, np.zeros(len(MapDisturbance))])
        error = ALONG.a[k, :7] @ state + ALONG.b[k, :7] @ u_e + w
    diagnostics = [step.diagnostics for step in steps]
    return np.array(errors), np.array([s.command.as_array() for s in steps]), diagnostics


def test_its_commands_are_never_cut_by_the_limits_however_it_is_disturbed():
    generator = np.random.default_rng(91)
    for scale in (1.0, 30.0):
        run = scale * admissible(WINDOW, TICKS, generator)
        _, commands, diagnostics = drive(run, controller())
        totals = [d.feedforward + d.feedback + d.robust for d in diagnostics]
        np.testing.assert_allclose(totals, commands, atol=1e-9)
        assert not any(d.fallback for d in diagnostics)
    assert any(d.limited.any() for d in diagnostics)  # pressed against its bounds


@pytest.mark.parametrize("stages", [3, 15])
def test_without_a_solver_the_plan_and_its_ancillary_gain_keep_to_the_tube(monkeypatch, stages):
    """What the later disturbances add obeys A + B K, and no limit cuts the inputs."""
    generator, fails = np.random.default_rng(92), 60
    run = admissible(WINDOW, TICKS, generator)
    solve = PersistentSolver.solve

    def drive_failing(disturbances):
        calls = iter(range(TICKS))
        monkeypatch.setattr(
            PersistentSolver,
            "solve",
            lambda solver, qp: solve(solver, qp) if next(calls) < fails else FAILED,
        )
        start = np.array([0.3, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
        return drive(disturbances, controller(), start)

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
    monkeypatch.setattr(PersistentSolver, "solve", lambda solver, qp: FAILED)
    _, _, diagnostics = drive(np.zeros((3, 7)), controller())
    assert all("previous feedback held" in d.fallback for d in diagnostics)


def test_without_a_tube_nothing_is_tightened():
    run = admissible(WINDOW, 40, np.random.default_rng(93))
    options = {"tightening": "none"}
    plain = make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S, options=options)
    tight = make_controller("ttempc", VEHICLE, REFERENCE, PERIOD_S)
    np.testing.assert_array_equal(drive(run, plain)[1], drive(run, tight)[1])


def test_a_fresh_law_has_no_plan():
    run = 3.0 * admissible(WINDOW, 40, np.random.default_rng(94))
    used = controller()
    first = drive(run, used)[1]
    np.testing.assert_array_equal(drive(run, used.fresh())[1], first)


def test_it_goes_on_for_learnt_lengths():
    """The first input after the exchange is feasible, a step from the last command."""
    learnt = replace(VEHICLE, trailer_length=1.1 * VEHICLE.trailer_length)
    run, before = admissible(WINDOW, 41, np.random.default_rng(95)), controller()
    errors, commands, _ = drive(run, before)
    reference, design = replace(REFERENCE, vehicle=learnt), replace(DESIGN, vehicle=learnt)
    after = make_controller("ttempc", learnt, reference, PERIOD_S, design)
    after.resume(before)
    step = after.step(estimate_of(41, errors[-1], NONE), 41)
    change = np.abs(step.command.as_array() - commands[-1])
    assert np.all(change <= CommandLimits.of(learnt, PERIOD_S).step + 1e-12)
    assert step.diagnostics.solver.accepted
    assert not step.diagnostics.fallback


def test_a_nominal_state_that_does_not_start_at_the_estimate_is_refused():
    with pytest.raises(InvalidTuning, match=r"tightening: 'tube' .* needs nominal = 'one-step'"):
        ArticulatedOptions(tightening="tube", nominal="tube")
