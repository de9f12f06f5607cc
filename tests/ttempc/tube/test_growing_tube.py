"""Tubes that grow from the estimate: reachable inputs, bounds of the plans, feasibility."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.ttempc.tubes import (
    DESIGN,
    PERIOD_S,
    REFERENCE,
    TICKS,
    VEHICLE,
    WINDOW,
    admissible,
    along,
)
from ttempc.laws.articulated_mpc import MpcOptions
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.mpc.lmpc import CondensedHorizon, StageBounds
from ttempc.mpc.qp import PersistentSolver
from ttempc.reference.reference import exact_feedforward
from ttempc.tube.reference_tube import GrowingTube, horizon_bounds, reachable_inputs, steered_system
from ttempc.tube.tube import reachable_set
from ttempc.types import Input
from ttempc.vehicle import CommandLimits

OPTIONS = MpcOptions()
RIGID = along()
SYSTEM = RIGID.tube.system
INPUTS, RATES = reachable_inputs(SYSTEM, WINDOW, OPTIONS.horizon)
A, B, C = error_dynamics(REFERENCE, PERIOD_S, TICKS)
FEEDFORWARD = exact_feedforward(REFERENCE, TICKS, PERIOD_S)
TUBE = GrowingTube.along(DESIGN, A, B, C, FEEDFORWARD, OPTIONS)
LIMITS = CommandLimits.of(VEHICLE, PERIOD_S)
CURVE = 300


def test_the_ancillary_action_stays_within_what_is_reserved_and_reaches_it():
    generator = np.random.default_rng(81)
    runs = [admissible(WINDOW, OPTIONS.horizon, generator) for _ in range(30)]
    window = WINDOW.window  # of all its energy at once: the largest sum within one window
    for row in SYSTEM.gains[CURVE + window]:
        rows = [row]  # on w(k-1), w(k-2), ...
        for j in range(1, window):
            rows.append(rows[-1] @ SYSTEM.closed[CURVE + window - j])
        worst = WINDOW.worst(np.array(rows))[::-1]
        runs.append(np.vstack([worst, np.zeros((OPTIONS.horizon - window, 7))]))
    largest = np.zeros(3)
    for run in runs:
        deviation, before = np.zeros(7), np.zeros(3)
        for j in range(OPTIONS.horizon):
            action = SYSTEM.gains[CURVE + j] @ deviation
            assert np.all(np.abs(action) <= INPUTS[j, CURVE + j] * (1.0 + 1e-9))
            assert np.all(np.abs(action - before) <= RATES[j, CURVE + j] * (1.0 + 1e-9))
            if j == window:
                largest = np.maximum(largest, np.abs(action))
            deviation, before = SYSTEM.closed[CURVE + j] @ deviation + run[j], action
    np.testing.assert_allclose(largest, INPUTS[window, CURVE + window])


def test_it_grows_from_nothing_towards_the_invariant_tube():
    assert not INPUTS[0].any()
    assert not RATES[0].any()
    assert np.all(np.diff(INPUTS, axis=0) >= -1e-12)
    assert np.all(INPUTS[-1] <= RIGID.tube.inputs)
    late = reachable_inputs(SYSTEM, WINDOW, 151)[0][-1]
    np.testing.assert_allclose(late, RIGID.tube.inputs, rtol=RIGID.tube.certificate.alpha + 1e-3)


def test_planned_inputs_and_ancillary_action_keep_to_the_limits_at_every_stage():
    """Also where the plan only holds its last free input, to the end of the horizon."""
    stages = np.arange(OPTIONS.horizon)
    free = np.minimum(stages, OPTIONS.moves - 1)
    for bound, sign in ((TUBE.bounds.lower, -1.0), (TUBE.bounds.upper, 1.0)):
        planned = bound.reshape(len(bound), OPTIONS.moves, 3)[:, free]  # (ticks, Np, 3)
        assert np.all(sign * planned >= 0.0)  # the reference itself is always allowed
        for j in stages:
            at = slice(j, j + len(planned))
            command = FEEDFORWARD[at] - planned[:, j] - sign * TUBE.reserve[j, at]
            assert np.all(command <= LIMITS.upper + 1e-12)
            assert np.all(command >= LIMITS.lower - 1e-12)


def test_every_qp_after_a_feasible_one_is_feasible_whatever_the_disturbances():
    horizon = CondensedHorizon(A, B, OPTIONS, PERIOD_S, C, free_bounds=TUBE.bounds)
    generator, solver, u = np.random.default_rng(82), PersistentSolver(), np.zeros(3)
    at_bound = 0
    for k in range(horizon.ticks):
        error = generator.normal(size=7) * [3, 3, 0.5, 0.5, 0.1, 0.1, 0.5]
        state = np.concatenate([error, np.zeros(9)])
        solution = solver.solve(horizon.qp(k, state, u))
        assert solution.report.accepted
        u = u + solution.x[:3]
        at_bound += np.isclose(u, TUBE.bounds.upper[k, :3], atol=1e-6).any()
        u = horizon.admissible(k, u + generator.normal(size=3), u - solution.x[:3])
    assert at_bound > 30  # the bounds count


def test_an_input_that_later_bounds_would_strand_is_not_allowed():
    """One input, steps of 1: the bound falls from 5 to 1 at tick 6, beyond the first horizons."""
    stages, high = 12, np.array([5.0] * 6 + [1.0] * 6)[:, None]
    none = np.zeros((3, stages, 1))
    step = np.ones((stages, 1))
    bounds = horizon_bounds(StageBounds(-high, high, -step, step), none, none, moves=2)
    # The plan of tick 3 alone may start at 5; from there tick 4 could not come down to its 2.
    expected = [5.0, 5.0, 4.0, 3.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(bounds.upper[:, 0], expected)
    np.testing.assert_allclose(bounds.lower[:, 0], -bounds.upper[:, 0])


def test_the_ancillary_gain_leaves_the_plan_the_hydrostat_and_half_of_every_change():
    system, inputs, rates = steered_system(DESIGN, A, B, C, LIMITS, OPTIONS.horizon)
    assert not inputs[..., Input.HP].any()
    assert np.all(rates <= 0.5 * LIMITS.step)
    assert np.any(0.5 * LIMITS.step < RATES)  # those of the invariant tube
    # Cross-track, where constraints are, it still holds the deviations together.
    open_loop = replace(SYSTEM, gains=np.zeros_like(SYSTEM.gains))
    steered, free = (
        reachable_set(one, WINDOW, OPTIONS.horizon - 1).support(SYSTEM.c[CURVE, [1, 3]])
        for one in (system, open_loop)
    )
    assert np.all(steered < 0.75 * free)


def test_a_smaller_rate_limit_makes_the_ancillary_gain_smaller():
    slow = replace(LIMITS, step=0.2 * LIMITS.step)
    system, _, rates = steered_system(DESIGN, A, B, C, slow, OPTIONS.horizon)
    assert np.all(rates <= 0.5 * slow.step)
    assert np.all(np.abs(system.gains).max(axis=(0, 2)) <= np.abs(SYSTEM.gains).max(axis=(0, 2)))


def test_where_the_limits_leave_less_the_reserve_is_what_they_leave():
    wide = GrowingTube.along(
        DESIGN, A, B, C, FEEDFORWARD, MpcOptions(input_bound=(0.01, 0.01, 0.01))
    )
    assert np.all(wide.reserve <= 0.01)
    assert np.all(wide.bounds.upper.reshape(-1, OPTIONS.moves, 3)[:, 1:] > 0.0)
