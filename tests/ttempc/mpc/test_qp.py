"""Condensed QP, soft rows, solvers and linear MPC against exact minima."""

from __future__ import annotations

import platform
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.exact_qp import exact_minimum, residuals
from tests.ttempc.horizons import PERIOD_S, TUNING, horizon, qp_of, random_qp, stages
from ttempc.errors import MissingPackage
from ttempc.mpc.condensing import FreeInputs, FreeSteps
from ttempc.mpc.lmpc import SOLVERS, CondensedHorizon, LinearMpc, OutputBounds, move_bounds
from ttempc.mpc.qp import PENALTY, QP, CheckedSolver, SoftRows
from ttempc.types import SolverReport

SINGLE = FreeSteps.single(TUNING.moves)


def rolled_cost(k, state, previous, steps, rows=None, free=SINGLE):
    """Eq. (costfunction), stage by stage, without the constant term of z_k.

    A step for several periods costs as much as a ramp of as many.
    """
    a, b = stages()
    moves = dict(zip(free.stages.tolist(), steps.reshape(-1, 3), strict=True))
    periods = dict(zip(free.stages.tolist(), free.periods.tolist(), strict=True))
    z, u, cost = state, previous, 0.0
    for j in range(TUNING.horizon):
        if j in moves:
            u = u + moves[j]
            one = moves[j] / periods[j]
            cost += periods[j] * one @ np.diag(TUNING.step_weight) @ one
        z = a[k + j] @ z + b[k + j] @ u
        y = z if rows is None else rows[k + j + 1] @ z
        cost += y @ np.diag(TUNING.output_weight) @ y
    return cost


