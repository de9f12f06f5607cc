"""Articulated model along a horizon with its derivatives, of both bodies or of one, compiled."""

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import FAST, cached_njit
from ..models.augmented_state import VehicleParameter, vehicle_parameters
from ..types import Disturbance, FloatArray, Input, State
from ..vehicle import Vehicle

_M: Final = len(Input)
_N: Final = len(State)


class Row(IntEnum):
    """State of the model by body: the tractor does not depend on its trailer."""

    X = 0
    Y = 1
    PSI_T = 2
    DELTA_T = 3
    V = 4
    PSI_I = 5
    DELTA_I = 6


class Column(IntEnum):
    """What the state at the end of a period is derived by: state at its start, inputs.

    Nothing depends on x and y but themselves.
    """

    PSI_T = 0
    DELTA_T = 1
    V = 2
    INPUT_T = 3
    INPUT_HP = 4
    PSI_I = 5
    DELTA_I = 6
    INPUT_I = 7


_COLUMNS: Final = len(Column)
_TRACTOR_ROWS: Final = int(Row.PSI_I)  # number of them; those of the trailer follow
_TRACTOR_COLUMNS: Final = int(Column.PSI_I)
_OF_STATE: Final = int(Row.PSI_T)  # row of the first state column of the tractor
_TRACTOR_STATES: Final = int(Column.INPUT_T)  # columns of states, the first ones of the tractor
_TRAILER_STATES: Final = 2
_OF_INPUT: Final = (int(Column.INPUT_T), int(Column.INPUT_I), int(Column.INPUT_HP))
_ORDER: Final = tuple(int(State[row.name]) for row in Row)  # of the rows in a minimal state
_TRAILER_POSE: Final = 3  # first entry of the trailer in a target


class Block(NamedTuple):
    """A part of the optimisation problem: inputs that it decides, bodies whose errors it weighs."""

    inputs: NDArray[np.int64]  # of `Input`, (m,)
    tractor: bool  # whether the motion of the tractor depends on its inputs
    trailer: bool
    outputs: NDArray[np.int64]  # of x, y of the tractor, x, y of the trailer


WHOLE: Final = Block(np.arange(_M), True, True, np.arange(4))
TRACTOR: Final = Block(np.array([Input.DELTA_T, Input.HP], np.int64), True, False, np.arange(2))
TRAILER: Final = Block(np.array([Input.DELTA_I], np.int64), False, True, np.arange(2, 4))


class Task(NamedTuple):
    """Data of the problem of one tick."""

    k: int  # tick of the bounds
    state: FloatArray  # (7,) the estimate, as of the model
    disturbance: FloatArray  # (Np, 5) predicted as by the linear MPC
    poses: FloatArray  # (Np, 6 or 7) targets at the ends of the periods, for the model
    feedforward: FloatArray  # (Np, 3) u_r
    previous: FloatArray  # (3,) u_e(k-1)
    last_plan: FloatArray  # (Nc, 3) steps of u_e of the last tick
    motion: FloatArray  # of the tractor along the horizon, see `new_motion`


class Model(NamedTuple):
    """A model along a horizon, for the inputs of a block."""

    kind: int  # `ARTICULATED` or `PRINTED`
    parameters: FloatArray
    period_s: float
    substeps: int  # Runge-Kutta steps a period
    block: Block


