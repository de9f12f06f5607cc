"""Linear MPC with a receding horizon over precomputed matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning, check_choice, check_count, check_vector
from ..models.kinematics import Error
from ..models.linear import ordered_product
from ..types import FloatArray, Input, SolverReport
from .qp import FREE, QP, PersistentSolver, SoftRows

# Ticks times horizon of a block, the ticks whose matrices are computed together: 32 ticks of the
# default horizon, in 2 ms. The first tick of a block waits for all of them, so that a block has
# fewer ticks where the horizon is longer.
_BLOCK_STAGES: Final = 640
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


@dataclass(frozen=True, slots=True)
class OutputBounds:
    """Bounds lower <= S z <= upper on r outputs of the state at N + 1 ticks; infinite: free."""

    rows: FloatArray  # S (N + 1, r, n)
    lower: FloatArray  # (N + 1, r)
    upper: FloatArray  # (N + 1, r)
    first: int = 1  # stage of the horizon from which on they hold


@dataclass(frozen=True, slots=True)
class FirstInputs:
    """Bounds on the first input of every tick and on the previous one; (ticks, 2, m)."""

    bounds: FloatArray  # lower, upper
    reach: FloatArray  # lower, upper of the inputs from which a step leads into the bounds

    @classmethod
    def of(cls, first: StageBounds) -> FirstInputs:
        """Return them for the bounds on the `first` stage of every tick, (ticks, m)."""
        return cls(
            np.stack([first.lower, first.upper], axis=1),
            np.stack([first.lower - first.step_upper, first.upper - first.step_lower], axis=1),
        )

    def clamp(self, k: int, inputs: FloatArray) -> FloatArray:
        """Return the allowed first input of tick `k` nearest to `inputs` (m,)."""
        lower, upper = self.bounds[k]
        return np.minimum(np.maximum(inputs, lower), upper)

    def clamp_previous(self, k: int, previous: FloatArray) -> FloatArray:
        """Return the input nearest to `previous` (m,) from which a step leads into the bounds.

        From an input beyond them, the QP of tick `k` is infeasible.
        """
        lower, upper = self.reach[k]
        return np.minimum(np.maximum(previous, lower), upper)


@dataclass(frozen=True, slots=True)
class _Matrices:
    """Matrices of some ticks in a row; w, Z_j and C of `CondensedHorizon`."""

    prediction: FloatArray  # C Z_1 ... C Z_Np (ticks, Np, p, n + m + m Nc)
    gradient: FloatArray  # over (z_k, u_{k-1}), (ticks, m Nc, n + m)
    hessian: FloatArray  # (ticks, m Nc, m Nc)
    soft: FloatArray | None  # S Z_1 ... S Z_Np of the soft bounds (ticks, Np r, n + m + m Nc)


class CondensedHorizon:
    """QPs of all ticks along a reference; only the state and the previous input are left open.

    The unknowns are the input steps Delta U = (Delta u_k ... Delta u_{k+Nc-1}). With
    w = (z_k, u_{k-1}, Delta U), the states of the horizon are linear in w,

        z_{k+j} = Z_j w,    Z_0 = [I 0 0],    Z_{j+1} = A_{k+j} Z_j + B_{k+j} U_j,

    where U_j picks u_{k+j} = u_{k-1} + sum of the steps up to min(j, Nc - 1). The cost of
    eq. (costfunction), sum y'Qy + sum Delta u' R Delta u with y_k = C_k z_k, is then quadratic in
    w. Bounds hold for the stages with a free step.

    All ticks are checked at once, and their matrices are then computed anew, a block of ticks at a
    time: those of all ticks take 30 KB a tick.

    Args:
        a: A (N, n, n), with `b` B (N, n, m).
        outputs: C (N + 1, p, n); without them, the outputs are the states.
        bounds: (N, m) each, in addition to those of the tuning.
        free_bounds: on the free stages of every tick, (ticks, m Nc) each, in the place of those of
            the tuning and `bounds`.
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
    ) -> None:
        n, m = b.shape[1:]
        c = np.broadcast_to(np.eye(n), (len(a) + 1, n, n)) if outputs is None else outputs
        horizon, moves = tuning.horizon, tuning.moves
        self.ticks, self.solver = len(a) - horizon + 1, tuning.solver
        self._block_ticks = max(1, _BLOCK_STAGES // horizon)
        p = c.shape[1]
        if self.ticks < 1 or len(tuning.output_weight) != p or len(tuning.step_weight) != m:
            raise InvalidTuning(
                f"{len(a)} stages of {p} outputs and {m} inputs do not fit a horizon of {horizon}, "
                f"{len(tuning.output_weight)} output and {len(tuning.step_weight)} step weights"
            )
        self._a, self._b, self._c, self._soft, self._tuning = a, b, c, soft, tuning
        self._moves = moves
        changes = (a != np.eye(n)).any(axis=(0, 2)) | b.any(axis=(0, 2))
        self._changing = np.flatnonzero(changes)  # entries of z; disturbances are constant
        sums = np.tril(np.ones((moves, moves)))
        self._matrix: FloatArray = np.kron(sums, np.eye(m)).astype(np.float64)
        self._bounds = free_bounds or move_bounds(tuning, period_s, len(a), bounds)
        self.first = FirstInputs.of(self._bounds.at(slice(None), slice(m)))
        self._first_tick = 0  # of the present block
        self._block = self._matrices(0)
        for start in range(0, self.ticks, self._block_ticks):
            _require_convex(self._matrices(start))

    def qp(self, k: int, state: FloatArray, previous_input: FloatArray) -> QP:
        """Return the QP of tick `k` for z_k (n,) and u_{k-1} (m,)."""
        bounds, (matrices, tick) = self._bounds, self._at(k)
        shift = np.concatenate([previous_input] * self._moves)  # (m Nc,)
        given = np.concatenate([state, previous_input])
        return QP(
            hessian=matrices.hessian[tick],
            gradient=ordered_product(matrices.gradient[tick], given),
            matrix=self._matrix,
            lower=bounds.lower[k] - shift,
            upper=bounds.upper[k] - shift,
            step_lower=bounds.step_lower[k],
            step_upper=bounds.step_upper[k],
            soft=self._soft_rows(k, given),
        )

    def _soft_rows(self, k: int, given: FloatArray) -> SoftRows | None:
        """Return the soft rows of tick `k`, None where no bound of its stages is finite."""
        if self._soft is None:
            return None
        first = min(self._soft.first, self._tuning.horizon)
        stages = slice(k + first, k + 1 + self._tuning.horizon)
        lower, upper = self._soft.lower[stages], self._soft.upper[stages]
        if not (np.isfinite(lower).any() or np.isfinite(upper).any()):
            return None
        matrices, tick = self._at(k)
        assert matrices.soft is not None
        rows = matrices.soft[tick, (first - 1) * lower.shape[1] :]
        offset = ordered_product(rows[:, : len(given)], given)
        return SoftRows(
            matrix=rows[:, len(given) :],
            lower=np.maximum(lower.ravel(), -FREE) - offset,
            upper=np.minimum(upper.ravel(), FREE) - offset,
            outputs=lower.shape[1],
        )

    def admissible(self, k: int, inputs: FloatArray, previous: FloatArray) -> FloatArray:
        """Return the first input of tick `k` nearest to `inputs` (m,) within bounds and a step."""
        m = len(inputs)
        lower, upper, step_lower, step_upper = (values[k, :m] for values in self._bounds)
        low, high = (
            np.maximum(lower, previous + step_lower),
            np.minimum(upper, previous + step_upper),
        )
        return np.maximum(np.minimum(inputs, high), low)

    def prediction(self, k: int) -> FloatArray:
        """Return C Z_1 ... C Z_Np of tick `k`, (Np, p, n + m + m Nc)."""
        matrices, tick = self._at(k)
        return matrices.prediction[tick]

    def _at(self, k: int) -> tuple[_Matrices, int]:
        """Return the block that holds tick `k`, and the place of the tick in it."""
        tick = k % self._block_ticks
        if k - tick != self._first_tick:
            self._first_tick, self._block = k - tick, self._matrices(k - tick)
        return self._block, tick

    def _matrices(self, start: int) -> _Matrices:
        """Return the matrices of the ticks from `start` on."""
        tuning, (n, m) = self._tuning, self._b.shape[1:]
        horizon, moves, p = tuning.horizon, tuning.moves, self._c.shape[1]
        ticks = min(self._block_ticks, self.ticks - start)
        given = n + m  # entries of z_k and u_{k-1} in w
        state = np.zeros((ticks, n, given + m * moves))  # Z_0
        state[:, :, :n] = np.eye(n)
        stages = np.empty((ticks, horizon + 1, p, given + m * moves))  # C Z_0 ... C Z_Np
        stages[:, 0] = self._c[start : start + ticks] @ state
        changing, soft = self._changing, []
        for j in range(horizon):
            window = slice(start + j, start + j + ticks)
            moved = self._a[window, changing] @ state
            inputs = 1 + min(j + 1, moves)  # blocks of w that U_j picks: u_{k-1} and its steps
            moved[..., n : n + m * inputs] += np.tile(self._b[window, changing], inputs)
            state[:, changing] = moved
            ahead = slice(start + j + 1, start + j + 1 + ticks)
            stages[:, j + 1] = self._c[ahead] @ state
            if self._soft:
                soft.append(self._soft.rows[ahead] @ state)
        weighted = np.asarray(tuning.output_weight)[:, None] * stages
        flat = (ticks, (horizon + 1) * p, -1)
        transposed = stages[..., given:].reshape(flat).transpose(0, 2, 1)
        cost = 2.0 * transposed @ weighted.reshape(flat)
        cost[:, :, given:] += 2.0 * np.diag(np.tile(tuning.step_weight, moves))
        hessian = cost[:, :, given:]
        return _Matrices(
            prediction=stages[:, 1:],
            gradient=np.ascontiguousarray(cost[:, :, :given]),
            hessian=0.5 * (hessian + hessian.transpose(0, 2, 1)),
            soft=np.concatenate(soft, axis=1) if soft else None,
        )


def _require_convex(matrices: _Matrices) -> None:
    # The factorisation of a matrix that is not finite may end without an error.
    convex = bool(np.isfinite(matrices.hessian).all() and np.isfinite(matrices.gradient).all())
    try:
        np.linalg.cholesky(matrices.hessian if convex else np.zeros((1, 1)))
    except np.linalg.LinAlgError:
        raise InvalidTuning("the cost is not finite and convex all along the reference") from None


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


@dataclass(frozen=True, slots=True)
class FeedbackAction:
    """Result of the linear MPC at one tick."""

    input: FloatArray  # u_b = u_e* (m,), eq. (ue); inside its bounds
    plan: FloatArray  # (n + m + m Nc,) w of `CondensedHorizon`: state, previous input, input steps
    report: SolverReport
    fallback: str  # why the input is not the minimiser; empty where it is
    excess: FloatArray | None = None  # (r,) violation of the soft bounds; None where there is none


class LinearMpc:
    """Receding horizon: solve the QP of a tick and apply its first step.

    Where the QP has no accepted solution, the previous input is held. A result depends on earlier
    ones in the last digits of the solver's iterates only.
    """

    def __init__(self, horizon: CondensedHorizon) -> None:
        self._horizon = horizon
        self._solver = PersistentSolver(horizon.solver)
        # `prepare` has a solver of its own: a solve changes the last digits of later results.
        self._preparing_solver = PersistentSolver(horizon.solver)
        self._last: tuple[FloatArray, FloatArray] | None = None  # state and input of the last step

    def step(self, k: int, state: FloatArray, previous: FloatArray) -> FeedbackAction:
        """Return the action of tick `k` for the state z_k (n,) and the input u_{k-1} (m,)."""
        self._last = state, previous
        return self._solve(self._solver, k, state, previous)

    def prepare(self, k: int) -> None:
        """Solve tick `k` for the data of the last step and drop the result, to fill the caches."""
        if self._last:
            self._solve(self._preparing_solver, k, *self._last)

    def _solve(
        self, solver: PersistentSolver, k: int, state: FloatArray, previous: FloatArray
    ) -> FeedbackAction:
        previous = self._horizon.first.clamp_previous(k, previous)
        qp = self._horizon.qp(k, state, previous)
        n = len(qp.gradient)
        solution = solver.solve(qp)
        excess = None
        if solution.x is None:
            steps = np.zeros_like(qp.gradient)
            fallback = f"QP {solution.report.status}: previous feedback held"
        else:
            steps = np.minimum(np.maximum(solution.x[:n], qp.step_lower), qp.step_upper)
            excess = solution.x[n:] if len(solution.x) > n else None
            fallback = ""
        u = self._horizon.first.clamp(k, previous + steps[: len(previous)])
        plan = np.concatenate([state, previous, steps])
        return FeedbackAction(u, plan, solution.report, fallback, excess)
