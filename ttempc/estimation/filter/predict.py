"""Prediction of a snapshot: state, covariance and their derivatives by the noise factors."""

from __future__ import annotations

import math
from typing import Final

from ...jit import cached_njit, local, record
from ...jit.rows import WIDTH, add_row, clear_row, scale_row, set_row
from ...models.augmented_state import (
    MAPPED,
    SIZE,
    STATES,
    AugmentedState,
    VehicleParameter,
    advance_augmented_state,
)
from ...types import FloatArray, Input
from ..noise import SCALES
from .records import FILTER, LEVELS, SAME_TIME_S, SNAPSHOT, matrix_row

LONGEST_STEP_S: Final = 0.05
"""Longest step of integration [s]: a third of the front steering's lag."""

# Entries of a row of process noise: the diagonal, and in the place of the past yaws, which gather
# no noise, the two covariances that are not 0: of (x, y) and of (psi_i, delta_i).
_XY: Final = int(AugmentedState.PAST_T)
_JOINT: Final = int(AugmentedState.PAST_I)

_LANES: Final = 8  # columns of each level where all levels stand side by side
_SIDE_BY_SIDE: Final = 2 * WIDTH  # at least `LEVELS` times `_LANES`, in whole rows

INPUTS: Final = len(Input)
COMMAND_SIZE: Final = 1 + INPUTS + MAPPED
"""Columns of a command: end of the period in which it was sent [s], its inputs, NaN where one is
not known, and by how much a map of the field lets the first `MAPPED` disturbances change over that
period [rad]."""
END: Final = 0
_FIRST_INPUT: Final = 1
_FIRST_CHANGE: Final = 1 + INPUTS
_SLIPS: Final = int(AugmentedState.SLIP_T)  # the first of the mapped disturbances

# Walk of the wheel speed where the hydrostat is not known [(m/s)/sqrt(s)], in a second a tenth of a
# working speed; assumed
_UNKNOWN_DRIVE: Final = 0.1
_STANDS_MPS: Final = 0.05  # below it nothing is added: before the first command a vehicle stands


@cached_njit()
def steps_over(span_s: float) -> int:
    """Return the number of integration steps over a span of time [s], at least 1."""
    return max(1, math.ceil((span_s - SAME_TIME_S) / LONGEST_STEP_S))


@cached_njit(error_model="numpy")
def predict(
    parameters: FloatArray, snapshot: FloatArray, command: FloatArray, span_s: float, steps: int
) -> None:
    """Advance a `SNAPSHOT`, but for its time, by `span_s` in `steps` equal steps, in place.

    `command` (3,) is constant. With Q the noise of a step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q
    acts before the step, half after it.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    x = now.augmented[0]
    transition = local((SIZE, WIDTH))  # Phi, of one step
    noise = local((LEVELS, WIDTH))  # Q/2, see `_write_noise`
    middle = local((STATES,))  # state in the middle of a step
    side_by_side = local((SIZE, _SIDE_BY_SIDE))  # workspace of `_write_corner`
    for k in range(2 * SIZE):
        clear_row(side_by_side, k * WIDTH)

    step_s = span_s / steps
    for _ in range(steps):
        for i in range(STATES):
            middle[i] = x[i]
        advance_augmented_state(x, now.valves, command, f.vehicle, f.fading, step_s, transition)
        for i in range(STATES):
            middle[i] = 0.5 * (middle[i] + x[i])
        travel = abs(middle[AugmentedState.WHEEL_SPEED]) * step_s
        _write_noise(parameters, snapshot, middle, step_s, travel, noise)

        for level in range(LEVELS):
            _add_noise(now.covariances[level], noise[level])
        _propagate_covariances(snapshot, transition, side_by_side)
        for level in range(LEVELS):
            _add_noise(now.covariances[level], noise[level])

        # Information on the logarithms of the factors fades as they walk
        gained = f.walk * travel
        for n in range(SCALES):
            now.information[n] = now.information[n] / (1.0 + now.information[n] * gained)


@cached_njit(error_model="numpy")
def _write_noise(
    parameters: FloatArray,
    snapshot: FloatArray,
    middle: FloatArray,
    step_s: float,
    travel: float,
    noise: FloatArray,
) -> None:
    """Write half of the process noise of a step, (4, 24): of all factors, then by each factor.

    A row has the diagonal and, at `_XY` and `_JOINT`, two covariances. Positions have noise along
    and across the tractor, which is turned into the map. Turning RJ2 by its noise swings trailer
    and drawbar against each other.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    psi_t = middle[AugmentedState.PSI_T]
    cos = math.cos(psi_t)
    sin = math.sin(psi_t)
    drawbar = f.vehicle[VehicleParameter.DRAWBAR_LENGTH] * math.cos(middle[AugmentedState.DELTA_I])
    trailer = f.vehicle[VehicleParameter.TRAILER_LENGTH]
    trailer += f.vehicle[VehicleParameter.TRAILER_TURNING_OFFSET]
    swing = -drawbar / (trailer + drawbar)  # d psi_i / d delta_i
    for level in range(LEVELS):
        for i in range(SIZE):
            variance = step_s * f.rates[0, level, i] + travel * f.rates[1, level, i]
            noise[level, i] = 0.5 * variance
        forward = noise[level, AugmentedState.X]
        lateral = noise[level, AugmentedState.Y]
        noise[level, AugmentedState.X] = forward * cos * cos + lateral * sin * sin
        noise[level, AugmentedState.Y] = forward * sin * sin + lateral * cos * cos
        noise[level, _XY] = (forward - lateral) * cos * sin
        joint = noise[level, AugmentedState.DELTA_I]
        noise[level, AugmentedState.PSI_I] += swing * swing * joint
        noise[level, _JOINT] = swing * joint

    # The noise itself: the fixed part and, with its factor, the part of each factor
    for n in range(SCALES):
        add_row(noise, 0, now.scales[n], noise, (1 + n) * WIDTH)


