"""Tubes along the figure eight: bounds, growth from the estimate, invariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.horizons import qp_of
from tests.ttempc.tubes import (
    DESIGN,
    PERIOD_S,
    REFERENCE,
    STEP,
    TICKS,
    VEHICLE,
    WINDOW,
    admissible,
    along,
)
from ttempc.errors import InvalidTube
from ttempc.laws.options import MpcOptions
from ttempc.mpc.articulated_error import error_dynamics, remaining_bounds
from ttempc.mpc.condensing import FreeInputs, FreeSteps, StageBounds
from ttempc.mpc.lmpc import CondensedHorizon
from ttempc.mpc.qp import CheckedSolver
from ttempc.reference.reference import ConstantSpeed, Reference, exact_feedforward
from ttempc.tube.reference_tube import (
    GrowingTube,
    horizon_bounds,
    reachable_inputs,
)
from ttempc.tube.tube import Tube
from ttempc.vehicle import CommandLimits

ALONG = along()
LIMITS = CommandLimits.of(VEHICLE, PERIOD_S)


def test_tightened_bounds_and_the_tube_add_up_to_the_limits():
    tube = ALONG.tube
    bounds = ALONG.bounds
    whole = remaining_bounds(ALONG.feedforward, LIMITS)
    for edge, taken, sign in (
        ("lower", tube.inputs, -1.0),
        ("upper", tube.inputs, 1.0),
        ("step_lower", tube.rates, -1.0),
        ("step_upper", tube.rates, 1.0),
    ):
        np.testing.assert_allclose(getattr(bounds, edge) + sign * taken, getattr(whole, edge))
    # Every sum of nominal input and deviation is a command within the limits.
    for nominal in (bounds.lower, bounds.upper):
        for deviation in (-tube.inputs, tube.inputs):
            command = ALONG.feedforward - nominal - deviation
            assert np.all(command >= LIMITS.lower - 1e-12)
            assert np.all(command <= LIMITS.upper + 1e-12)


def test_another_vehicle_or_period_is_refused_with_the_numbers():
    other = Reference(
        REFERENCE.path, replace(VEHICLE, wheelbase=1.5, drawbar_length=0.7), ConstantSpeed(1.0)
    )
    with pytest.raises(InvalidTube, match=r"wheelbase 1\.4 \(here 1\.5\), drawbar_length 0\.8"):
        along(reference=other)
    with pytest.raises(InvalidTube, match=r"period_s 0\.2 \(here 0\.1\)"):
        DESIGN.require(VEHICLE, 0.1)


@pytest.mark.parametrize(("scale", "message"), [(6.0, "deg of the"), (200.0, "m/s of a speed")])
def test_a_disturbance_beyond_the_inputs_is_refused_with_the_numbers(scale, message):
    with pytest.raises(InvalidTube, match=message):
        along(replace(DESIGN, disturbance=replace(WINDOW, axes=scale * WINDOW.axes)))


OPTIONS = MpcOptions()
RIGID = along()
SYSTEM = RIGID.tube.system
INPUTS, RATES, _ = reachable_inputs(SYSTEM, WINDOW, OPTIONS.horizon)
A, B, C = error_dynamics(REFERENCE, PERIOD_S, TICKS)
FEEDFORWARD = exact_feedforward(REFERENCE, TICKS, PERIOD_S)
TUBE = GrowingTube.along(DESIGN, A, B, C, FEEDFORWARD, OPTIONS)
CURVE = 300


def test_the_ancillary_action_stays_within_what_is_reserved_and_reaches_it():
    generator = np.random.default_rng(81)
    runs = [admissible(WINDOW, OPTIONS.horizon, generator) for _ in range(30)]
    window = WINDOW.window
    # One window with all its energy reaches the largest action after N steps.
    for row in SYSTEM.gains[CURVE + window]:
        rows = [row]  # on w(k-1), w(k-2), ...
        for j in range(1, window):
            rows.append(rows[-1] @ SYSTEM.closed[CURVE + window - j])
        worst = WINDOW.worst(np.array(rows))[::-1]
        runs.append(np.vstack([worst, np.zeros((OPTIONS.horizon - window, 7))]))
    largest = np.zeros(3)
    for run in runs:
        deviation = np.zeros(7)
        before = np.zeros(3)
        for j in range(OPTIONS.horizon):
            action = SYSTEM.gains[CURVE + j] @ deviation
            assert np.all(np.abs(action) <= INPUTS[j, CURVE + j] * (1.0 + 1e-9))
            assert np.all(np.abs(action - before) <= RATES[j, CURVE + j] * (1.0 + 1e-9))
            if j == window:
                largest = np.maximum(largest, np.abs(action))
            deviation = SYSTEM.closed[CURVE + j] @ deviation + run[j]
            before = action
    np.testing.assert_allclose(largest, INPUTS[window, CURVE + window])


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
    free = FreeInputs(FreeSteps.single(OPTIONS.moves), TUBE.bounds)
    horizon = CondensedHorizon(A, B, OPTIONS, PERIOD_S, C, free=free)
    generator = np.random.default_rng(82)
    solver = CheckedSolver()
    u = np.zeros(3)
    at_bound = 0
    for k in range(horizon.ticks):
        error = generator.normal(size=7) * [3, 3, 0.5, 0.5, 0.1, 0.1, 0.5]
        state = np.concatenate([error, np.zeros(9)])
        solution = solver.solve(qp_of(horizon, k, state, u))
        assert solution.report.accepted
        u = u + solution.x[:3]
        at_bound += np.isclose(u, TUBE.bounds.upper[k, :3], atol=1e-6).any()
        lower, upper, step_lower, step_upper = (values[k, :3] for values in TUBE.bounds)

        # Any other admissible input instead of the planned one.
        before = u - solution.x[:3]
        moved = u + generator.normal(size=3)
        u = np.minimum(np.minimum(moved, upper), before + step_upper)
        u = np.maximum(np.maximum(u, lower), before + step_lower)
    assert at_bound > 30  # the bounds are active


def test_an_input_that_later_bounds_would_strand_is_not_allowed():
    """One input, steps of 1: the bound falls from 5 to 1 at tick 6, beyond the first horizons."""
    stages = 12
    high = np.array([5.0] * 6 + [1.0] * 6)[:, None]
    none = np.zeros((3, stages, 1))
    step = np.ones((stages, 1))
    bounds = horizon_bounds(StageBounds(-high, high, -step, step), none, none, moves=2)
    # The plan of tick 3 alone may start at 5; from there tick 4 could not come down to its 2.
    expected = [5.0, 5.0, 4.0, 3.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(bounds.upper[:, 0], expected)
    np.testing.assert_allclose(bounds.lower[:, 0], -bounds.upper[:, 0])


@pytest.mark.parametrize("moves", [1, 2])
def test_where_no_later_plan_exists_the_bounds_of_the_stage_itself_remain(moves):
    """One input, steps of 1: at most 1 before tick 6, at least 4 from then on."""
    stages = 12
    jump = 6
    later = np.arange(stages)[:, None] >= jump
    lower = np.where(later, 4.0, -1.0)
    upper = np.where(later, 5.0, 1.0)
    step = np.ones((stages, 1))
    none = np.zeros((moves, stages, 1))
    bounds = horizon_bounds(StageBounds(lower, upper, -step, step), none, none, moves)
    assert bounds.lower[jump - 1, 0] == -1.0
    assert bounds.upper[jump - 1, 0] == 1.0
    assert np.all(bounds.lower <= bounds.upper)


TUBES = {
    "window": along().tube,
    "box": along(replace(DESIGN, disturbance=STEP)).tube,
}


@pytest.fixture
def generator():
    return np.random.default_rng(7)


def driven(tube: Tube, last: int, disturbances):
    """Return the deviation at every tick up to `last` from 0, (steps + 1, 7) for (steps, 7)."""
    m = np.zeros((len(disturbances) + 1, *disturbances.shape[1:]))
    # Before the first tick its stage holds.
    for step, w in enumerate(disturbances):
        k = max(0, last - len(disturbances) + step)
        m[step + 1] = m[step] @ tube.system.closed[k].T + w
    return m


@pytest.mark.parametrize("name", TUBES)
def test_no_trajectory_leaves_and_the_worst_ones_reach_the_boundary(name, generator):
    """20 random runs over a lap, each step counted; worst cases for states, outputs, inputs."""
    tube = TUBES[name]
    for _ in range(20):
        run = admissible(tube.disturbance, TICKS - 1, generator)
        m = driven(tube, TICKS - 1, run)
        assert np.all(np.abs(m) <= tube.states * (1.0 + 1e-12))
        output = np.abs(np.einsum("kij,kj->ki", tube.system.c, m))
        u = np.einsum("kij,kj->ki", tube.system.gains, m)
        assert np.all(output <= tube.outputs * (1.0 + 1e-12))
        assert np.all(np.abs(u) <= tube.inputs * (1.0 + 1e-12))
        assert np.all(np.abs(np.diff(u, axis=0)) <= tube.rates[1:] * (1.0 + 1e-12))
    k = 300
    rows = np.concatenate([np.eye(7), tube.system.c[k], tube.system.gains[k]])
    bounds = np.concatenate([tube.states[k], tube.outputs[k], tube.inputs[k]])
    for row, bound in zip(rows, bounds, strict=True):
        run = tube.worst_case(k, row)
        assert tube.disturbance.fill(run).max() == pytest.approx(1.0)
        share = row @ driven(tube, k, run)[-1] / (bound * (1.0 - tube.certificate.alpha))
        if tube.certificate.window == 1:
            assert share == pytest.approx(1.0)
        else:
            assert 0.92 < share < 1.0
