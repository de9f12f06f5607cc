"""Exact minimiser of a QP without active bounds, else a persistent PIQP solver, with checks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import piqp

from ..types import FloatArray, SolverReport
from .interior_minimum import Outcome, interior_minimum
from .quadratic_programme import QP

# PIQP's default of 1e-8 leaves errors of 1e-5 in the first move where bounds are weakly active.
_TOLERANCE = 1e-11
# Violation of a bound above which a solution is rejected; below it is clamped.
_BOUND_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class QPSolution:
    """Accepted minimiser of a QP, if any, and the solver's report."""

    # (n,), with soft rows that are active or violated (n + r,), see `QP.hardened`; None where the
    # result was not accepted
    x: FloatArray | None
    report: SolverReport


class PersistentSolver:
    """PIQP's dense interior-point solver, set up once and updated from problem to problem.

    A problem whose unconstrained minimiser is within all bounds needs no solver: it is answered by
    Cholesky's factorisation, with the status "solved" after 0 iterations in a solver's time of 0
    (docs/ablation.md, Cost).

    PIQP 0.6 and 0.7 fail on bad input as follows: input that is not finite gives a solution that is
    not finite, and corrupts later solves when it was in the Hessian; an infeasible problem may end
    at the iteration limit with an arbitrary point; an indefinite Hessian counts as solved.
    Therefore the input is checked first, a solution is accepted only when it is solved, finite and
    within its bounds, and the solver is built anew after any failure.

    Args:
        tolerance: absolute and relative tolerance of residuals and duality gap.
    """

    def __init__(self, tolerance: float = _TOLERANCE) -> None:
        self._tolerance = tolerance
        self._solver: piqp.DenseSolver | None = None
        self._shape = (0, 0)  # of the constraints' matrix in the solver

    def solve(self, qp: QP) -> QPSolution:
        """Return the minimiser of `qp`, or the reason for which there is none."""
        x = np.empty_like(qp.gradient)
        outcome = interior_minimum(
            qp.hessian,
            qp.gradient,
            qp.matrix,
            qp.lower,
            qp.upper,
            qp.step_lower,
            qp.step_upper,
            x,
        )
        if outcome == Outcome.INTERIOR and (qp.soft is None or qp.soft.hold(x)):
            return QPSolution(x, SolverReport("solved", True, 0, 0.0, 0.0, 0.0))
        if outcome not in (Outcome.BOUNDED, Outcome.INTERIOR):
            self._solver = None
            finite = outcome == Outcome.NOT_CONVEX
            status = "hessian not convex" if finite else "input not finite"
            return QPSolution(None, SolverReport(status, False, 0, 0.0, math.inf, math.inf))
        varying = qp.soft is not None  # the rows of the inputs are the same at every tick
        qp = qp.hardened()
        solver = self._load(qp, varying=varying)
        status = solver.solve()
        result = solver.result
        info = result.info
        x = result.x.copy()
        accepted, text = False, "solved"
        if status != piqp.PIQP_SOLVED:
            text = status.name.removeprefix("PIQP_").lower()
        elif _within_bounds(qp, x):
            accepted = True
        else:
            text = "solved outside its bounds"
        if not accepted:
            self._solver = None
        report = SolverReport(
            status=text,
            accepted=accepted,
            iterations=info.iter,
            solve_time_s=info.solve_time,
            primal_residual=info.primal_res,
            dual_residual=info.dual_res,
        )
        return QPSolution(x if accepted else None, report)

    def _load(self, qp: QP, *, varying: bool) -> piqp.DenseSolver:
        """Return a solver that holds the problem: the present one, or a new one.

        `varying` tells whether the matrix of the rows differs from problem to problem.
        """
        hessian = qp.hessian.T  # symmetric; the transpose has the column order of PIQP
        if self._solver is not None and self._shape == qp.matrix.shape:
            self._solver.update(
                P=hessian,
                c=qp.gradient,
                G=np.asfortranarray(qp.matrix) if varying else None,
                h_l=qp.lower,
                h_u=qp.upper,
                x_l=qp.step_lower,
                x_u=qp.step_upper,
            )
            return self._solver
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = settings.eps_rel = self._tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = self._tolerance
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
        self._solver, self._shape = solver, qp.matrix.shape
        return solver


def _within_bounds(qp: QP, x: FloatArray) -> bool:
    """Whether `x` (n,) is finite and inside the bounds."""
    return bool(np.isfinite(x).all() and (qp.slack(x) >= -_BOUND_TOLERANCE).all())
