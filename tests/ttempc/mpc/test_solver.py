"""Persistent solver against an exact minimiser, and on bad input."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.exact_qp import exact_minimum
from tests.ttempc.horizons import random_qp
from ttempc.errors import MissingPackage
from ttempc.mpc.lmpc import SOLVERS
from ttempc.mpc.qp import QP, PersistentSolver

each_solver = pytest.mark.parametrize("name", SOLVERS)


@each_solver
@pytest.mark.parametrize("scale", [0.02, 0.2, 1.0, 5.0])
def test_minimiser_agrees_with_an_exact_active_set(name, scale):
    generator = np.random.default_rng(11)
    solver = PersistentSolver(name)
    for _ in range(25):
        qp, _, _ = random_qp(generator, scale)
        solution = solver.solve(qp)
        assert solution.x is not None
        np.testing.assert_allclose(solution.x, exact_minimum(qp), atol=1e-6)


@each_solver
def test_every_solution_satisfies_the_optimality_conditions(name):
    generator = np.random.default_rng(12)
    solver = PersistentSolver(name)
    for _ in range(500):
        qp, _, _ = random_qp(generator, 10.0 ** generator.uniform(-3.0, 1.0))
        solution = solver.solve(qp)
        assert solution.report.accepted
        residuals = qp.residuals(solution.x)
        assert residuals.primal < 1e-9
        assert residuals.stationarity < 1e-5 * (1.0 + np.linalg.norm(qp.gradient))


def corrupted(qp, kind):
    match kind:
        case "cost not finite":
            return replace(qp, gradient=np.where(np.arange(9) == 4, np.nan, qp.gradient))
        case "hessian not finite":
            return replace(qp, hessian=np.full((9, 9), np.nan))
        case "one entry infinite":
            return replace(qp, upper=np.where(np.arange(9) == 2, np.inf, qp.upper))
        case "indefinite":
            return replace(qp, hessian=qp.hessian - 5.0 * np.linalg.norm(qp.hessian) * np.eye(9))
        case "infeasible":
            return replace(qp, lower=qp.lower + 5.0, upper=qp.upper + 5.0)
    raise AssertionError(kind)


@each_solver
@pytest.mark.parametrize(
    "kind",
    ["cost not finite", "hessian not finite", "one entry infinite", "indefinite", "infeasible"],
)
def test_bad_input_is_reported_and_leaves_no_trace(name, kind):
    generator = np.random.default_rng(13)
    solver = PersistentSolver(name)
    good, _, _ = random_qp(generator, 0.3)
    before = solver.solve(good)
    bad = solver.solve(corrupted(good, kind))
    assert bad.x is None
    assert not bad.report.accepted
    assert bad.report.status != "solved"
    after = solver.solve(good)
    assert after.report.accepted
    assert after.report.status == "solved"
    np.testing.assert_allclose(after.x, before.x, atol=1e-9)


@each_solver
def test_report_carries_the_solvers_own_clock(name):
    solver = PersistentSolver(name)
    qp, _, _ = random_qp(np.random.default_rng(14), 5.0)  # with active bounds
    for _ in range(2):  # freshly set up, and updated
        report = solver.solve(qp).report
        assert 0.0 < report.solve_time_s < 0.1
        assert report.iterations > 0
        residuals = report.primal_residual, report.dual_residual
        assert all(map(math.isnan, residuals)) == (name == "daqp")  # it reports none
        assert not any(residual > 1e-6 for residual in residuals)


def test_a_hessian_that_is_held_before_the_problem_changes_no_bit():
    """Also that of a problem that never came, or that needed no solver."""
    generator = np.random.default_rng(16)
    qps = [random_qp(generator, 2.0)[0] for _ in range(60)]
    plain, holding = PersistentSolver("daqp"), PersistentSolver("daqp")
    for qp, other in zip(qps, reversed(qps), strict=True):
        holding.hold(other.hessian)
        holding.hold(qp.hessian)
        first, second = plain.solve(qp), holding.solve(qp)
        assert first.report.iterations == second.report.iterations
        np.testing.assert_array_equal(first.x, second.x)


def test_a_solver_that_is_not_installed_is_refused_with_the_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(MissingPackage, match=r"pip install 'ttempc\[baselines\]'"):
        PersistentSolver("daqp")


def test_a_minimum_inside_its_bounds_needs_no_solver_and_one_beyond_them_does():
    generator = np.random.default_rng(15)
    solver, answered = PersistentSolver(), {True: 0, False: 0}
    for _ in range(300):
        qp, _, _ = random_qp(generator, 10.0 ** generator.uniform(-3.0, 0.5))
        free = np.linalg.solve(qp.hessian, -qp.gradient)
        inside = bool((qp.slack(free) >= 0.0).all())
        answered[inside] += 1
        solution = solver.solve(qp)
        assert (solution.report.iterations == 0) == inside
        assert solution.report.accepted
        if inside:
            np.testing.assert_allclose(solution.x, free, rtol=0.0, atol=1e-9)
        residuals = qp.residuals(solution.x)
        assert residuals.stationarity < 1e-5 * (1.0 + np.linalg.norm(qp.gradient))
    assert min(answered.values()) > 50


@each_solver
def test_bounds_of_any_number_of_rows(name):
    qp = QP(
        hessian=2.0 * np.eye(2),
        gradient=np.array([-8.0, 0.0]),
        matrix=np.array([[1.0, 1.0]]),
        lower=np.array([-1.0]),
        upper=np.array([1.0]),
        step_lower=np.array([-9.0, -9.0]),
        step_upper=np.array([9.0, 9.0]),
    )
    np.testing.assert_allclose(PersistentSolver(name).solve(qp).x, [2.5, -1.5], atol=1e-8)