ARTICULATED: Final = 0
PRINTED: Final = 1


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def planned_inputs(
    task: Task, own: NDArray[np.int64], steps: FloatArray, inputs: FloatArray
) -> None:
    """Write u = u_r - u_e of all periods into `inputs` (Np, 3).

    Own inputs follow the `steps` (m Nc,) of u_e, the others keep theirs.
    """
    m = own.size
    moves = steps.size // m
    for i in range(_M):
        place = -1
        for o in range(m):
            if own[o] == i:
                place = o
        u_e = task.previous[i]
        for j in range(len(inputs)):
            if j < moves and place >= 0:
                u_e += steps[j * m + place]
            inputs[j, i] = task.feedforward[j, i] - u_e


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def linear_map(matrix: FloatArray, columns: FloatArray, filled: int, result: FloatArray) -> None:
    """Write `matrix` (r, n) times the first `filled` `columns` (n, c) into `result` (r, c)."""
    result[:, :] = 0.0
    for row in range(len(matrix)):
        for k in range(matrix.shape[1]):
            factor = matrix[row, k]
            if factor != 0.0:  # most are
                for i in range(filled):
                    result[row, i] += factor * columns[k, i]


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def weighted_row(
    values: FloatArray, j: int, output: int, damping: float, filled: int, row: FloatArray
) -> None:
    """Write y, or y + tau y' for a cross-track error y, of stage `j` into `row` (q,).

    `values` (Np, p, q) are errors or their derivatives, tau = `damping` in periods; the rate of the
    last stage is that before it.
    """
    for i in range(filled):
        row[i] = values[j, output, i]
    if damping == 0.0 or output % 2 == 0:
        return
    ahead = min(j + 1, len(values) - 1)
    for i in range(filled):
        row[i] += damping * (values[ahead, output, i] - values[ahead - 1, output, i])


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def condense(
    errors: FloatArray,
    jacobian: FloatArray,
    weight: FloatArray,
    step_weight: FloatArray,
    damping: float,
    steps: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
) -> float:
    """Return the cost at `steps` (q,), and write the QP of the linearised outputs.

    sum_j y_j' Q_j y_j + s' R s with y_j = errors_j + jacobian_j (s - steps) is, but for a constant,
    1/2 s'Hs + g's with `hessian` (q, q) and `gradient` (q,). The outputs are those of
    `weighted_row`; those after the free steps depend on all of them.
    """
    cost = 0.0
    q = steps.size
    row = np.empty(q)
    now = np.empty(1)
    values = errors.reshape(errors.shape[0], errors.shape[1], 1)
    hessian[:, :] = 0.0
    gradient[:] = 0.0
    for j in range(len(errors)):
        for output in range(weight.shape[1]):
            weighted_row(values, j, output, damping, 1, now)
            weighted_row(jacobian, j, output, damping, q, row)
            cost += weight[j, output] * now[0] * now[0]
            rest = now[0]
            for i in range(q):
                rest -= row[i] * steps[i]
            for i in range(q):
                factor = 2.0 * weight[j, output] * row[i]
                if factor == 0.0:  # a later step
                    continue
                gradient[i] += factor * rest
                for k in range(i + 1):
                    hessian[i, k] += factor * row[k]
    for i in range(q):
        hessian[i, i] += 2.0 * step_weight[i]
        cost += step_weight[i] * steps[i] * steps[i]
        for k in range(i):
            hessian[k, i] = hessian[i, k]
    return cost


# Longest classical Runge-Kutta step over the shortest lag: over a horizon of four seconds both axle
# points then stay within a millimetre of much finer steps, which a test checks.
_STEP_PER_LAG: Final = 0.75
# The same of a problem of the trailer alone, whose steering moves its axle point less.
_STEP_PER_TRAILER_LAG: Final = 1.0


def articulated_model(vehicle: Vehicle, period_s: float, block: Block = WHOLE) -> Model:
    """Return `ttempc.models.kinematics.articulated` along a horizon, for the inputs of a block.

    The outputs are reference less axle points in the frames of the reference [m], those of the
    block; the targets are the reference's x, y, psi of the tractor, then of the trailer. Only what
    depends on the block's inputs is derived, and only bodies that its outputs need are moved. The
    trailer alone is moved in as many or fewer steps, whose number divides that of its tractor.
    """
    shortest_lag = min(vehicle.steering_lag_t, vehicle.steering_lag_i)
    count = math.ceil(period_s / (_STEP_PER_LAG * shortest_lag))
    if not block.tractor:
        enough = period_s / (_STEP_PER_TRAILER_LAG * vehicle.steering_lag_i)
        divisors = (number for number in range(1, count) if count % number == 0)
        count = next((number for number in divisors if number >= enough), count)
    return Model(ARTICULATED, vehicle_parameters(vehicle), period_s, count, block)


def new_motion(model: Model, horizon: int) -> FloatArray:
    """Return an array for the motion of the tractor, (Np, 4 substeps + 1, 3).

    A row for each Runge-Kutta stage has psi_t [rad], v [m/s] and psi_t' [rad/s], the last one
    x, y [m] and psi_t at the end of the period.
    """
    return np.zeros((horizon, _STAGES * model.substeps + 1, 3))


