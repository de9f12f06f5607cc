"""Quadratic programme: in closed form where no bound is active, else by PIQP; soft rows."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from ..errors import MissingPackage
from ..jit import cached_njit
from ..types import FloatArray, SolverReport
from .common_piqp import piqp

# Of a slack s: cost PENALTY s + PENALTY s^2 / 2. The penalty is exact, that is the slack is 0 where
# the hard problem has a solution, if it exceeds the sum of that problem's multipliers of the output
# (Kerrigan and Maciejowski 2000). Assumed: not proven to be exact. With 1 the slack exceeds 1 mm
# three times as often on `rows`; with 1000 noise of the estimate saturates the steering.
PENALTY: Final = 10.0
SOFT_TOLERANCE: Final = 1e-9
"""Violation of a soft bound that counts as none, in the unit of its output."""


@dataclass(frozen=True, slots=True)
class SoftRows:
    """Soft constraints of one QP: lower - s_j <= G x <= upper + s_j, for j = row modulo r.

    The rows are those of r outputs at one stage after the other. Each output has one slack s_j,
    its largest violation along the horizon. An infinite bound is none.
    """

    matrix: FloatArray  # G (Np r, n)
    lower: FloatArray  # (Np r,)
    upper: FloatArray  # (Np r,)
    penalty: FloatArray  # of the slack of each output, see `PENALTY`, (r,)


@dataclass(frozen=True, slots=True)
class QP:
    """Minimise 1/2 x'Hx + g'x subject to row_lower <= G x <= row_upper, lower <= x <= upper."""

    hessian: FloatArray  # H (n, n)
    gradient: FloatArray  # g (n,)
    matrix: FloatArray  # G (m, n)
    row_lower: FloatArray  # (m,)
    row_upper: FloatArray  # (m,)
    lower: FloatArray  # (n,)
    upper: FloatArray  # (n,)
    soft: SoftRows | None = None  # further rows, which only `hardened` takes into account

    def hardened(self) -> QP:
        """Return the problem in (x, s) with the slacks s of its soft rows, whose bounds are hard.

        Without soft rows it is this problem. Soft rows without a bound are left out: PIQP would
        have to balance them against its other terms, and with a bound of 1000 in their place the
        duality gap of 1 of 437 problems stayed above the tolerance for all of its iterations.
        """
        soft = self.soft
        if soft is None:
            return self
        unknowns = len(self.gradient)
        outputs = len(soft.penalty)

        hessian = np.zeros((unknowns + outputs, unknowns + outputs))
        hessian[:unknowns, :unknowns] = self.hessian
        np.fill_diagonal(hessian[unknowns:, unknowns:], soft.penalty)

        # G x - s <= upper and -G x - s <= -lower
        slack = np.tile(-np.eye(outputs), (len(soft.lower) // outputs, 1))
        has_upper = np.isfinite(soft.upper)
        has_lower = np.isfinite(soft.lower)
        hard_rows = np.hstack([self.matrix, np.zeros((len(self.matrix), outputs))])
        upper_rows = np.hstack([soft.matrix, slack])[has_upper]
        lower_rows = np.hstack([-soft.matrix, slack])[has_lower]
        soft_bounds = np.concatenate([soft.upper[has_upper], -soft.lower[has_lower]])

        return QP(
            hessian=hessian,
            gradient=np.concatenate([self.gradient, soft.penalty]),
            matrix=np.concatenate([hard_rows, upper_rows, lower_rows]),
            row_lower=np.concatenate([self.row_lower, np.full(len(soft_bounds), -np.inf)]),
            row_upper=np.concatenate([self.row_upper, soft_bounds]),
            lower=np.concatenate([self.lower, np.zeros(outputs)]),
            upper=np.concatenate([self.upper, np.full(outputs, np.inf)]),
        )

    def objective(self, x: FloatArray) -> float:
        """Return the cost at `x` (n,)."""
        return float(0.5 * x @ self.hessian @ x + self.gradient @ x)

    def violation(self, x: FloatArray) -> float:
        """Return the largest violation of a hard bound at `x` (n,), 0 within all; else NaN."""
        rows = self.matrix @ x
        excess = (self.row_lower - rows, rows - self.row_upper, self.lower - x, x - self.upper)
        return float(np.concatenate(excess).max(initial=0.0))


CLOSED_FORM: Final = 0
"""The unconstrained minimiser is within all bounds: it is the solution, and no solver is needed."""
BOUND_ACTIVE: Final = -1
"""The unconstrained minimiser violates a hard bound."""
SOFT_BOUND_ACTIVE: Final = -2
"""The minimiser within the hard bounds violates a soft bound."""
NOT_FINITE: Final = -3
"""An entry of the gradient or of a bound on the rows is not finite."""
NOT_CONVEX: Final = -4
"""The Hessian is not positive definite, or not finite."""
REFUSED: Final = MappingProxyType(
    {NOT_FINITE: "input not finite", NOT_CONVEX: "hessian not convex"}
)
CLOSED_FORM_REPORT: Final = SolverReport("closed form", True, 0, 0.0, 0.0, 0.0)


def refused(outcome: int) -> SolverReport:
    """Return the report of a QP that no solver may see: `NOT_FINITE` or `NOT_CONVEX`."""
    return SolverReport(REFUSED[outcome], False, 0, 0.0, math.inf, math.inf)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def factorise(hessian: FloatArray, factor: FloatArray) -> bool:
    """Write the Cholesky factor of H (n, n) into `factor`; whether H is finite and convex."""
    n = hessian.shape[0]
    for i in range(n):
        for j in range(i + 1):
            rest = hessian[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if i == j:
                if not (rest > 0.0 and math.isfinite(rest)):
                    return False
                factor[i, i] = math.sqrt(rest)
            else:
                factor[i, j] = rest / factor[j, j]
    return True


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def minimise_unconstrained(factor: FloatArray, gradient: FloatArray, x: FloatArray) -> bool:
    """Write x = -H^-1 g (n,) by the Cholesky factor of H; whether the gradient is finite."""
    n = gradient.size
    for i in range(n):
        if not math.isfinite(gradient[i]):
            return False

    # forward: L y = -g
    for i in range(n):
        rest = -gradient[i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest / factor[i, i]

    # backward: L' x = y
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for k in range(i + 1, n):
            rest -= factor[k, i] * x[k]
        x[i] = rest / factor[i, i]
    return True


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def check_rows(
    matrix: FloatArray, row_lower: FloatArray, row_upper: FloatArray, x: FloatArray
) -> int:
    """Return `CLOSED_FORM`, `BOUND_ACTIVE` or `NOT_FINITE` for the rows G x and their bounds."""
    outcome = CLOSED_FORM
    for row in range(matrix.shape[0]):
        lower = row_lower[row]
        upper = row_upper[row]
        if not (math.isfinite(lower) and math.isfinite(upper)):
            return NOT_FINITE
        value = 0.0
        for i in range(x.size):
            value += matrix[row, i] * x[i]
        if not lower <= value <= upper:
            outcome = BOUND_ACTIVE
    return outcome


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def is_within(lower: FloatArray, upper: FloatArray, x: FloatArray) -> bool:
    """Whether each entry of x (n,) is within its bounds."""
    inside = True
    for i in range(x.size):
        inside &= lower[i] <= x[i] <= upper[i]
    return inside


# Tolerances of PIQP, absolute and relative. The default of 1e-8 leaves errors of 1e-4 rad in the
# first move where bounds are weakly active, 1e-7 leaves 1e-3 rad.
_TOLERANCE: Final = 1e-12
# Share of the way to the boundary that an iteration may take. Without soft rows 0.999 saves one
# iteration of nine against PIQP's default of 0.99. With soft rows it took up to 111 iterations on
# 8,000 random problems where the default took 36 at most.
_STEP_SHARE: Final = 0.999


class PiqpSolver:
    """Proximal interior-point method (Schwan, Jiang, Kuhn and Jones 2023).

    It starts every problem from its own initial point, so that a result depends on its problem
    alone. For problems with the same rows, an array that does not change, one solver is updated.
    """

    def __init__(self) -> None:
        self._solver: piqp.DenseSolver | None = None
        self._matrix: FloatArray | None = None  # of the rows in the solver

    def solve(self, qp: QP, *, is_soft: bool) -> tuple[FloatArray, SolverReport]:
        """Return the last iterate (n,) and PIQP's report; `is_soft`: some unknowns are slacks."""
        if self._solver is not None and qp.matrix is self._matrix:
            solver = self._solver
            solver.update(
                P=qp.hessian.T,  # symmetric; the transpose has the column order of PIQP
                c=qp.gradient,
                h_l=qp.row_lower,
                h_u=qp.row_upper,
                x_l=qp.lower,
                x_u=qp.upper,
            )
        else:
            solver = _set_up(qp, is_soft=is_soft)
            if not is_soft and len(qp.matrix):
                self._solver = solver
                self._matrix = qp.matrix
        status = solver.solve()

        info = solver.result.info
        solved = "solved with soft bounds" if is_soft else "solved"
        accepted = status == piqp.PIQP_SOLVED
        report = SolverReport(
            status=solved if accepted else status.name.removeprefix("PIQP_").lower(),
            accepted=accepted,
            iterations=info.iter,
            solve_time_s=info.solve_time,
            primal_residual=info.primal_res,
            dual_residual=info.dual_res,
        )
        return solver.result.x.copy(), report