@cached_njit(error_model="numpy")
def _add_noise(matrix: FloatArray, noise: FloatArray) -> None:
    """Add a row of noise (24,), see `_write_noise`, to a covariance."""
    for i in range(_XY):
        matrix[i, i] += noise[i]
    matrix[AugmentedState.X, AugmentedState.Y] += noise[_XY]
    matrix[AugmentedState.Y, AugmentedState.X] += noise[_XY]
    matrix[AugmentedState.PSI_I, AugmentedState.DELTA_I] += noise[_JOINT]
    matrix[AugmentedState.DELTA_I, AugmentedState.PSI_I] += noise[_JOINT]


@cached_njit(error_model="numpy")
def _propagate_covariances(
    snapshot: FloatArray, transition: FloatArray, side_by_side: FloatArray
) -> None:
    """Write Phi P Phi' over each P, and Phi dx over the derivatives dx of the state.

    Phi = [[A, B], [0, F]]: the first 7 rows move the states, F is the diagonal fading of the 17
    disturbances and offsets. P_22 is their block of P. With U = [A B] P, the upper rows of Phi P,

        Phi P Phi' = [[[A B] U', U_2 F], [F U_2', F P_22 F]],   U_2: last 17 columns of U.

    `side_by_side` is the workspace of `_write_corner`.
    """
    now = record(snapshot, SNAPSHOT)
    upper = local((LEVELS, STATES, WIDTH))  # U of each level
    corner = local((STATES, _SIDE_BY_SIDE))  # [A B] U' of all levels
    fade = local((WIDTH,))  # 0 for the states, then the diagonal of F
    clear_row(fade, 0)
    for i in range(STATES, SIZE):
        fade[i] = transition[i, i]
    _write_upper(snapshot, transition, fade, upper)
    _write_corner(transition, upper, side_by_side, corner)

    for level in range(LEVELS):
        covariance = now.covariances[level]
        # Lower right block F P_22 F, lower left block F U_2'
        for i in range(STATES, SIZE):
            by = fade[i]
            scale_row(now.covariances, matrix_row(level, SIZE, i), by, fade, 0)
            for j in range(STATES):
                covariance[i, j] = upper[level, j, i] * by
        # Upper right block U_2 F
        for i in range(STATES):
            to = matrix_row(level, SIZE, i)
            set_row(now.covariances, to, 1.0, upper, matrix_row(level, STATES, i))
            scale_row(now.covariances, to, 1.0, fade, 0)
        # Upper left block [A B] U', its lower triangle in both
        for i in range(STATES):
            for j in range(i + 1):
                value = corner[i, _LANES * level + j]
                covariance[i, j] = value
                covariance[j, i] = value


@cached_njit(error_model="numpy")
def _write_upper(
    snapshot: FloatArray, transition: FloatArray, fade: FloatArray, upper: FloatArray
) -> None:
    """Write U = [A B] P of each level (4, 7, 24), and Phi dx over the derivatives dx."""
    now = record(snapshot, SNAPSHOT)
    change = local((LEVELS, STATES))  # [A B] dx
    for level in range(LEVELS):
        for i in range(STATES):
            clear_row(upper, matrix_row(level, STATES, i))
            change[level, i] = 0.0
    for k in range(SIZE):  # innermost over rows, so that no sum waits for the one before
        for i in range(STATES):
            weight = transition[i, k]
            if weight != 0.0:
                for level in range(LEVELS):
                    to = matrix_row(level, STATES, i)
                    at = matrix_row(level, SIZE, k)
                    add_row(upper, to, weight, now.covariances, at)
                    change[level, i] += weight * now.augmented[level, k]

    # Level 0 is the state itself, which was advanced before
    for level in range(1, LEVELS):
        for i in range(STATES):
            now.augmented[level, i] = change[level, i]
        for i in range(STATES, SIZE):
            now.augmented[level, i] *= fade[i]


