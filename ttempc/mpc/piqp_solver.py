"""PIQP's dense interior-point solver (Schwan, Jiang, Kuhn and Jones 2023)."""

from __future__ import annotations

import numpy as np
import piqp

from ..types import FloatArray, SolverReport
from .quadratic_programme import QP

# PIQP's default of 1e-8 leaves errors of 1e-5 in the first move where bounds are weakly active.
_TOLERANCE = 1e-12


class PiqpSolver:
    """See `ttempc.mpc.solver.QPSolver`; each problem starts from PIQP's own initial point."""

    def __init__(self) -> None:
        self._solver: piqp.DenseSolver | None = None
        self._matrix: FloatArray = np.empty((0, 0))  # of the rows in the solver

    def hold(self, hessian: FloatArray) -> None:
        """Do nothing: every iteration has a factorisation of its own."""

    def solve(self, qp: QP) -> tuple[FloatArray, SolverReport]:
        """Return the last iterate (n,) and PIQP's report."""
        solver = self._load(qp)
        status = solver.solve()
        accepted = status == piqp.PIQP_SOLVED
        info = solver.result.info
        report = SolverReport(
            status="solved" if accepted else status.name.removeprefix("PIQP_").lower(),
            accepted=accepted,
            iterations=info.iter,
            solve_time_s=info.solve_time,
            primal_residual=info.primal_res,
            dual_residual=info.dual_res,
        )
        return solver.result.x.copy(), report

    def _load(self, qp: QP) -> piqp.DenseSolver:
        """Return a solver that holds the problem: the present one, or a new one."""
        hessian = qp.hessian.T  # symmetric; the transpose has the column order of PIQP
        # The rows of the inputs are one array for all ticks; soft rows are new ones at each tick.
        known, self._matrix = self._matrix, qp.matrix
        if self._solver is not None and known.shape == qp.matrix.shape:
            self._solver.update(
                P=hessian,
                c=qp.gradient,
                G=None if qp.matrix is known else np.asfortranarray(qp.matrix),
                h_l=qp.lower,
                h_u=qp.upper,
                x_l=qp.step_lower,
                x_u=qp.step_upper,
            )
            return self._solver
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = settings.eps_rel = _TOLERANCE
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = _TOLERANCE
        # Ruiz's iterations cost a fifth of a solve and make these small QPs no more accurate.
        settings.preconditioner_iter = 0
        settings.compute_timings = True
        solver.setup(
            P=hessian,
            c=qp.gradient,
            G=np.asfortranarray(qp.matrix),
            h_l=qp.lower,
            h_u=qp.upper,
            x_l=qp.step_lower,
            x_u=qp.step_upper,
        )
        self._solver = solver
        return solver
