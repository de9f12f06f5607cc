"""Quadratic programme, with soft rows under an exact penalty."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
import piqp

from ..errors import MissingPackage
from ..jit import cached_njit
from ..types import FloatArray, SolverReport

# Of a slack s: cost PENALTY s + PENALTY s^2 / 2. The penalty is exact, that is the slack is 0 where
# the hard problem has a solution, if it exceeds the sum of that problem's multipliers of the output
# (Kerrigan and Maciejowski 2000). Assumed: not proven to be exact. With 1 the slack exceeds 1 mm
# three times as often on `rows`; with 1000 noise of the estimate saturates the steering.
PENALTY: Final = 10.0
FREE: Final = 1e3
"""Bound in the place of an infinite one: of rows without a bound PIQP drops the coefficients."""
HOLDS: Final = 1e-9  # violation that counts as none


@dataclass(frozen=True, slots=True)
class SoftRows:
    """Soft constraints of one QP: lower - s_j <= G x <= upper + s_j, for j = row modulo r.

    The rows are those of r outputs at one stage after the other. Each output has one slack s_j,
    its largest violation along the horizon.
    """

    matrix: FloatArray  # G (Np r, n)
    lower: FloatArray  # (Np r,)
    upper: FloatArray  # (Np r,)
    outputs: int  # r


@dataclass(frozen=True, slots=True)
class QP:
    """Minimise 1/2 x'Hx + g'x within lower and upper bounds on (G x, x)."""

    hessian: FloatArray  # H (n, n)
    gradient: FloatArray  # g (n,)
    matrix: FloatArray  # G (m, n)
    limits: FloatArray  # lower and upper bounds, (2, m + n)
    soft: SoftRows | None = None  # further rows, which only `hardened` takes into account

    def hardened(self) -> QP:
        """Return the problem in (x, s) with the slacks s of its soft rows, whose bounds are hard.

        Without soft rows it is this problem.
        """
        soft = self.soft
        if soft is None:
            return self
        m, n, r = *self.matrix.shape, soft.outputs
        hessian = PENALTY * np.eye(n + r)
        hessian[:n, :n] = self.hessian
        slack = np.tile(np.eye(r), (len(soft.lower) // r, 1))  # to the rows, (Np r, r)
        rows = [self.matrix, np.zeros((m, r))], [soft.matrix, -slack], [-soft.matrix, -slack]
        upper = np.concatenate([soft.upper, -soft.lower])
        of_rows = [np.full_like(upper, -np.inf), upper]
        parts = self.limits[:, :m], of_rows, self.limits[:, m:], np.outer([0.0, np.inf], np.ones(r))
        gradient = np.concatenate([self.gradient, np.full(r, PENALTY)])
        return QP(hessian, gradient, np.block([*rows]), np.concatenate(parts, axis=1))

    def objective(self, x: FloatArray) -> float:
        """Return the cost at `x` (n,)."""
        return float(0.5 * x @ self.hessian @ x + self.gradient @ x)

    def slack(self, x: FloatArray) -> FloatArray:
        """Return the distances of `x` (n,) to its bounds, negative beyond one, (2, m + n)."""
        values = np.concatenate([self.matrix @ x, x])
        return np.stack([values - self.limits[0], self.limits[1] - values])


NOT_FINITE: Final = -1  # an entry of the gradient or of a bound on the rows
NOT_CONVEX: Final = -2  # Hessian not positive definite, or not finite
UNSOLVED: Final = -3  # no set of active bounds was found
MOST_SETS: Final = 6
"""Sets of active bounds that `minimise` tries: it is faster than PIQP up to there."""
_ON_BOUND: Final = 1e-10  # violation of a bound, in its unit, that counts as none
_STATIONARY: Final = 1e-9  # residual and wrong multipliers allowed, relative to the gradient
REFUSED: Final = MappingProxyType(
    {NOT_FINITE: "input not finite", NOT_CONVEX: "hessian not convex"}
)
_DEPENDENT: Final = 1e-10  # share of a row that others leave, below which it depends on them


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
def minimise(
    hessian: FloatArray,
    factor: FloatArray,
    gradient: FloatArray,
    matrix: FloatArray,
    limits: FloatArray,
    active: FloatArray,
    most: int,
    x: FloatArray,
) -> int:
    """Write the minimiser of a `QP` into `x` (n,); return the sets of active bounds tried.

    It is 0 where the unconstrained minimiser is within all bounds. Otherwise a primal-dual active
    set method (Hintermueller, Ito and Kunisch 2002) starts from the set of the last problem, and at
    most `most` sets are tried. An answer satisfies its conditions of optimality: bounds and signs
    of multipliers, and the gradient of the Lagrangian. Below 0 there is none: `NOT_FINITE`,
    `UNSOLVED`; with `most` below 0 every problem is left unsolved.

    Args:
        factor: of the Hessian, by `factorise`.
        limits: lower and upper bounds, (2, m + n): of the m rows of the matrix, then of x.
        active: -1 on a lower bound, 1 on an upper one, else 0, (m + n,); of the last problem.
    """
    n, rows = gradient.size, matrix.shape[0]
    scale = 1.0
    for i in range(n):
        scale = max(scale, abs(gradient[i]))
        if not math.isfinite(gradient[i]):
            return NOT_FINITE
    for c in range(rows):
        if not (math.isfinite(limits[0, c]) and math.isfinite(limits[1, c])):
            return NOT_FINITE
    if most < 0:
        return UNSOLVED
    free, right = np.empty(n), np.empty(n)
    for i in range(n):
        rest = -gradient[i]
        for k in range(i):
            rest -= factor[i, k] * right[k]
        right[i] = rest / factor[i, i]
    size, started = rows + n, False
    multiplier, shifted, of_rows = np.empty(size), np.empty((n, n)), np.empty((n, n))
    chosen = np.empty(n, np.int64)
    for c in range(size):
        started |= active[c] != 0.0
        multiplier[c] = 0.0
    for tried in range(most + 1):
        count = 0
        if tried > 0:  # multipliers of the active rows: (V'V) y = excess, V = L^-1 G'
            for c in range(size):
                multiplier[c] = 0.0
                if active[c] == 0.0:
                    continue
                if count == n:
                    return UNSOLVED
                bound = limits[0, c] if active[c] < 0.0 else limits[1, c]
                excess, square = -bound, 0.0
                for i in range(n):
                    entry = 1.0 if c - rows == i else 0.0
                    if c < rows:
                        entry = matrix[c, i]
                    excess += entry * free[i]
                    for k in range(i):
                        entry -= factor[i, k] * shifted[count, k]
                    shifted[count, i] = entry / factor[i, i]
                    square += shifted[count, i] * shifted[count, i]
                whole = square
                for j in range(count):
                    rest = 0.0
                    for i in range(n):
                        rest += shifted[count, i] * shifted[j, i]
                    for k in range(j):
                        rest -= of_rows[count, k] * of_rows[j, k]
                    of_rows[count, j] = rest / of_rows[j, j]
                    square -= of_rows[count, j] * of_rows[count, j]
                    excess -= of_rows[count, j] * multiplier[chosen[j]]
                if square <= _DEPENDENT * whole:
                    active[c] = 0.0
                    continue
                of_rows[count, count] = math.sqrt(square)
                multiplier[c] = excess / of_rows[count, count]
                chosen[count] = c
                count += 1
            for j in range(count - 1, -1, -1):
                for k in range(j + 1, count):
                    multiplier[chosen[j]] -= of_rows[k, j] * multiplier[chosen[k]]
                multiplier[chosen[j]] /= of_rows[j, j]
        for i in range(n - 1, -1, -1):
            rest = right[i]
            for j in range(count):
                rest -= multiplier[chosen[j]] * shifted[j, i]
            for k in range(i + 1, n):
                rest -= factor[k, i] * x[k]
            x[i] = rest / factor[i, i]
        holds, allowed = True, _ON_BOUND if tried > 0 else 0.0
        for c in range(size):
            value = 0.0
            if c < rows:
                for i in range(n):
                    value += matrix[c, i] * x[i]
            else:
                value = x[c - rows]
            lower, upper, now = limits[0, c] - allowed, limits[1, c] + allowed, active[c]
            inside = lower <= value <= upper
            if tried == 0:
                holds &= inside
                if not (started or inside):
                    active[c] = 1.0 if value > upper else -1.0
                continue
            if now != 0.0:
                if now * multiplier[c] < -_STATIONARY * scale:
                    now = 0.0
            elif not inside:
                now = 1.0 if value > upper else -1.0
            holds &= inside and now == active[c]
            active[c] = now
        if tried == 0:
            if holds:
                for c in range(size):
                    active[c] = 0.0
                return 0
            for i in range(n):
                free[i] = x[i]
            continue
        if holds:
            for i in range(n):
                rest = gradient[i]
                for k in range(n):
                    rest += hessian[i, k] * x[k]
                for j in range(count):
                    c = chosen[j]
                    if c < rows:
                        rest += matrix[c, i] * multiplier[c]
                    elif c - rows == i:
                        rest += multiplier[c]
                if not abs(rest) <= _STATIONARY * scale:
                    return UNSOLVED
            for i in range(n):
                x[i] = min(max(x[i], limits[0, rows + i]), limits[1, rows + i])
            return tried
    for c in range(size):
        active[c] = 0.0
    return UNSOLVED


# PIQP's default of 1e-8 leaves errors of 1e-5 in the first move where bounds are weakly active.
_TOLERANCE = 1e-12


class PiqpSolver:
    """Each problem starts from PIQP's own initial point."""

    def __init__(self) -> None:
        self._solver: piqp.DenseSolver | None = None
        self._matrix: FloatArray = np.empty((0, 0))  # of the rows in the solver

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
        # The rows of the inputs are one array for all ticks; soft rows are new ones at each tick.
        known, self._matrix = self._matrix, qp.matrix
        fits = self._solver is not None and known.shape == qp.matrix.shape
        m, (lower, upper) = len(qp.matrix), qp.limits
        problem = {
            "P": qp.hessian.T,  # symmetric; the transpose has the column order of PIQP
            "c": qp.gradient,
            "G": None if fits and qp.matrix is known else np.asfortranarray(qp.matrix),
            "h_l": lower[:m],
            "h_u": upper[:m],
            "x_l": lower[m:],
            "x_u": upper[m:],
        }
        if self._solver is not None and fits:
            self._solver.update(**problem)
            return self._solver
        solver = piqp.DenseSolver()
        settings = solver.settings
        settings.eps_abs = settings.eps_rel = _TOLERANCE
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = _TOLERANCE
        # Ruiz's iterations cost a fifth of a solve and make these small QPs no more accurate.
        settings.preconditioner_iter = 0
        settings.compute_timings = True
        solver.setup(**problem)
        self._solver = solver
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
                "the QP solver DAQP is not installed: pip install 'ttempc[baselines]', or set "
                "controller.options.solver to 'piqp'"
            ) from None
        self._new_model, self._model = Model, None
        self._held = b""  # the Hessian in the model, by its bytes
        self._matrix: FloatArray = np.empty((0, 0))  # of the rows in the model

    def solve(self, qp: QP) -> tuple[FloatArray, SolverReport]:
        """Return the minimiser (n,), or an arbitrary point, and DAQP's report."""
        lower, upper = np.roll(qp.limits, len(qp.gradient), axis=1)  # those of x come first
        # The rows of the inputs are one array for all ticks; soft rows are new ones at each tick.
        known, self._matrix = self._matrix, qp.matrix
        if self._model is None or known.shape != qp.matrix.shape:
            self._model, self._held = self._new_model(), b""
            rows = map(np.ascontiguousarray, (qp.hessian, qp.gradient, qp.matrix, upper, lower))
            flag, _ = self._model.setup(*rows)
            if flag < 0:
                return qp.gradient, self._report(flag, 0, 0.0)
            self._model.settings = dict(_SETTINGS)
        elif qp.matrix is not known:
            self._model.update(A=np.ascontiguousarray(qp.matrix))
        # Always apart from gradient and bounds, so that the time of it changes no bit of a result.
        if (content := qp.hessian.tobytes()) != self._held:
            self._model.update(H=np.ascontiguousarray(qp.hessian))
            self._held = content
        # Without `sense` it starts from the last active set, and the last bits of a result depend
        # on the problems before.
        empty = np.zeros(len(upper), dtype=np.intc)
        self._model.update(f=qp.gradient, bupper=upper, blower=lower, sense=empty)
        x, _, flag, info = self._model.solve()
        return np.asarray(x), self._report(flag, info["iterations"], info["solve_time"])

    @staticmethod
    def _report(flag: int, iterations: int, solve_time_s: float) -> SolverReport:
        status = "solved" if flag > 0 else f"daqp exit flag {flag}"
        return SolverReport(status, flag > 0, iterations, solve_time_s, math.nan, math.nan)