def _set_up(qp: QP, *, is_soft: bool) -> piqp.DenseSolver:
    """Return a solver with the problem and the settings."""
    solver = piqp.DenseSolver()
    settings = solver.settings
    settings.eps_abs = _TOLERANCE
    settings.eps_rel = _TOLERANCE
    settings.eps_duality_gap_abs = _TOLERANCE
    settings.eps_duality_gap_rel = _TOLERANCE
    if not is_soft:
        settings.tau = _STEP_SHARE
    # Ruiz's iterations cost a fifth of a solve and make these small QPs no more accurate.
    settings.preconditioner_iter = 0
    settings.compute_timings = True
    has_rows = len(qp.matrix) > 0
    solver.setup(
        P=qp.hessian.T,  # symmetric, as above
        c=qp.gradient,
        G=np.asfortranarray(qp.matrix) if has_rows else None,
        h_l=qp.row_lower if has_rows else None,
        h_u=qp.row_upper if has_rows else None,
        x_l=qp.lower,
        x_u=qp.upper,
    )
    return solver


_SETTINGS: Final = MappingProxyType({"primal_tol": 1e-11, "dual_tol": 1e-12})


class DaqpSolver:
    """Each problem starts from an empty active set.

    Raises:
        MissingPackage: DAQP is not installed.
    """

    def __init__(self) -> None:
        try:
            from daqp import Model
        except ImportError:
            raise MissingPackage(
                "the QP solver DAQP is not installed; in the checkout: .venv/bin/pip install -e "
                "'./ttempc[baselines]', or set controller.options.solver to 'piqp'"
            ) from None
        self._new_model = Model
        self._model = None
        self._hessian = b""  # in the model, by its bytes
        self._matrix: FloatArray = np.empty((0, 0))  # of the rows in the model

    def solve(self, qp: QP, *, is_soft: bool) -> tuple[FloatArray, SolverReport]:
        """Return the minimiser (n,), or an arbitrary point, and DAQP's report."""
        lower = np.concatenate([qp.lower, qp.row_lower])
        upper = np.concatenate([qp.upper, qp.row_upper])
        # The rows of the inputs are one array for all ticks; soft rows are new ones at each tick.
        known = self._matrix
        self._matrix = qp.matrix
        if self._model is None or known.shape != qp.matrix.shape:
            self._model = self._new_model()
            self._hessian = b""
            rows = map(np.ascontiguousarray, (qp.hessian, qp.gradient, qp.matrix, upper, lower))
            flag, _ = self._model.setup(*rows)
            if flag < 0:
                return qp.gradient, self._report(flag, 0, 0.0)
            self._model.settings = dict(_SETTINGS)
        elif qp.matrix is not known:
            self._model.update(A=np.ascontiguousarray(qp.matrix))
        # Always apart from gradient and bounds, so that the time of it changes no bit of a result.
        if (content := qp.hessian.tobytes()) != self._hessian:
            self._model.update(H=np.ascontiguousarray(qp.hessian))
            self._hessian = content
        # Without `sense` it starts from the last active set, and the last bits of a result depend
        # on the problems before.
        empty = np.zeros(len(upper), dtype=np.intc)
        self._model.update(f=qp.gradient, bupper=upper, blower=lower, sense=empty)
        x, _, flag, info = self._model.solve()
        report = self._report(flag, info["iterations"], info["solve_time"])
        if is_soft and report.accepted:
            report = replace(report, status="solved with soft bounds")
        return np.asarray(x), report

    @staticmethod
    def _report(flag: int, iterations: int, solve_time_s: float) -> SolverReport:
        status = "solved" if flag > 0 else f"daqp exit flag {flag}"
        return SolverReport(status, flag > 0, iterations, solve_time_s, math.nan, math.nan)


