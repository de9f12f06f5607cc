"""Linear MPC with a receding horizon over precomputed matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Final, Literal, get_args

import numpy as np

from ..errors import InvalidTuning, check_choice, check_count, check_vector
from ..models.kinematics import Error
from ..types import FloatArray, Immutable, Input, SolverReport
from .condensing import (
    FreeInputs,
    FreeSteps,
    StageBounds,
    Stages,
    Work,
    condense,
    keeps_soft_bounds,
    solve_in_closed_form,
)
from .qp import (
    CLOSED_FORM,
    CLOSED_FORM_REPORT,
    QP,
    REFUSED,
    SOFT_BOUND_ACTIVE,
    CheckedSolver,
    SoftRows,
    refused,
)

_LOOKED_AT_S: Final = 0.2  # between the ticks whose cost is examined before the start

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

    @classmethod
    def none(cls, n: int) -> OutputBounds:
        """Return no bounds, for a state of n entries."""
        empty = np.zeros((0, 0))
        return cls(np.zeros((0, 0, n)), empty, empty, empty, np.zeros(0))

    def beside(self, other: OutputBounds | None) -> OutputBounds:
        """Return these bounds and those of `other`."""
        if other is None:
            return self
        pairs = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(self))
        return OutputBounds(
            *(np.concatenate(pair, axis=min(pair[0].ndim - 1, 1)) for pair in pairs)
        )


class CondensedHorizon(Immutable):
    """QPs of all ticks along a reference; only the state and the previous input are left open.

    The unknowns are the input steps Delta U = (Delta u_k ... Delta u_{k+Nc-1}). The states of the
    horizon are linear in z_k, u_{k-1} and the steps,

        z_{k+j+1} = A_{k+j} z_{k+j} + B_{k+j} u_{k+j},    u_{k+j} = u_{k+j-1} + Delta u_{k+j},

    without a step at stages that have no free one. The cost of eq. (costfunction), sum y'Qy +
    sum Delta u' R Delta u with y_k = C_k z_k, is then quadratic in the steps. Bounds hold for the
    stages with a free step. All ticks are checked at once; the matrices of a tick are computed when
    it comes (`condense`).

    Args:
        a: A (N, n, n), with `b` B (N, n, m); entries of z after the r-th are constant: the first r
            rows of both are enough.
        outputs: C (N + 1, p, n), of the entries up to the r-th; without them, the outputs are the
            states.
        free: the free steps and their bounds, see `move_bounds`; without them a step at each of the
            first stages, with the bounds of the tuning. A step that stands for several periods
            weighs as the ramp of as many steps.
        damped: what the cost weighs instead of the outputs (N + 1, p, n) while the vehicle acquires
            its line: from an error of `ACQUISITION_BEGINS_M` on until both it and the output are
            within `ACQUISITION_ENDS_M`.
        soft: bounds on outputs of the states z_{k+1} ... z_{k+Np}, kept as far as possible.
        weight_factors: of the weights of the outputs at every tick (N + 1, p); without them 1.

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
        free: FreeInputs | None = None,
        soft: OutputBounds | None = None,
        damped: FloatArray | None = None,
        weight_factors: FloatArray | None = None,
    ) -> None:
        if outputs is None:
            outputs = np.broadcast_to(np.eye(a.shape[2]), (len(a) + 1, *a.shape[1:]))
        self.solver = tuning.solver
        self.horizon = tuning.horizon
        self.ticks = len(a) - tuning.horizon + 1
        _check_sizes(self.ticks, len(a), outputs.shape[1], b.shape[2], tuning)

        r = _changing_entries(a, b)
        m = b.shape[2]
        if free is None:
            bounds = move_bounds(tuning, period_s, len(a))
            free = FreeInputs(FreeSteps.single(tuning.moves), bounds)
        first = free.steps.stages
        sums = np.kron(np.tril(np.ones((len(first), len(first)))), np.eye(m))
        soft = soft or OutputBounds.none(a.shape[2])
        if damped is None:
            damped = np.zeros((0, *outputs.shape[1:]))
        weights = np.tile(np.array(tuning.output_weight), (len(outputs), 1))
        if weight_factors is not None:
            weights *= weight_factors
        self.stages = Stages(
            a=np.ascontiguousarray(a[:, :r]),
            b=np.ascontiguousarray(b[:, :r]),
            outputs=np.ascontiguousarray(outputs[..., :r]),
            bounds=StageBounds(*map(np.ascontiguousarray, free.bounds)),
            columns=m * np.searchsorted(first, np.arange(self.horizon), side="right"),
            matrix=sums[m:].astype(np.float64),
            output_weight=weights,
            step_weight=np.outer(1.0 / free.steps.periods, tuning.step_weight).ravel(),
            soft_rows=np.ascontiguousarray(soft.rows[..., :r]),
            soft_lower=soft.lower,
            soft_upper=soft.upper,
            soft_spread=soft.spread,
            soft_penalty=soft.penalty,
            acquisition_outputs=np.ascontiguousarray(damped),
        )
        work = self.work()
        arrays = (self.stages.a, self.stages.b, outputs)
        is_finite = all(np.isfinite(array).all() for array in arrays)
        # As often as at the period of the paper: to condense a tick takes 15 ms at 100 Hz.
        looked_at = range(0, self.ticks, max(1, round(_LOOKED_AT_S / period_s)))
        if not (is_finite and all(condense(k, self.stages, work) for k in looked_at)):
            raise InvalidTuning("the cost is not finite and convex all along the reference")

    def work(self) -> Work:
        """Return arrays of no tick."""
        stages = self.stages
        rows, size = stages.matrix.shape
        _, r, n = stages.a.shape
        m = stages.b.shape[2]
        return Work(
            tick=np.full(1, -1.0),
            condensed_acquiring=np.zeros(1),
            hessian=np.zeros((size, size)),
            factor=np.zeros((size, size)),
            response=np.zeros((self.horizon, r, size)),
            acquiring=np.zeros(1),
            state=np.zeros(n),
            previous=np.zeros(m),
            preview=np.zeros((self.horizon, r)),
            free=np.zeros((self.horizon + 1, r)),
            gradient=np.zeros(size),
            row_lower=np.zeros(rows),
            row_upper=np.zeros(rows),
            step_lower=np.zeros(size),
            step_upper=np.zeros(size),
            steps=np.zeros(size),
            backup_previous=np.zeros(m),
            backup_steps=np.zeros(size),
        )

    def problem(self, work: Work) -> QP:
        """Return the QP without soft rows, whose arrays are those of `work`."""
        return QP(
            hessian=work.hessian,
            gradient=work.gradient,
            matrix=self.stages.matrix,
            row_lower=work.row_lower,
            row_upper=work.row_upper,
            lower=work.step_lower,
            upper=work.step_upper,
        )

    def softened_problem(self, k: int, work: Work) -> QP:
        """Return the QP of tick `k` with the soft rows of its stages."""
        stages = self.stages
        ahead = slice(k + 1, k + 1 + self.horizon)
        rows = stages.soft_rows[ahead]  # (Np, s, r)
        spread = stages.soft_spread[1:]  # (Np, s)
        offset = (rows @ work.free[1:, :, None])[..., 0]  # of the outputs at Delta U = 0
        soft = SoftRows(
            matrix=(rows @ work.response).reshape(offset.size, -1),
            lower=(stages.soft_lower[ahead] + spread - offset).ravel(),
            upper=(stages.soft_upper[ahead] - spread - offset).ravel(),
            penalty=stages.soft_penalty,
        )
        return replace(self.problem(work), soft=soft)


