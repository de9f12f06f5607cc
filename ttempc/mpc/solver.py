"""Exact minimiser of a QP without active bounds, else a persistent QP solver, with checks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np

from ..types import FloatArray, SolverReport
from .daqp_solver import DaqpSolver
from .interior_minimum import Outcome, interior_minimum
from .piqp_solver import PiqpSolver
from .quadratic_programme import QP

# Violation of a bound above which a solution is rejected; below it is clamped.
_BOUND_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class QPSolution:
    """Accepted minimiser of a QP, if any, and the solver's report."""

    # (n,), with soft rows that are active or violated (n + r,), see `QP.hardened`; None where the
    # result was not accepted
    x: FloatArray | None
    report: SolverReport


class QPSolver(Protocol):
    """A package's solver, kept between problems of the same size."""

    def hold(self, hessian: FloatArray) -> None:
        """Factorise the Hessian of the next problem, where the package can; changes no result."""
        ...

    def solve(self, qp: QP) -> tuple[FloatArray, SolverReport]:
        """Return the last iterate (n,) and the report, accepted where the package solved `qp`."""
        ...


_SOLVERS: Final = MappingProxyType[str, Callable[[], QPSolver]](
    {"piqp": PiqpSolver, "daqp": DaqpSolver}
)


class PersistentSolver:
    """A QP solver that is set up once and updated from problem to problem.

    A problem whose unconstrained minimiser is within all bounds needs no solver: it is answered by
    Cholesky's factorisation, with the status "solved" after 0 iterations in a solver's time of 0
    (docs/ablation.md, Cost).

    PIQP 0.6 and 0.7 fail on bad input as follows: input that is not finite gives a solution that is
    not finite, and corrupts later solves when it was in the Hessian; an infeasible problem may end
    at the iteration limit with an arbitrary point; an indefinite Hessian counts as solved.
    Therefore the input is checked first, a solution is accepted only when it is solved, finite and
    within its bounds, and the solver is built anew after any failure.

    Args:
        solver: one of `ttempc.mpc.qp.SOLVERS`.

    Raises:
        MissingPackage: the solver's package is not installed.
    """

    def __init__(self, solver: str = "piqp") -> None:
        self._name = solver
        self._solver = _SOLVERS[solver]()

    def fresh(self) -> PersistentSolver:
        """Return a solver of the same package before its first problem."""
        return PersistentSolver(self._name)

    def hold(self, hessian: FloatArray) -> None:
        """Factorise the Hessian (n, n) of the next problem, where the package can."""
        self._solver.hold(hessian)

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
            finite = outcome == Outcome.NOT_CONVEX
            status = "hessian not convex" if finite else "input not finite"
            return self._failed(SolverReport(status, False, 0, 0.0, math.inf, math.inf))
        hard = qp.hardened()
        x, report = self._solver.solve(hard)
        if not report.accepted:
            return self._failed(report)
        if not (np.isfinite(x).all() and (hard.slack(x) >= -_BOUND_TOLERANCE).all()):
            return self._failed(replace(report, status="solved outside its bounds", accepted=False))
        return QPSolution(x, report)

    def _failed(self, report: SolverReport) -> QPSolution:
        self._solver = _SOLVERS[self._name]()
        return QPSolution(None, report)
