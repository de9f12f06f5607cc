"""Linear MPC with a receding horizon over precomputed matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning, check_choice, check_count, check_vector
from ..jit import cached_njit
from ..models.kinematics import Error
from ..types import FloatArray, Input, Shared, SolverReport
from .qp import (
    FREE,
    HOLDS,
    MOST_SETS,
    NOT_CONVEX,
    QP,
    REFUSED,
    UNSOLVED,
    PersistentSolver,
    SoftRows,
    factorise,
    minimise,
)

Solver = Literal["piqp", "daqp"]
SOLVERS: Final = get_args(Solver)


@dataclass(frozen=True)
class HorizonTuning:
    """Horizon, weights and bounds of an MPC on a tracking error.

    The defaults are the paper's, eqs. (constraints), (costfunction) and below, with the hydrostat
    as a fraction. Weights are squared by the unit of their entry, [1/m^2] or [1/rad^2]. Bounds
    hold for u_e, the reference input less the actual one, in the order of `Input`.

    Raises:
        InvalidTuning: a horizon is not positive, a weight negative or a bound not positive.
    """

    outputs: ClassVar[int] = len(Error)  # entries of `output_weight`

    horizon: int = 8  # N_p, predicted periods
    moves: int = 3  # N_c, free input steps; the input is held afterwards
    output_weight: tuple[float, ...] = (1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0)  # diagonal of Q
    step_weight: tuple[float, ...] = (1.0, 1.0, 1.0)  # diagonal of R
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(12.0), math.radians(6.0), 0.10)
    # [rad/s], [rad/s], [1/s]
    input_rate: tuple[float, ...] = (math.radians(55.0), math.radians(35.0), 0.30)
    solver: Solver = "piqp"  # of the QP: an interior-point method, or "daqp", a dual active-set one

    def __post_init__(self) -> None:
        check_count("horizon", self.horizon)
        check_count("moves", self.moves, most=self.horizon)
        check_vector("output_weight", self.output_weight, self.outputs, zero=True)
        for name in ("step_weight", "input_bound", "input_rate"):
            check_vector(name, getattr(self, name), len(Input))
        check_choice("solver", self.solver, SOLVERS)


class StageBounds(NamedTuple):
    """Bounds on the input u_e of every tick and on its change from the previous one, (N, m)."""

    lower: FloatArray
    upper: FloatArray
    step_lower: FloatArray
    step_upper: FloatArray

    def at(self, *index: int | slice | NDArray[np.intp]) -> StageBounds:
        """Return the bounds at an index of the arrays."""
        return StageBounds(*(values[index] for values in self))

    @property
    def limits(self) -> FloatArray:
        """Return lower and upper bounds on inputs, then on their changes, (N, 2, 2 m)."""
        lower = np.concatenate([self.lower, self.step_lower], axis=-1)
        return np.stack([lower, np.concatenate([self.upper, self.step_upper], axis=-1)], axis=-2)

    def clamp(self, inputs: FloatArray) -> FloatArray:
        """Return the allowed first input nearest to `inputs` (m,), of the bounds of one tick."""
        first = slice(len(inputs))
        return np.minimum(np.maximum(inputs, self.lower[first]), self.upper[first])

    def clamp_previous(self, previous: FloatArray) -> FloatArray:
        """Return the input nearest to `previous` (m,) from which a step leads into the bounds.

        From an input beyond them, the QP of the tick is infeasible.
        """
        lower, upper, step_lower, step_upper = self.at(slice(len(previous)))
        return np.minimum(np.maximum(previous, lower - step_upper), upper - step_lower)


ENTERS: Final = 0.5
"""Cross-track error, or its damped one, from which the vehicle enters its line [m]; assumed."""
LEAVES: Final = 0.1
"""Both errors with which the entry ends [m]; assumed."""


@dataclass(frozen=True, slots=True)
class OutputBounds:
    """Bounds on r outputs of the state at N + 1 ticks; infinite: free.

    At stage j of a horizon, lower + spread_j <= S z <= upper - spread_j.
    """

    rows: FloatArray  # S (N + 1, r, n)
    lower: FloatArray  # (N + 1, r)
    upper: FloatArray  # (N + 1, r)
    spread: FloatArray  # (Np + 1, r)
    penalty: FloatArray  # of a violation, see `PENALTY`, (r,)

    def beside(self, other: OutputBounds | None) -> OutputBounds:
        """Return these bounds and those of `other`."""
        if other is None:
            return self
        pairs = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(self))
        return OutputBounds(
            *(np.concatenate(pair, axis=min(pair[0].ndim - 1, 1)) for pair in pairs)
        )


class Stages(NamedTuple):
    """Arrays of a `CondensedHorizon`: of the n entries of z the first r change over the horizon."""

    model: FloatArray  # rows of z(k+1) = A z + B u that change, (N, r, n + m)
    outputs: FloatArray  # C (N + 1, p, r)
    limits: FloatArray  # lower and upper bounds on inputs and steps, (ticks, 2, 2 m Nc)
    matrix: FloatArray  # from the steps to the inputs, (m Nc, m Nc)
    output_weight: FloatArray  # (p,)
    step_weight: FloatArray  # (m,)
    soft_rows: FloatArray  # S (N + 1, s, r) of the soft bounds; (0, 0, r) without them
    soft_limits: FloatArray  # (N + 1, 2, s)
    soft_spread: FloatArray  # taken off them at each stage, (Np + 1, s)
    soft_penalty: FloatArray  # (s,)
    damped: FloatArray  # rows of the cost in the place of C while an error is large; (0, p, n)


class Work(NamedTuple):
    """Arrays of one tick of a `CondensedHorizon`, and the set of bounds that were active last."""

    tick: FloatArray  # (2,) of Hessian, factor and response; -1: none; `entering` of them
    hessian: FloatArray  # (m Nc, m Nc)
    factor: FloatArray  # (m Nc, m Nc)
    response: FloatArray  # of z_{k+1} ... z_{k+Np} to the steps, (Np, r, m Nc)
    entering: FloatArray  # whether the cost has the damped rows (1,)
    given: FloatArray  # z_k, u_{k-1} (n + m,)
    free: FloatArray  # z_k ... z_{k+Np} with the input held, (Np + 1, r)
    gradient: FloatArray  # (m Nc,)
    limits: FloatArray  # on inputs and steps, less the input held, (2, 2 m Nc)
    active: FloatArray  # see `minimise`, (2 m Nc,)
    steps: FloatArray  # the minimiser (m Nc,)
    kept: FloatArray  # of a backup plan, see `ttempc.laws`: previous input and steps, (m + m Nc,)
    preview: FloatArray  # what z_{k+1} ... z_{k+Np} each gain beside the model, (Np, r)

    def beside(self) -> Work:
        """Return arrays of which the matrices alone are shared with these."""
        return Work(*self[:4], *(array.copy() for array in self[4:]))


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def condense(k: int, stages: Stages, work: Work) -> bool:
    """Write response, Hessian and its factor of tick `k`; whether the cost is finite and convex.

    Column i of the response is that to a step of the input i mod m at stage i / m, which lasts.
    """
    horizon, r, size = work.response.shape
    model, outputs = stages.model, stages.outputs
    weights, costs = stages.output_weight, stages.step_weight
    if work.entering[0] != 0.0:
        outputs = stages.damped
    response, hessian, row, m = work.response, work.hessian, np.empty(size), costs.size
    given = model.shape[2] - m
    for a in range(size):
        for b in range(a + 1):
            hessian[a, b] = 0.0
    for j in range(horizon):
        before, now = min(m * j, size), min(m * (j + 1), size)
        for i in range(r):
            for a in range(now):
                response[j, i, a] = model[k + j, i, given + a % m]
            for a in range(now, size):
                response[j, i, a] = 0.0
            for n in range(r):
                slope = model[k + j, i, n]
                if slope != 0.0:
                    for a in range(before):
                        response[j, i, a] += slope * response[j - 1, n, a]
        for p in range(weights.size):
            weight = weights[p]
            if weight == 0.0:
                continue
            for a in range(now):
                row[a] = 0.0
            for n in range(r):
                slope = outputs[k + j + 1, p, n]
                if slope != 0.0:
                    for a in range(now):
                        row[a] += slope * response[j, n, a]
            for a in range(now):
                weighted = 2.0 * weight * row[a]
                for b in range(a + 1):
                    hessian[a, b] += weighted * row[b]
    for a in range(size):
        hessian[a, a] += 2.0 * costs[a % m]
        for b in range(a):
            hessian[b, a] = hessian[a, b]
    convex = factorise(hessian, work.factor)
    work.tick[0], work.tick[1] = k if convex else -1.0, work.entering[0]
    return convex


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def pose(k: int, stages: Stages, work: Work) -> None:
    """Write free response, gradient and limits of tick `k` for `Work.given`, after `condense`.

    A previous input from which no step leads into the bounds is moved to the nearest other one
    first: the QP is infeasible there.
    """
    horizon, r, size = work.response.shape
    model, outputs = stages.model, stages.outputs
    limits, weights = stages.limits, stages.output_weight
    if work.entering[0] != 0.0:
        outputs = stages.damped
    given, free, gradient, left = work.given, work.free, work.gradient, work.limits
    m = stages.step_weight.size
    n = model.shape[2] - m
    for i in range(m):
        low = limits[k, 0, i] - limits[k, 1, size + i]
        high = limits[k, 1, i] - limits[k, 0, size + i]
        given[n + i] = min(max(given[n + i], low), high)
    for i in range(r):
        free[0, i] = given[i]
    for j in range(horizon):
        for i in range(r):
            total = work.preview[j, i]
            for c in range(n + m):
                total += model[k + j, i, c] * (free[j, c] if c < r else given[c])
            free[j + 1, i] = total
    slope, ahead = np.empty(r), np.empty(r)  # of the cost by the state of a stage
    lasting = np.empty(m)  # of the cost by an input that lasts from a stage on
    for i in range(r):
        slope[i] = 0.0
    for c in range(m):
        lasting[c] = 0.0
    for j in range(horizon - 1, -1, -1):
        for i in range(r):
            ahead[i], slope[i] = slope[i], 0.0
        for p in range(weights.size):
            error = 0.0
            for i in range(r):
                error += outputs[k + j + 1, p, i] * free[j + 1, i]
            for i in range(r, outputs.shape[2]):
                error += outputs[k + j + 1, p, i] * given[i]
            error *= 2.0 * weights[p]
            for i in range(r):
                ahead[i] += error * outputs[k + j + 1, p, i]
        for i in range(r):
            for c in range(r):
                slope[c] += model[k + j, i, c] * ahead[i]
            for c in range(m):
                lasting[c] += model[k + j, i, n + c] * ahead[i]
        if m * j < size:
            for c in range(m):
                gradient[m * j + c] = lasting[c]
    for side in range(2):
        for c in range(2 * size):
            left[side, c] = limits[k, side, c] - (given[n + c % m] if c < size else 0.0)
    for c in range(m):  # the first input and the first step are bounded alike
        both = size + c
        left[0, c] = left[0, both] = max(left[0, c], left[0, both])
        left[1, c] = left[1, both] = min(left[1, c], left[1, both])


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def are_slack(k: int, stages: Stages, work: Work) -> bool:
    """Whether the steps of tick `k` keep to all soft bounds."""
    horizon, r, size = work.response.shape
    rows, limits, spread = stages.soft_rows, stages.soft_limits, stages.soft_spread
    state = np.empty(r)
    for j in range(1, horizon + 1):
        for i in range(r):
            state[i] = math.nan
        for p in range(rows.shape[1]):
            value = 0.0
            for i in range(r):
                if rows[k + j, p, i] == 0.0:
                    continue
                if math.isnan(state[i]):
                    state[i] = work.free[j, i]
                    for a in range(size):
                        state[i] += work.response[j - 1, i, a] * work.steps[a]
                value += rows[k + j, p, i] * state[i]
            low, high = limits[k + j, 0, p] + spread[j, p], limits[k + j, 1, p] - spread[j, p]
            if not low - HOLDS <= value <= high + HOLDS:
                return False
    return True


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def enter(k: int, stages: Stages, work: Work) -> None:
    """Write whether the vehicle enters its line at tick `k` into `Work.entering`."""
    damped, outputs, given, largest = stages.damped, stages.outputs, work.given, 0.0
    for p in range(damped.shape[1] if damped.shape[0] else 0):
        value = rate = 0.0
        for i in range(damped.shape[2]):
            now = outputs[k, p, i] if i < outputs.shape[2] else 0.0
            value += now * given[i]
            rate += (damped[k, p, i] - now) * given[i]
        if rate != 0.0:  # of an output that is damped
            largest = max(largest, abs(value), abs(value + rate))
    work.entering[0] = 1.0 if largest > (LEAVES if work.entering[0] != 0.0 else ENTERS) else 0.0


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def plan(k: int, stages: Stages, work: Work, most: int) -> int:
    """Write the steps of tick `k` for `Work.given`; return the outcome as `minimise`.

    Below 0 `LinearMpc.answer` is to complete them; so it is where a soft bound would be violated.
    """
    enter(k, stages, work)
    known = work.tick[0] == k and work.tick[1] == work.entering[0]
    if not known and not condense(k, stages, work):
        return NOT_CONVEX
    pose(k, stages, work)
    _, hessian, factor, _, _, _, _, gradient, limits, active, steps, _, _ = work
    outcome = minimise(hessian, factor, gradient, stages.matrix, limits, active, most, steps)
    if outcome >= 0 and len(stages.soft_rows) and not are_slack(k, stages, work):
        return UNSOLVED
    return outcome


class CondensedHorizon(Shared):
    """QPs of all ticks along a reference; only the state and the previous input are left open.

    The unknowns are the input steps Delta U = (Delta u_k ... Delta u_{k+Nc-1}). The states of the
    horizon are linear in z_k, u_{k-1} and the steps,

        z_{k+j+1} = A_{k+j} z_{k+j} + B_{k+j} u_{k+j},    u_{k+j} = u_{k+j-1} + Delta u_{k+j},

    without a step after the last free one. The cost of eq. (costfunction), sum y'Qy +
    sum Delta u' R Delta u with y_k = C_k z_k, is then quadratic in the steps. Bounds hold for the
    stages with a free step. All ticks are checked at once; the matrices of a tick are computed when
    it comes (`condense`).

    Args:
        a: A (N, n, n), with `b` B (N, n, m); entries of z after the r-th are constant: the first r
            rows of both are enough.
        outputs: C (N + 1, p, n), of the entries up to the r-th; without them, the outputs are the
            states.
        bounds: (N, m) each, in addition to those of the tuning.
        free_bounds: on the free stages of every tick, (ticks, m Nc) each, in the place of those of
            the tuning and `bounds`.
        damped: what the cost weighs in the place of the outputs (N + 1, p, n), from an error of
            `ENTERS` on until both it and the output are within `LEAVES`.
        soft: bounds on outputs of the states z_{k+1} ... z_{k+Np}, kept as far as possible.

    Raises:
        InvalidTuning: shapes do not fit, or the cost of a tick is not finite and convex.
    """

    def __init__(
        self,
        a: FloatArray,
        b: FloatArray,
        tuning: HorizonTuning,
        period_s: float,
        outputs: FloatArray | None = None,
        bounds: StageBounds | None = None,
        free_bounds: StageBounds | None = None,
        soft: OutputBounds | None = None,
        damped: FloatArray | None = None,
    ) -> None:
        n, m = a.shape[2], b.shape[2]
        c = np.broadcast_to(np.eye(n), (len(a) + 1, n, n)) if outputs is None else outputs
        horizon, moves, p = tuning.horizon, tuning.moves, c.shape[1]
        self.ticks, self.solver, self.horizon = len(a) - horizon + 1, tuning.solver, horizon
        if self.ticks < 1 or len(tuning.output_weight) != p or len(tuning.step_weight) != m:
            raise InvalidTuning(
                f"{len(a)} stages of {p} outputs and {m} inputs do not fit a horizon of {horizon}, "
                f"{len(tuning.output_weight)} output and {len(tuning.step_weight)} step weights"
            )
        changes = (a != np.eye(*a.shape[1:])).any(axis=(0, 2)) | b.any(axis=(0, 2))
        r = int(np.flatnonzero(changes).max(initial=0)) + 1
        bounds = free_bounds or move_bounds(tuning, period_s, len(a), bounds)
        none = np.zeros((0, 0, r))
        self.stages = Stages(
            model=np.concatenate([a[:, :r], b[:, :r]], axis=2),
            outputs=np.ascontiguousarray(c[..., :r]),
            limits=bounds.limits,
            matrix=np.kron(np.tril(np.ones((moves, moves))), np.eye(m)).astype(np.float64),
            output_weight=np.array(tuning.output_weight),
            step_weight=np.array(tuning.step_weight),
            soft_rows=np.ascontiguousarray(soft.rows[..., :r]) if soft else none,
            soft_limits=np.stack([soft.lower, soft.upper], axis=1) if soft else none,
            soft_spread=soft.spread if soft else np.zeros((0, 0)),
            soft_penalty=soft.penalty if soft else np.zeros(0),
            damped=np.zeros((0, p, n)) if damped is None else np.ascontiguousarray(damped),
        )
        work = self.work()
        finite = np.isfinite(self.stages.model).all() and np.isfinite(c).all()
        if not (finite and all(condense(k, self.stages, work) for k in range(self.ticks))):
            raise InvalidTuning("the cost is not finite and convex all along the reference")

    def work(self) -> Work:
        """Return arrays of no tick."""
        stages, size = self.stages, len(self.stages.matrix)
        _, r, given = stages.model.shape
        return Work(
            tick=np.full(2, -1.0),
            entering=np.zeros(1),
            hessian=np.zeros((size, size)),
            factor=np.zeros((size, size)),
            response=np.zeros((self.horizon, r, size)),
            given=np.zeros(given),
            free=np.zeros((self.horizon + 1, r)),
            gradient=np.zeros(size),
            limits=np.zeros((2, 2 * size)),
            active=np.zeros(2 * size),
            steps=np.zeros(size),
            kept=np.zeros(len(stages.step_weight) + size),
            preview=np.zeros((self.horizon, r)),
        )

    def problem(self, k: int, work: Work) -> QP:
        """Return the QP of tick `k` that `plan` has left in `work`."""
        rows = self._soft_rows(k, work)
        return QP(work.hessian, work.gradient, self.stages.matrix, work.limits, rows)

    def _soft_rows(self, k: int, work: Work) -> SoftRows | None:
        """Return the soft rows of tick `k`, None where no bound of its stages is finite."""
        ahead = slice(k + 1, k + 1 + self.horizon)
        rows, limits = self.stages.soft_rows[ahead], self.stages.soft_limits[ahead]
        if not np.isfinite(limits).any():
            return None
        spread, offset = self.stages.soft_spread[1:], (rows @ work.free[1:, :, None]).ravel()
        return SoftRows(
            matrix=(rows @ work.response).reshape(len(offset), -1),
            lower=np.maximum((limits[:, 0] + spread).ravel(), -FREE) - offset,
            upper=np.minimum((limits[:, 1] - spread).ravel(), FREE) - offset,
            penalty=self.stages.soft_penalty,
        )


def move_bounds(
    tuning: HorizonTuning, period_s: float, stages: int, bounds: StageBounds | None = None
) -> StageBounds:
    """Return the bounds on the free stages of every tick, concatenated, (ticks, m Nc).

    They are those of the tuning, intersected with `bounds` (`stages`, m) if given.
    """
    ticks = stages - tuning.horizon + 1
    free = np.arange(ticks)[:, None] + np.arange(tuning.moves)  # (ticks, Nc)
    of_stages = stage_bounds(tuning, period_s, stages, bounds)
    return StageBounds(*(values[free].reshape(ticks, -1) for values in of_stages))


def stage_bounds(
    tuning: HorizonTuning, period_s: float, stages: int, bounds: StageBounds | None = None
) -> StageBounds:
    """Return the tuning's bounds on every stage, intersected with `bounds` if given."""
    bound = np.tile(tuning.input_bound, (stages, 1))
    step = np.tile(tuning.input_rate, (stages, 1)) * period_s
    if bounds is None:
        return StageBounds(-bound, bound, -step, step)
    return StageBounds(
        lower=np.maximum(-bound, bounds.lower),
        upper=np.minimum(bound, bounds.upper),
        step_lower=np.maximum(-step, bounds.step_lower),
        step_upper=np.minimum(step, bounds.step_upper),
    )