def stage_times(model: Model) -> FloatArray:
    """Return the times of the rows of a period of `new_motion` after its start [s]."""
    step_s = model.period_s / model.substeps
    starts = step_s * np.arange(model.substeps)[:, None]
    stages = starts + step_s * np.array([0.0, 0.5, 0.5, 1.0])
    return np.append(stages.ravel(), model.period_s)


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def kept_motion(
    reference: FloatArray, now: FloatArray, state: FloatArray, motion: FloatArray
) -> None:
    """Write the motion of a tractor that keeps its present distance from its reference.

    `reference` (Np, s, 3) is the motion of the reference, `now` (3,) its x, y, psi_t at present;
    `state` is the estimate, minimal.
    """
    dx = state[State.X] - now[0]
    dy = state[State.Y] - now[1]
    turn = state[State.PSI_T] - now[2]
    turn -= math.tau * math.floor(turn / math.tau + 0.5)
    cos = math.cos(now[2])
    sin = math.sin(now[2])
    along = cos * dx + sin * dy
    across = cos * dy - sin * dx
    end = motion.shape[1] - 1
    for j in range(len(motion)):
        for row in range(end):
            motion[j, row, 0] = reference[j, row, 0] + turn
            motion[j, row, 1] = reference[j, row, 1]
            motion[j, row, 2] = reference[j, row, 2]
        cos = math.cos(reference[j, end, 2])
        sin = math.sin(reference[j, end, 2])
        motion[j, end, 0] = reference[j, end, 0] + cos * along - sin * across
        motion[j, end, 1] = reference[j, end, 1] + sin * along + cos * across
        motion[j, end, 2] = reference[j, end, 2] + turn


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def articulated_horizon(
    model: Model,
    task: Task,
    steps: FloatArray,
    errors: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Run the model under `steps` (m Nc,) of the block's inputs, see `articulated_model`.

    Writes the outputs at the ends of the periods into `errors` (Np, p) and their derivatives by
    the steps into `jacobian` (Np, p, m Nc). A block of the trailer alone takes the motion of the
    tractor from `Task.motion`; any other writes it there.
    """
    block = model.block
    now = np.empty(_N)
    for row in range(_N):
        now[row] = task.state[_ORDER[row]]
    by_given = np.empty((_N, _COLUMNS))
    slopes = np.empty((3, _N, _COLUMNS))
    rates = np.empty((3, _COLUMNS))
    before = np.zeros((_N, steps.size))
    after = np.zeros((_N, steps.size))
    inputs = np.empty_like(task.feedforward)
    planned_inputs(task, block.inputs, steps, inputs)
    for j in range(len(inputs)):
        motion = task.motion[j]
        advance_period(now, inputs[j], task.disturbance[j], model, motion, slopes, rates, by_given)
        propagate(by_given, block, j, before, after)
        position_errors(now, task.poses[j], model.parameters, block, after, errors[j], jacobian[j])
        before, after = after, before


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def propagate(
    by_given: FloatArray, block: Block, period: int, before: FloatArray, after: FloatArray
) -> None:
    """Write d state / d steps at the end of a `period` into `after` (7, m Nc).

    `before` is the same at its start, `by_given` (7, 8) the derivative of the period; d u / d step
    i = -1 from period i on. Rows of a body that no input of the block moves stay 0.
    """
    m = block.inputs.size
    filled = min((period + 1) * m, after.shape[1])
    first = 0 if block.tractor else _TRACTOR_ROWS
    last = _N if block.trailer else _TRACTOR_ROWS
    for row in range(first, last):
        for i in range(filled):
            after[row, i] = before[row, i] if row < _OF_STATE else 0.0
        if block.tractor:
            for c in range(_TRACTOR_STATES):
                slope = by_given[row, c]
                for i in range(filled):
                    after[row, i] += slope * before[_OF_STATE + c, i]
        if row >= _TRACTOR_ROWS:
            for c in range(_TRAILER_STATES):
                slope = by_given[row, _TRACTOR_COLUMNS + c]
                for i in range(filled):
                    after[row, i] += slope * before[_TRACTOR_ROWS + c, i]
        for i in range(filled):
            after[row, i] -= by_given[row, _OF_INPUT[block.inputs[i % m]]]


_STAGES: Final = 4
"""Of a classical Runge-Kutta step."""
_TANGENT: Final = _N  # entry of the rates: of the front steering angle, which both bodies need


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def advance_period(
    state: FloatArray,
    inputs: FloatArray,
    disturbance: FloatArray,
    model: Model,
    motion: FloatArray,
    slopes: FloatArray,
    rates: FloatArray,
    by_given: FloatArray,
) -> None:
    """Advance `state` (7,) by a period of constant inputs, in Runge-Kutta steps.

    State in the order of `Row`; `motion` (s, 3) as of `articulated_horizon`. Writes the
    derivatives of the state at the end into `by_given` (7, 8), in the order of `Column`: the rows
    and columns of the bodies that the block moves. They are the exact ones of the Runge-Kutta
    steps: the same steps of the variational equation. `slopes` (3, 7, 8) and `rates` (3, 8) are
    scratch.
    """
    block = model.block
    parameters = model.parameters
    step_s = model.period_s / model.substeps
    every = len(motion) // (_STAGES * model.substeps)  # steps of the motion in one of the model
    slope = slopes[0]
    stage_slope = slopes[1]
    total_slope = slopes[2]
    rate = rates[0]
    stage = rates[1]
    total = rates[2]
    first_row = 0 if block.tractor else _TRACTOR_ROWS
    last_row = _N if block.trailer else _TRACTOR_ROWS

    # Sums over whole rows in one loop each: columns of another body stay 0.
    low = first_row * _COLUMNS
    high = last_row * _COLUMNS
    given = by_given.reshape(by_given.size)
    slope_flat = slope.reshape(slope.size)
    stage_flat = stage_slope.reshape(stage_slope.size)
    total_flat = total_slope.reshape(total_slope.size)
    for i in range(low, high):
        given[i] = 0.0
        slope_flat[i] = 0.0
    for c in range(_TRACTOR_STATES):
        by_given[_OF_STATE + c, c] = 1.0
    for c in range(_TRAILER_STATES):
        by_given[_TRACTOR_ROWS + c, _TRACTOR_COLUMNS + c] = 1.0
    for n in range(model.substeps):
        for i in range(first_row, last_row):
            stage[i] = state[i]
            total[i] = 0.0
        for i in range(low, high):
            stage_flat[i] = given[i]
            total_flat[i] = 0.0
        for k in range(_STAGES):
            heading = motion[_motion_row(n, k, every)]
            if block.tractor:
                tractor_rate(stage, stage_slope, inputs, disturbance, parameters, rate, slope)
                heading[0] = stage[Row.PSI_T]
                heading[1] = stage[Row.V]
                heading[2] = rate[Row.PSI_T]
            else:
                stage[Row.PSI_T] = heading[0]
                stage[Row.V] = heading[1]
                rate[Row.PSI_T] = heading[2]
            if block.trailer:
                trailer_rate(
                    stage, stage_slope, inputs, disturbance, parameters, block, rate, slope
                )
            weight = step_s / 6.0 if k in (0, 3) else step_s / 3.0
            ahead = step_s if k == 2 else 0.5 * step_s
            for i in range(first_row, last_row):
                total[i] += weight * rate[i]
                stage[i] = state[i] + ahead * rate[i]
            for i in range(low, high):
                total_flat[i] += weight * slope_flat[i]
                stage_flat[i] = given[i] + ahead * slope_flat[i]
        for i in range(first_row, last_row):
            state[i] += total[i]
        for i in range(low, high):
            given[i] += total_flat[i]
    _share_pose(motion[len(motion) - 1], block, state)


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST, inline="always")
def _motion_row(step: int, stage: int, every: int) -> int:
    """Return the row of `new_motion` at a stage of a step which is `every` steps of the motion."""
    start = _STAGES * every * step
    if stage == 0:
        return start
    if stage == _STAGES - 1:
        return start + _STAGES * every - 1
    if every % 2 == 0:
        return start + _STAGES * (every // 2)
    return start + _STAGES * (every // 2) + stage


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST, inline="always")
def _share_pose(end: FloatArray, block: Block, state: FloatArray) -> None:
    """Write the tractor's pose at the end of a period into its motion, or take it from there."""
    if block.tractor:
        end[0] = state[Row.X]
        end[1] = state[Row.Y]
        end[2] = state[Row.PSI_T]
    else:
        state[Row.X] = end[0]
        state[Row.Y] = end[1]
        state[Row.PSI_T] = end[2]


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST, inline="always")
def tractor_rate(
    state: FloatArray,
    by_given: FloatArray,
    inputs: FloatArray,
    disturbance: FloatArray,
    parameters: FloatArray,
    rate: FloatArray,
    slope: FloatArray,
) -> None:
    """Write the tractor's rows of `articulated` into `rate`, of its derivative into `slope`.

    The derivative is along `by_given` (7, 8), as in `state_rate_jacobian`.
    """
    psi_t = state[Row.PSI_T]
    v = state[Row.V]
    slip_t = disturbance[Disturbance.SLIP_T]
    lag = parameters[VehicleParameter.STEERING_LAG_T]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    speed_gain = parameters[VehicleParameter.SPEED_GAIN]
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    sin_t = math.sin(psi_t)
    cos_t = math.cos(psi_t)
    tangent = math.tan(state[Row.DELTA_T] + disturbance[Disturbance.STEERING])
    along_v = cos_t - slip_t * sin_t
    across_v = sin_t + slip_t * cos_t
    steering, gain = _steering(
        (inputs[Input.DELTA_T] - state[Row.DELTA_T]) / lag,
        1.0 / lag,
        parameters[VehicleParameter.STEERING_RATE_T],
    )
    rate[Row.X] = v * along_v
    rate[Row.Y] = v * across_v
    rate[Row.PSI_T] = v * tangent / wheelbase
    rate[Row.DELTA_T] = steering
    rate[Row.V] = (speed_gain * inputs[Input.HP] - v) / tau + disturbance[Disturbance.DRIVE]
    rate[_TANGENT] = tangent

    yaw_by_v = tangent / wheelbase
    yaw_by_delta = v * (1.0 + tangent * tangent) / wheelbase
    for c in range(_TRACTOR_COLUMNS):
        slope[Row.X, c] = along_v * by_given[Row.V, c] - v * across_v * by_given[Row.PSI_T, c]
        slope[Row.Y, c] = across_v * by_given[Row.V, c] + v * along_v * by_given[Row.PSI_T, c]
        slope[Row.PSI_T, c] = (
            yaw_by_delta * by_given[Row.DELTA_T, c] + yaw_by_v * by_given[Row.V, c]
        )
        slope[Row.DELTA_T, c] = -gain * by_given[Row.DELTA_T, c]
        slope[Row.V, c] = -by_given[Row.V, c] / tau
    slope[Row.DELTA_T, Column.INPUT_T] += gain
    slope[Row.V, Column.INPUT_HP] += speed_gain / tau


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST, inline="always")
def trailer_rate(
    state: FloatArray,
    by_given: FloatArray,
    inputs: FloatArray,
    disturbance: FloatArray,
    parameters: FloatArray,
    block: Block,
    rate: FloatArray,
    slope: FloatArray,
) -> None:
    """Write the trailer's rows, after those of `tractor_rate`; arguments as there."""
    delta_i = state[Row.DELTA_I]
    v = state[Row.V]
    slip_t = disturbance[Disturbance.SLIP_T]
    lag = parameters[VehicleParameter.STEERING_LAG_I]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    turning_offset = parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    lam = state[Row.PSI_T] - state[Row.PSI_I]
    sin_l = math.sin(lam)
    cos_l = math.cos(lam)
    sin_i = math.sin(delta_i)
    cos_i = math.cos(delta_i)
    yaw_t = rate[Row.PSI_T]
    steering, gain = _steering(
        (inputs[Input.DELTA_I] - delta_i) / lag,
        1.0 / lag,
        parameters[VehicleParameter.STEERING_RATE_I],
    )
    per_arm = 1.0 / (length_i + turning_offset + d * cos_i)
    slips = sin_l + slip_t * cos_l - disturbance[Disturbance.SLIP_I]
    by_steering = -d * cos_i * per_arm
    yaw_i = (v * slips - a * yaw_t * cos_l) * per_arm + by_steering * steering
    rate[Row.PSI_I] = yaw_i
    rate[Row.DELTA_I] = steering

    by_lam = (v * (cos_l - slip_t * sin_l) + a * yaw_t * sin_l) * per_arm
    by_delta_i = d * sin_i * (steering + yaw_i) * per_arm - by_steering * gain
    if block.tractor:
        turn = rate[_TANGENT] / wheelbase
        by_v = (slips - a * turn * cos_l) * per_arm
        by_delta_t = -a * v * (1.0 / wheelbase + turn * rate[_TANGENT]) * cos_l * per_arm
        for c in range(_TRACTOR_COLUMNS):
            slope[Row.PSI_I, c] = (
                by_lam * (by_given[Row.PSI_T, c] - by_given[Row.PSI_I, c])
                + by_delta_t * by_given[Row.DELTA_T, c]
                + by_v * by_given[Row.V, c]
            )
    for c in range(_TRACTOR_COLUMNS, _COLUMNS):
        slope[Row.PSI_I, c] = (
            by_delta_i * by_given[Row.DELTA_I, c] - by_lam * by_given[Row.PSI_I, c]
        )
        slope[Row.DELTA_I, c] = -gain * by_given[Row.DELTA_I, c]
    slope[Row.PSI_I, Column.INPUT_I] += by_steering * gain
    slope[Row.DELTA_I, Column.INPUT_I] += gain


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def _steering(rate: float, gain: float, limit: float) -> tuple[float, float]:
    """Return the limited rate of a steering angle [rad/s] and its derivative by the command."""
    if abs(rate) >= limit:
        return math.copysign(limit, rate), 0.0
    return rate, gain


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def position_errors(
    state: FloatArray,
    poses: FloatArray,
    parameters: FloatArray,
    block: Block,
    by_steps: FloatArray,
    errors: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write reference less axle points in the frames of the reference, and their derivatives.

    `by_steps` (7, q) is d state / d steps; of the bodies of the block, the tractor first.
    """
    first = 0
    if block.tractor:
        dx = poses[0] - state[Row.X]
        dy = poses[1] - state[Row.Y]
        _frame_error(dx, dy, poses[2], first, errors)
        cos = math.cos(poses[2])
        sin = math.sin(poses[2])
        for i in range(by_steps.shape[1]):
            by_x = by_steps[Row.X, i]
            by_y = by_steps[Row.Y, i]
            jacobian[first, i] = -cos * by_x - sin * by_y
            jacobian[first + 1, i] = sin * by_x - cos * by_y
        first = 2
    if not block.trailer:
        return

    # The trailer point is behind the tractor by vectors along psi_t, psi_d and psi_i.
    psi_t = state[Row.PSI_T]
    psi_i = state[Row.PSI_I]
    psi_d = psi_i + state[Row.DELTA_I]
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    hitch_x = a * math.cos(psi_t)
    hitch_y = a * math.sin(psi_t)
    drawbar_x = d * math.cos(psi_d)
    drawbar_y = d * math.sin(psi_d)
    body_x = drawbar_x + length_i * math.cos(psi_i)
    body_y = drawbar_y + length_i * math.sin(psi_i)
    x = state[Row.X] - hitch_x - body_x
    y = state[Row.Y] - hitch_y - body_y
    yaw = poses[_TRAILER_POSE + 2]
    _frame_error(poses[_TRAILER_POSE] - x, poses[_TRAILER_POSE + 1] - y, yaw, first, errors)
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    for i in range(by_steps.shape[1]):
        by_psi_t = by_steps[Row.PSI_T, i]
        by_psi_i = by_steps[Row.PSI_I, i]
        by_delta_i = by_steps[Row.DELTA_I, i]
        by_x = by_steps[Row.X, i] + hitch_y * by_psi_t + body_y * by_psi_i + drawbar_y * by_delta_i
        by_y = by_steps[Row.Y, i] - hitch_x * by_psi_t - body_x * by_psi_i - drawbar_x * by_delta_i
        jacobian[first, i] = -cos * by_x - sin * by_y
        jacobian[first + 1, i] = sin * by_x - cos * by_y


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def _frame_error(dx: float, dy: float, yaw: float, first: int, errors: FloatArray) -> None:
    """Write a vector of the map [m] in a frame turned by `yaw` into two entries of `errors`."""
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    errors[first] = cos * dx + sin * dy
    errors[first + 1] = cos * dy - sin * dx