@pytest.mark.parametrize("scale", [1.0, 0.02])  # of the state: damped outputs count from 0.5 m on
def test_objective_differs_from_the_rolled_cost_by_a_constant(scale):
    generator = np.random.default_rng(5)
    a, b = stages()
    damped = generator.normal(size=(len(a) + 1, 7, 7))
    entering = CondensedHorizon(a, b, TUNING, PERIOD_S, damped=damped)
    for k in (0, 40, 55, 100):
        state, previous = scale * generator.normal(size=7), 0.05 * generator.normal(size=3)
        rows = damped if scale == 1.0 else None
        qp = qp_of(entering, k, state, previous)
        free = rolled_cost(k, state, previous, np.zeros(9), rows)
        for _ in range(3):
            steps = 0.1 * generator.normal(size=9)
            rolled = rolled_cost(k, state, previous, steps, rows) - free
            assert qp.objective(steps) == pytest.approx(rolled, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("periods", [1.0, 1.6, 3.0])
def test_inputs_held_between_free_steps_have_the_rolled_cost_and_rates(periods):
    generator = np.random.default_rng(6)
    a, b = stages()
    free = FreeSteps.blocks(3, periods)
    assert free.stages[0] == 0
    assert np.diff(free.stages).min() >= 1
    bounds = move_bounds(TUNING, PERIOD_S, len(a), steps=free)
    held = CondensedHorizon(a, b, TUNING, PERIOD_S, free=FreeInputs(free, bounds))
    state, previous = 0.02 * generator.normal(size=7), 0.05 * generator.normal(size=3)
    for k in (0, 55):
        qp = qp_of(held, k, state, previous)
        constant = rolled_cost(k, state, previous, np.zeros(9), free=free)
        steps = 0.1 * generator.normal(size=9)
        rolled = rolled_cost(k, state, previous, steps, free=free) - constant
        assert qp.objective(steps) == pytest.approx(rolled, rel=1e-9, abs=1e-9)
        rates = np.asarray(TUNING.input_rate) * PERIOD_S
        np.testing.assert_allclose(qp.upper[3:], np.tile(periods * rates, 2))


def test_blocks_of_one_period_are_single_steps():
    for mine, single in zip(FreeSteps.blocks(6, 1.0), FreeSteps.single(6), strict=True):
        np.testing.assert_array_equal(mine, single)


def test_a_step_from_within_reach_leads_into_the_bounds():
    generator = np.random.default_rng(44)
    ticks, step = horizon().ticks, np.asarray(TUNING.input_rate) * PERIOD_S
    every = move_bounds(TUNING, PERIOD_S, ticks + TUNING.horizon - 1)
    for k in generator.integers(ticks, size=200).tolist():
        bounds = every.at(k)
        previous = bounds.clamp_previous(generator.normal(size=3))
        landed = bounds.clamp(previous)
        assert np.all(np.abs(landed - previous) <= step + 1e-15)
        inside = bounds.clamp(0.3 * generator.normal(size=3))
        np.testing.assert_array_equal(bounds.clamp_previous(inside), inside)


def test_a_tick_has_the_same_qp_in_any_order_and_on_a_horizon_of_its_own():
    a, b = stages()
    given = np.linspace(-0.1, 0.1, 7), np.zeros(3)
    in_order = {k: qp_of(horizon(), k, *given) for k in range(horizon().ticks)}
    order = np.random.default_rng(45).permutation(horizon().ticks)  # back and forth over blocks
    for k in order.tolist():
        alone = CondensedHorizon(
            a[k : k + TUNING.horizon], b[k : k + TUNING.horizon], TUNING, PERIOD_S
        )
        for qp in (in_order[k], qp_of(alone, 0, *given)):
            again = qp_of(horizon(), k, *given)
            assert qp.hessian.tobytes() == again.hessian.tobytes()
            assert qp.gradient.tobytes() == again.gradient.tobytes()


FIRST, SPREAD = 3, 0.1


def bounded(lower, upper):
    """Return the horizon with two outputs, random combinations of the state, within bounds."""
    a, b = stages()
    rows = np.random.default_rng(3).normal(size=(len(a) + 1, 2, 7))
    shape = (len(a) + 1, 2)
    spread = np.zeros((TUNING.horizon + 1, 2))
    spread[:FIRST], spread[FIRST:] = -np.inf, SPREAD
    penalty = np.full(2, PENALTY)
    soft = OutputBounds(rows, np.full(shape, lower), np.full(shape, upper), spread, penalty)
    return rows, CondensedHorizon(a, b, TUNING, PERIOD_S, soft=soft)


def test_rows_are_the_outputs_of_the_rolled_model():
    rows, limited = bounded(-0.4, 0.7)
    a, b = stages()
    generator = np.random.default_rng(4)
    k, z, u = 55, generator.normal(size=7), 0.05 * generator.normal(size=3)
    steps = generator.normal(size=9)
    soft = qp_of(limited, k, z, u).soft
    assert soft is not None
    expected = []
    for j in range(TUNING.horizon):
        u = u + (steps[3 * j : 3 * j + 3] if j < TUNING.moves else 0.0)
        z = a[k + j] @ z + b[k + j] @ u
        expected += (rows[k + j + 1] @ z).tolist()
    held = np.repeat(np.arange(1, TUNING.horizon + 1) >= FIRST, 2)
    upper, lower = (np.where(held, bound, np.inf) for bound in (0.7 - SPREAD, 0.4 - SPREAD))
    np.testing.assert_allclose(soft.matrix @ steps - soft.upper, np.array(expected) - upper)
    np.testing.assert_allclose(soft.matrix @ steps - soft.lower, np.array(expected) + lower)
    assert len(limited.softened_problem(k, limited.work()).hardened().matrix) == 6 + 2 * held.sum()


def test_slack_is_zero_where_the_rows_can_hold_and_the_largest_violation_elsewhere():
    generator = np.random.default_rng(8)
    held = violated = 0
    solver = CheckedSolver()
    for _ in range(60):
        qp, _, _ = random_qp(generator, scale=0.02)
        free = CheckedSolver().solve(qp).x
        assert free is not None
        rows = np.zeros((4, 9))
        rows[:, :3] = generator.normal(size=(4, 3))
        upper = rows @ free - 0.01 * generator.uniform(-0.5, 1.0, size=4)
        soft = SoftRows(rows, upper - 10.0, upper, np.full(2, PENALTY))
        softened = replace(qp, soft=soft)
        x = solver.solve(softened).x
        assert x is not None
        primal, stationarity = residuals(softened.hardened(), x)
        assert primal < 1e-7
        assert stationarity < 1e-4
        violation = (rows @ x[:9] - upper).reshape(2, 2).max(axis=0)
        np.testing.assert_allclose(x[9:], np.maximum(violation, 0.0), atol=1e-6)
        if x[9:].max() > 1e-6:
            violated += 1
            continue
        held += 1
        hard = replace(
            qp,
            matrix=np.vstack([qp.matrix, rows]),
            row_lower=np.concatenate([qp.row_lower, soft.lower]),
            row_upper=np.concatenate([qp.row_upper, soft.upper]),
        )
        np.testing.assert_allclose(x[:9], exact_minimum(hard), atol=1e-6)
    assert held > 5
    assert violated > 5


def test_no_problem_with_violated_soft_bounds_is_refused():
    """Random outputs, bounds and penalties, some of them free, along drives far off the path.

    With a bound of 1000 instead of a free one, a solve in 400 ended at its limit of iterations.
    """
    generator = np.random.default_rng(31)
    solver = CheckedSolver()
    iterations = []
    for _ in range(400):
        qp, _, _ = random_qp(generator, 10.0 ** generator.uniform(-2.0, 0.3))
        stages, outputs = 8, int(generator.integers(1, 4))
        rows = np.cumsum(generator.normal(size=(stages, outputs, 9)), axis=0)
        rows *= np.arange(9) < 3 * np.arange(1, stages + 1)[:, None, None]
        rows = 10.0 ** generator.uniform(-2.0, 0.5) * rows.reshape(-1, 9)
        values = rows @ solver.solve(qp).x
        limit = 10.0 ** generator.uniform(-2.0, -0.2) * np.abs(values).max()
        free = generator.random(len(rows)) < 0.2
        upper = np.where(free, np.inf, limit)
        penalty = generator.choice([10.0, 1000.0], size=outputs)
        soft = replace(qp, soft=SoftRows(rows, -upper, upper, penalty))
        solution = solver.solve(soft)
        assert solution.report.status == "solved with soft bounds"
        primal, stationarity = residuals(soft.hardened(), solution.x)
        assert primal < 1e-8
        assert stationarity < 1e-5 * (1.0 + np.linalg.norm(qp.gradient))
        iterations.append(solution.report.iterations)
    assert max(iterations) < 60


each_solver = pytest.mark.parametrize("name", SOLVERS)


@each_solver
@pytest.mark.parametrize("scale", [0.02, 0.2, 1.0, 5.0])
def test_minimiser_agrees_with_an_exact_active_set(name, scale):
    generator = np.random.default_rng(11)
    solver = CheckedSolver(name)
    for _ in range(25):
        qp, _, _ = random_qp(generator, scale)
        solution = solver.solve(qp)
        assert solution.x is not None
        np.testing.assert_allclose(solution.x, exact_minimum(qp), atol=1e-6)


def corrupted(qp, kind):
    match kind:
        case "cost not finite":
            return replace(qp, gradient=np.where(np.arange(9) == 4, np.nan, qp.gradient))
        case "hessian not finite":
            return replace(qp, hessian=np.full((9, 9), np.nan))
        case "one entry infinite":
            row_upper = qp.row_upper.copy()
            row_upper[2] = np.inf
            return replace(qp, row_upper=row_upper)
        case "indefinite":
            return replace(qp, hessian=qp.hessian - 5.0 * np.linalg.norm(qp.hessian) * np.eye(9))
        case "infeasible":
            return replace(qp, row_lower=qp.row_lower + 5.0, row_upper=qp.row_upper + 5.0)
    raise AssertionError(kind)


@each_solver
@pytest.mark.parametrize(
    "kind",
    ["cost not finite", "hessian not finite", "one entry infinite", "indefinite", "infeasible"],
)
def test_bad_input_is_reported_and_leaves_no_trace(name, kind):
    generator = np.random.default_rng(13)
    solver = CheckedSolver(name)
    good, _, _ = random_qp(generator, 0.3)
    before = solver.solve(good)
    bad = solver.solve(corrupted(good, kind))
    assert bad.x is None
    assert not bad.report.accepted
    assert bad.report.status != "solved"
    after = solver.solve(good)
    assert after.report.accepted
    assert after.report.status == before.report.status == "solved"
    np.testing.assert_allclose(after.x, before.x, atol=1e-9)


@pytest.mark.parametrize(
    ("beyond", "accepted"), [(0.0, True), (1e-9, True), (1e-4, False), (np.nan, False)]
)
@pytest.mark.parametrize("bound", ["row", "entry"])
def test_a_result_beyond_its_bounds_is_refused_though_its_solver_calls_it_solved(
    monkeypatch, beyond, accepted, bound
):
    class Careless:
        def solve(self, qp, is_soft):
            return np.array([1.0 + beyond]), SolverReport("solved", True, 3, 0.0, 0.0, 0.0)

    wide, one = np.array([9.0]), np.array([1.0])
    rows, entries = (one, wide) if bound == "row" else (wide, one)
    qp = QP(np.eye(1), np.array([-5.0]), np.eye(1), -rows, rows, -entries, entries)
    solver = CheckedSolver()
    monkeypatch.setattr(solver, "_solver", Careless())
    solution = solver.solve(qp)
    assert solution.report.accepted == accepted
    assert (solution.x is not None) == accepted


def test_a_solver_that_is_not_installed_is_refused_with_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(MissingPackage, match=r"pip install -e './ttempc\[baselines\]'"):
        CheckedSolver("daqp")


def test_a_minimum_inside_its_bounds_needs_no_solver_and_one_beyond_them_does():
    generator = np.random.default_rng(15)
    solver, answered = CheckedSolver(), {True: 0, False: 0}
    for _ in range(300):
        qp, _, _ = random_qp(generator, 10.0 ** generator.uniform(-3.0, 0.5))
        free = np.linalg.solve(qp.hessian, -qp.gradient)
        inside = qp.violation(free) == 0.0
        answered[inside] += 1
        solution = solver.solve(qp)
        assert (solution.report.status == "closed form") == inside
        assert solution.report.accepted
        if inside:
            np.testing.assert_allclose(solution.x, free, rtol=0.0, atol=1e-9)
        assert residuals(qp, solution.x)[1] < 1e-5 * (1.0 + np.linalg.norm(qp.gradient))
    assert min(answered.values()) > 50


BOUND = np.asarray(TUNING.input_bound)
RATE = np.asarray(TUNING.input_rate)


def test_inputs_and_their_rates_stay_within_the_papers_bounds():
    generator = np.random.default_rng(21)
    mpc = LinearMpc(horizon())
    before = np.zeros(3)
    for k in range(horizon().ticks):
        error = 10.0 ** generator.uniform(-2, 1) * generator.normal(size=7)
        u, report = mpc.step(k, error, before)
        assert report.accepted
        assert np.all(np.abs(u) <= BOUND)
        assert np.all(np.abs(u - before) <= RATE * PERIOD_S + 1e-9)
        before = u


def test_failure_holds_the_previous_feedback_and_the_next_solve_is_right():
    mpc, fresh = LinearMpc(horizon()), LinearMpc(horizon())
    error = np.array([0.1, 0.2, 0.05, 0.1, -0.2, 0.05, 0.1])
    held, _ = mpc.step(5, error, np.zeros(3))
    fresh.step(5, error, np.zeros(3))
    after, failed = mpc.step(6, np.full(7, np.nan), held)
    np.testing.assert_array_equal(after, held)
    assert not failed.accepted
    (recovered, report), (expected, _) = mpc.step(6, error, held), fresh.step(6, error, held)
    np.testing.assert_allclose(recovered, expected, atol=1e-9)
    assert report.accepted


_ON_A_PROCESSOR_WITH_AVX512 = """
import sys
from importlib.machinery import ExtensionFileLoader
load = ExtensionFileLoader.exec_module
def exec_module(loader, module):
    load(loader, module)
    if module.__name__ == "piqp.instruction_set":
        module.avx512f = True
ExtensionFileLoader.exec_module = exec_module
from ttempc.mpc.common_piqp import piqp
print(piqp.DenseSolver.__module__)
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the common level is one of x86-64")
def test_piqp_takes_its_code_for_avx2_also_where_the_processor_has_more():
    child = [sys.executable, "-c", _ON_A_PROCESSOR_WITH_AVX512]
    printed = subprocess.run(child, capture_output=True, text=True, timeout=60, check=True).stdout
    assert printed.strip() == "piqp.piqp_python_avx2"