class LinearMpc:
    """Receding horizon: solve the QP of a tick and apply its first step.

    Where the QP has no accepted solution, the previous input is held. A result depends on earlier
    ones in the last digits alone: of the set of bounds with which `minimise` starts, and of a
    solver's iterates. `most` is that of `minimise`.
    """

    def __init__(self, horizon: CondensedHorizon, most: int = MOST_SETS) -> None:
        self.horizon, self.most = horizon, most
        self.work = horizon.work()
        self.beside = self.work.beside()
        self._solver = PersistentSolver(horizon.solver)

    def step(
        self, k: int, state: FloatArray, previous: FloatArray
    ) -> tuple[FloatArray, SolverReport]:
        """Return u_b = u_e* of eq. (ue), inside its bounds, for z_k (n,) and u_{k-1} (m,)."""
        work, stages, m = self.work, self.horizon.stages, len(previous)
        work.given[:-m], work.given[-m:] = state, previous
        report, _ = self.answer(k, plan(k, stages, work, self.most))
        lower, upper = stages.limits[k, :, :m]
        return np.minimum(np.maximum(work.given[-m:] + work.steps[:m], lower), upper), report

    def answer(self, k: int, outcome: int) -> tuple[SolverReport, FloatArray | None]:
        """Complete `Work.steps` after the `outcome` of `plan`: by the solver, or with zeros.

        Returns:
            report, and the violation of the soft bounds (s,), None where there is none.
        """
        if outcome >= 0:
            return SolverReport("solved", True, outcome, 0.0, 0.0, 0.0), None
        steps, size = self.work.steps, len(self.work.steps)
        if outcome == UNSOLVED:
            solution = self._solver.solve_bounded(self.horizon.problem(k, self.work))
            if (x := solution.x) is not None:
                np.clip(x[:size], *self.work.limits[:, size:], out=steps)
                return solution.report, x[size:] if len(x) > size else None
            report = solution.report
        else:
            report = SolverReport(REFUSED[outcome], False, 0, 0.0, math.inf, math.inf)
        steps[:] = 0.0
        return report, None

    def prepare(self, k: int) -> None:
        """Condense tick `k` and plan it for the data of the last step, to fill the caches."""
        self.beside.given[:], self.beside.entering[:] = self.work.given, self.work.entering
        plan(k, self.horizon.stages, self.beside, self.most)