@cached_njit(error_model="numpy")
def _write_corner(
    transition: FloatArray, upper: FloatArray, side_by_side: FloatArray, corner: FloatArray
) -> None:
    """Write [A B] U' of all levels side by side, (7, 48), as one product of whole rows.

    Row k of `side_by_side` (24, 48) is column k of U of every level, at `_LANES` times the level;
    it must be zero elsewhere.
    """
    for i in range(STATES):
        clear_row(corner, 2 * i * WIDTH)
        clear_row(corner, (2 * i + 1) * WIDTH)
        for level in range(LEVELS):
            for k in range(SIZE):
                side_by_side[k, _LANES * level + i] = upper[level, i, k]
    for k in range(SIZE):
        for i in range(STATES):
            weight = transition[i, k]
            if weight != 0.0:
                add_row(corner, 2 * i * WIDTH, weight, side_by_side, 2 * k * WIDTH)
                add_row(corner, (2 * i + 1) * WIDTH, weight, side_by_side, (2 * k + 1) * WIDTH)


@cached_njit(error_model="numpy")
def acting(
    parameters: FloatArray, commands: FloatArray, count: int, time_s: float, command: FloatArray
) -> float:
    """Write the command (3,) that acts just after `time_s`; return until when it does [s].

    Of the rows `commands` (n, `COMMAND_SIZE`) the first `count` are in use. The first one
    acts for all earlier time too. Each input acts its own dead time later (`Vehicle.dead_times`).
    """
    f = record(parameters, FILTER)
    until_s = math.inf
    for j in range(INPUTS):
        dead_time = f.vehicle[VehicleParameter.DEAD_TIME_T + j]
        n = 0
        while n < count - 1 and commands[n, END] + dead_time <= time_s + SAME_TIME_S:
            n += 1
        command[j] = commands[n, _FIRST_INPUT + j]
        if n < count - 1:
            until_s = min(until_s, commands[n, END] + dead_time)
    return until_s


@cached_njit(error_model="numpy")
def predict_until(
    parameters: FloatArray, snapshot: FloatArray, commands: FloatArray, count: int, until_s: float
) -> None:
    """Advance a `SNAPSHOT` to `until_s` in place under the commands of the time in between.

    The commands are as in `acting`. Where an input is not known, that steering or the speed is
    constant. Of the changes over a command's period, a part of the period has its share: half of
    that acts before the prediction, half after it.
    """
    now = record(snapshot, SNAPSHOT)
    command = local((INPUTS,))
    half = local((MAPPED,))
    while until_s - now.time_s > SAME_TIME_S:
        end_s = acting(parameters, commands, count, now.time_s, command)
        end_s = _half_changes(commands, count, now.time_s, end_s, until_s, half)
        if end_s >= until_s - SAME_TIME_S:
            end_s = until_s
        span_s = end_s - now.time_s
        _keep_unknown_inputs(parameters, snapshot, command, span_s)
        for i in range(MAPPED):
            now.augmented[0, _SLIPS + i] += half[i]
        predict(parameters, snapshot, command, span_s, steps_over(span_s))
        for i in range(MAPPED):
            now.augmented[0, _SLIPS + i] += half[i]
        now.time_s = end_s
    now.time_s = until_s


@cached_njit(error_model="numpy")
def _half_changes(
    commands: FloatArray, count: int, time_s: float, end_s: float, until_s: float, half: FloatArray
) -> float:
    """Write half of the changes (3,) of the mapped disturbances from `time_s` on.

    Return until when to predict [s]: `end_s`, or the end of the command's period with changes if it
    is earlier.
    """
    n = 1  # the command in whose period `time_s` is
    while n < count - 1 and commands[n, END] <= time_s + SAME_TIME_S:
        n += 1
    changes = False
    for i in range(MAPPED):
        half[i] = 0.0
        changes = changes or (n < count and commands[n, _FIRST_CHANGE + i] != 0.0)
    if not changes:
        return end_s
    if commands[n, END] > time_s + SAME_TIME_S:
        end_s = min(end_s, commands[n, END])
    period_s = max(commands[n, END] - commands[n - 1, END], SAME_TIME_S)
    half_share = 0.5 * (min(end_s, until_s) - time_s) / period_s
    for i in range(MAPPED):
        half[i] = half_share * commands[n, _FIRST_CHANGE + i]
    return end_s


@cached_njit(error_model="numpy")
def _keep_unknown_inputs(
    parameters: FloatArray, snapshot: FloatArray, command: FloatArray, span_s: float
) -> None:
    """Replace inputs of a command (3,) that are NaN by those that change nothing.

    The speed of a vehicle that rolls without a known hydrostat may change by itself: its variance
    grows over the span [s].
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    for i in range(Input.HP):
        if math.isnan(command[i]):
            command[i] = now.valves[i]
    if math.isnan(command[Input.HP]):
        wheel_speed = now.augmented[0, AugmentedState.WHEEL_SPEED]
        drive = now.augmented[0, AugmentedState.DRIVE]
        lost = f.vehicle[VehicleParameter.SPEED_TIME_CONSTANT] * drive
        command[Input.HP] = (wheel_speed - lost) / f.vehicle[VehicleParameter.SPEED_GAIN]
        if abs(wheel_speed) > _STANDS_MPS:
            own = now.covariances[0, AugmentedState.WHEEL_SPEED]
            own[AugmentedState.WHEEL_SPEED] += _UNKNOWN_DRIVE**2 * span_s