# Violation of a bound above which a solution is rejected; below it is clamped.
_BOUND_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class QPSolution:
    """Accepted minimiser of a QP, if any, and the solver's report."""

    # (n,), with soft rows that are active or violated (n + r,), see `QP.hardened`; None where the
    # result was not accepted
    x: FloatArray | None
    report: SolverReport


_SOLVERS: Final = MappingProxyType({"piqp": PiqpSolver, "daqp": DaqpSolver})


class CheckedSolver:
    """A QP solver whose input is checked before, and whose result after a solve.

    A problem whose unconstrained minimiser is within all bounds needs no solver: it is answered by
    Cholesky's factorisation, with the status "closed form". Every other one is the solver's.

    PIQP 0.6 and 0.7 fail on bad input as follows: input that is not finite gives a solution that is
    not finite; an infeasible problem may end at the iteration limit with an arbitrary point; an
    indefinite Hessian counts as solved. Therefore the input is checked first, a solution is
    accepted only when it is solved, finite and within its bounds, and the solver is built anew
    after any failure.

    Raises:
        MissingPackage: the solver's package is not installed.
    """

    def __init__(self, solver: str = "piqp") -> None:
        self._name = solver
        self._solver = _SOLVERS[solver]()

    def __reduce__(self) -> tuple[type[CheckedSolver], tuple[str]]:
        return CheckedSolver, (self._name,)  # the solvers of the packages cannot be copied

    def solve(self, qp: QP) -> QPSolution:
        """Return the minimiser of `qp`, or the reason for which there is none."""
        x = np.empty_like(qp.gradient)
        factor = np.empty_like(qp.hessian)
        if not factorise(qp.hessian, factor):
            return self._failed(refused(NOT_CONVEX))
        if not minimise_unconstrained(factor, qp.gradient, x):
            return self._failed(refused(NOT_FINITE))
        outcome = check_rows(qp.matrix, qp.row_lower, qp.row_upper, x)
        if outcome == NOT_FINITE:
            return self._failed(refused(NOT_FINITE))
        if outcome == CLOSED_FORM and qp.soft is None and is_within(qp.lower, qp.upper, x):
            return QPSolution(x, CLOSED_FORM_REPORT)
        return self.solve_bounded(qp)

    def solve_bounded(self, qp: QP) -> QPSolution:
        """Return the same by the package's solver, for a problem that is finite and convex."""
        hard = qp.hardened()
        x, report = self._solver.solve(hard, is_soft=qp.soft is not None)
        if not report.accepted:
            return self._failed(report)
        if not hard.violation(x) <= _BOUND_TOLERANCE:  # also where x is not finite
            return self._failed(replace(report, status="solved outside its bounds", accepted=False))
        return QPSolution(x, report)

    def _failed(self, report: SolverReport) -> QPSolution:
        self._solver = _SOLVERS[self._name]()
        return QPSolution(None, report)
