"""QPs of real runs: both solvers have the same minimiser."""

from __future__ import annotations

import numpy as np
import pytest
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load

from ttempc.mpc.qp import PersistentSolver

SHORT = 'path={kind="straight",length_m=20.0}'


@pytest.fixture
def qps(monkeypatch):
    """Return the QPs of a short run with active bounds."""
    solve, recorded = PersistentSolver.solve, []

    def recording(solver, qp):
        solution = solve(solver, qp)
        if solution.report.iterations:
            recorded.append(qp)
        return solution

    with monkeypatch.context() as patch:
        patch.setattr(PersistentSolver, "solve", recording)
        simulate(*load("furrows", [SHORT]), 31)
    return recorded


def test_both_solvers_agree_on_the_qps_of_a_run(qps):
    piqp, daqp = PersistentSolver("piqp"), PersistentSolver("daqp")
    assert len(qps) > 20
    for qp in qps:
        first, second = piqp.solve(qp).x, daqp.solve(qp).x
        np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-6)
        residuals = qp.residuals(second)
        assert residuals.primal < 1e-9
        assert residuals.stationarity < 1e-10 * (1.0 + np.linalg.norm(qp.gradient))


@pytest.mark.parametrize("name", ["ttempc", "nmpc-rti"])
def test_a_run_with_either_solver_has_the_same_errors(name):
    options = [SHORT, f'controller.name="{name}"']
    errors = [
        simulate(*load("furrows", [*options, f'controller.options.solver="{solver}"']), 31)[
            0
        ].tracking.all.tractor.mean_euclidean_m
        for solver in ("piqp", "daqp")
    ]
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)