# Violation of a bound above which a solution is rejected; below it is clamped.
_BOUND_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class QPSolution:
    """Accepted minimiser of a QP, if any, and the solver's report."""

    # (n,), with soft rows that are active or violated (n + r,), see `QP.hardened`; None where the
    # result was not accepted
    x: FloatArray | None
    report: SolverReport


_SOLVERS: Final = MappingProxyType({"piqp": PiqpSolver, "daqp": DaqpSolver})


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

    Raises:
        MissingPackage: the solver's package is not installed.
    """

    def __init__(self, solver: str = "piqp") -> None:
        self._name = solver
        self._solver = _SOLVERS[solver]()

    def __reduce__(self) -> tuple[type[PersistentSolver], tuple[str]]:
        return PersistentSolver, (self._name,)  # the solvers of the packages cannot be copied

    def solve(self, qp: QP) -> QPSolution:
        """Return the minimiser of `qp`, or the reason for which there is none."""
        x, factor = np.empty_like(qp.gradient), np.empty_like(qp.hessian)
        outcome = NOT_CONVEX
        if factorise(qp.hessian, factor):
            active = np.zeros(qp.limits.shape[1])
            outcome = minimise(qp.hessian, factor, qp.gradient, qp.matrix, qp.limits, active, 0, x)
        if outcome == 0 and qp.soft is None:
            return QPSolution(x, SolverReport("solved", True, 0, 0.0, 0.0, 0.0))
        if outcome in (NOT_FINITE, NOT_CONVEX):
            return self._failed(SolverReport(REFUSED[outcome], False, 0, 0.0, math.inf, math.inf))
        return self.solve_bounded(qp)

    def solve_bounded(self, qp: QP) -> QPSolution:
        """Return the same by the package's solver, for a problem that is finite and convex."""
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