def _check_sizes(ticks: int, stages: int, outputs: int, inputs: int, tuning: HorizonTuning) -> None:
    """Refuse a horizon longer than the reference, and weights of other lengths.

    Raises:
        InvalidTuning: with the lengths.
    """
    fits = len(tuning.output_weight) == outputs and len(tuning.step_weight) == inputs
    if ticks < 1 or not fits:
        raise InvalidTuning(
            f"{stages} stages of {outputs} outputs and {inputs} inputs do not fit a horizon of "
            f"{tuning.horizon}, {len(tuning.output_weight)} output and {len(tuning.step_weight)} "
            "step weights"
        )


def _changing_entries(a: FloatArray, b: FloatArray) -> int:
    """Return the number r of the first entries of the state, after which all are constant."""
    changes = (a != np.eye(*a.shape[1:])).any(axis=(0, 2)) | b.any(axis=(0, 2))
    return int(np.flatnonzero(changes).max(initial=0)) + 1


def move_bounds(
    tuning: HorizonTuning,
    period_s: float,
    stages: int,
    bounds: StageBounds | None = None,
    steps: FreeSteps | None = None,
) -> StageBounds:
    """Return the bounds on the free stages of every tick, concatenated, (ticks, m Nc).

    They are those of the tuning, intersected with `bounds` (`stages`, m) if given; a step for
    several periods has their sum. Without `steps`, the first stages are free.
    """
    steps = steps or FreeSteps.single(tuning.moves)
    ticks = stages - tuning.horizon + 1
    free = np.arange(ticks)[:, None] + steps.stages  # (ticks, Nc)
    of_stages = stage_bounds(tuning, period_s, stages, bounds)
    lower, upper, step_lower, step_upper = (values[free] for values in of_stages)
    periods = steps.periods[:, None]
    of_steps = (lower, upper, step_lower * periods, step_upper * periods)
    return StageBounds(*(values.reshape(ticks, -1) for values in of_steps))


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

    Where the unconstrained minimiser is within all bounds it is the solution. Every other QP is the
    solver's. Where that has no accepted solution, the previous input is held. A result depends on
    its tick, state and previous input alone.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self.horizon = horizon
        self.work = horizon.work()
        self.preparing = self.work.with_shared_matrices()
        self._problem = horizon.problem(self.work)
        self._solver = CheckedSolver(horizon.solver)

    def step(
        self, k: int, state: FloatArray, previous: FloatArray
    ) -> tuple[FloatArray, SolverReport]:
        """Return u_b = u_e* of eq. (ue), inside its bounds, for z_k (n,) and u_{k-1} (m,)."""
        work = self.work
        bounds = self.horizon.stages.bounds.at(k)
        work.state[:] = state
        work.previous[:] = previous
        report, _ = self.complete(k, solve_in_closed_form(k, self.horizon.stages, work))
        return bounds.clamp(work.previous + work.steps[: len(previous)]), report

    def complete(self, k: int, outcome: int) -> tuple[SolverReport, FloatArray | None]:
        """Complete `Work.steps` after the `outcome` of `solve_in_closed_form`.

        The solver first sees the hard bounds alone. A solution that keeps to the soft ones is that
        of the whole problem, whose slacks are then 0; where it does not, the solver sees both.
        Without an accepted solution the steps are 0.

        Returns:
            report, and the slacks of the soft bounds (s,), None where they are 0.
        """
        if outcome == CLOSED_FORM:
            return CLOSED_FORM_REPORT, None
        work = self.work
        if outcome in REFUSED:
            work.steps[:] = 0.0
            return refused(outcome), None

        first = None  # report of the solve without soft rows
        if outcome != SOFT_BOUND_ACTIVE:
            solution = self._solver.solve_bounded(self._problem)
            if solution.x is None:
                work.steps[:] = 0.0
                return solution.report, None
            np.clip(solution.x, work.step_lower, work.step_upper, out=work.steps)
            has_soft = len(self.horizon.stages.soft_penalty) > 0
            if not has_soft or keeps_soft_bounds(k, self.horizon.stages, work):
                return solution.report, None
            first = solution.report

        solution = self._solver.solve_bounded(self.horizon.softened_problem(k, work))
        report = solution.report if first is None else _sum_of(first, solution.report)
        if solution.x is None:
            work.steps[:] = 0.0
            return report, None
        size = len(work.steps)
        np.clip(solution.x[:size], work.step_lower, work.step_upper, out=work.steps)
        return report, solution.x[size:]

    def prepare(self, k: int) -> None:
        """Condense tick `k` and solve it for the data of the last step, to fill the caches."""
        self.preparing.state[:] = self.work.state
        self.preparing.previous[:] = self.work.previous
        self.preparing.acquiring[:] = self.work.acquiring
        solve_in_closed_form(k, self.horizon.stages, self.preparing)


def _sum_of(first: SolverReport, last: SolverReport) -> SolverReport:
    """Return the report of the last of two solves, with the iterations and the time of both."""
    return replace(
        last,
        iterations=first.iterations + last.iterations,
        solve_time_s=first.solve_time_s + last.solve_time_s,
    )
