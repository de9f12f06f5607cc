"""Extended Kalman filter over the augmented state: start, predict, correct, process; compiled.

Of arrays (4, ...) the first entry is a value, the others are its derivatives by the factors of
`NoiseScale`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtri

from ..errors import InvalidTuning
from ..jit import cached_njit
from ..models.augmented_state import (
    DISTURBANCE_BOUND,
    GYROS,
    INITIAL_SD,
    LENGTH,
    SIZE,
    STATES,
    AugmentedState,
    SensorIndex,
    VehicleParameter,
    advance_augmented_state,
    measure,
    vehicle_parameters,
)
from ..models.kinematics import wrap_angle
from ..types import FloatArray, Input, Measurement, Sensor, State
from ..vehicle import Vehicle
from .noise import SCALE_RANGE, SCALES, ProcessNoise, SensorNoise

_LEVELS: Final = 1 + SCALES
_ENTRIES: Final = SIZE + 2  # of a covariance of `process_noise`
_XY: Final = SIZE
_JOINT: Final = SIZE + 1

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: four times the resolution of a double at Unix time [s]."""

_LONGEST_STEP_S: Final = 0.05  # a third of the front steering's lag


class Model(NamedTuple):
    """Constants of a filter: its vehicle and its noise."""

    parameters: FloatArray  # (10,), see `VehicleParameter`
    rates: FloatArray  # (2, 4, 22), see `ProcessNoise.rates`
    fading: FloatArray  # (2, 15), see `ProcessNoise.fading`
    walk: float  # variance that a metre adds to the logarithms of the factors


class Levels(NamedTuple):
    """What a filter predicts and corrects, all of it in place."""

    augmented: FloatArray  # (4, 22)
    covariances: FloatArray  # (4, 22, 22)
    scales: FloatArray  # (2, 3) factors of `NoiseScale`, information on their logarithms
    valves: FloatArray  # (2,) set points of the steering valves [rad]


@cached_njit()
def steps_over(span_s: float) -> int:
    """Return the number of integration steps over a span of time [s], at least 1."""
    return max(1, math.ceil((span_s - SAME_TIME_S) / _LONGEST_STEP_S))


@cached_njit()
def process_noise(
    middle: FloatArray, scales: FloatArray, model: Model, step_s: float, levels: FloatArray
) -> None:
    """Write the covariance that a step of `step_s` gathers into `levels` (4, 24).

    The same as `ProcessNoise.density` times the step, at the augmented state `middle` (22,): the
    diagonal, then the entries (x, y) and (psi_i, delta_i), the only others.
    """
    parameters, rates = model.parameters, model.rates
    travel = abs(middle[AugmentedState.RIM]) * step_s
    psi_t = middle[AugmentedState.PSI_T]
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    drawbar = parameters[VehicleParameter.DRAWBAR_LENGTH] * math.cos(middle[AugmentedState.DELTA_I])
    swing = -drawbar / (parameters[VehicleParameter.TRAILER_LENGTH] + drawbar)
    for level in range(_LEVELS):
        for i in range(SIZE):
            levels[level, i] = step_s * rates[0, level, i] + travel * rates[1, level, i]
        forward, lateral = levels[level, 0], levels[level, 1]
        levels[level, 0] = forward * cos * cos + lateral * sin * sin
        levels[level, 1] = forward * sin * sin + lateral * cos * cos
        levels[level, _XY] = (forward - lateral) * cos * sin
        joint = levels[level, AugmentedState.DELTA_I]
        levels[level, AugmentedState.PSI_I] += swing * swing * joint
        levels[level, _JOINT] = swing * joint
    for n in range(SCALES):
        for i in range(_ENTRIES):
            levels[0, i] += scales[0, n] * levels[1 + n, i]


@cached_njit()
def _add_half(matrix: FloatArray, noise: FloatArray) -> None:
    """Add half a covariance of `process_noise` (24,) to `matrix` (22, 22)."""
    for i in range(SIZE):
        matrix[i, i] += 0.5 * noise[i]
    matrix[0, 1] += 0.5 * noise[_XY]
    matrix[1, 0] += 0.5 * noise[_XY]
    matrix[AugmentedState.PSI_I, AugmentedState.DELTA_I] += 0.5 * noise[_JOINT]
    matrix[AugmentedState.DELTA_I, AugmentedState.PSI_I] += 0.5 * noise[_JOINT]


@cached_njit()
def _propagate(
    matrix: FloatArray, transition: FloatArray, noise: FloatArray, workspace: FloatArray
) -> None:
    """Replace M by Phi (M + N) Phi' + N; `matrix` M, `transition` Phi are (22, 22).

    N is half of `noise` (24,). The lower rows of Phi are diagonal, most entries of its upper rows
    are 0. The upper rows of Phi (M + N) are written into `workspace` (7, 22).
    """
    size = len(matrix)  # no constant, see `correct`
    _add_half(matrix, noise)
    workspace[:, :] = 0.0
    for i in range(STATES):
        for k in range(size):  # innermost along rows, so that it becomes vector instructions
            weight = transition[i, k]
            if weight != 0.0:
                for j in range(size):
                    workspace[i, j] += weight * matrix[k, j]
    matrix[:STATES, :STATES] = 0.0
    for i in range(STATES, size):
        for j in range(STATES, size):
            matrix[i, j] *= transition[i, i] * transition[j, j]
    _add_half(matrix, noise)
    for i in range(STATES):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(size):
                total += workspace[i, k] * transition[j, k]
            matrix[i, j] = matrix[j, i] = total
        for j in range(STATES, size):
            matrix[i, j] = matrix[j, i] = workspace[i, j] * transition[j, j]


@cached_njit()
def predict(now: Levels, command: FloatArray, model: Model, span_s: float, steps: int) -> None:
    """Advance a filter by `span_s` in `steps` equal steps under the held `command` (3,), in place.

    With Q the noise of a step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q acts before the step, half
    after it.
    """
    augmented, scales = now.augmented, now.scales
    transition = np.empty((SIZE, SIZE))
    gathered, workspace = np.empty((_LEVELS, _ENTRIES)), np.empty((STATES, SIZE))
    middle, derivative = np.empty(SIZE), np.empty(SIZE)
    step_s = span_s / steps
    for _ in range(steps):
        middle[:] = augmented[0]
        advance_augmented_state(
            augmented[0], now.valves, command, model.parameters, model.fading, step_s, transition
        )
        for i in range(STATES):
            middle[i] = 0.5 * (middle[i] + augmented[0, i])
        process_noise(middle, scales, model, step_s, gathered)
        for level in range(_LEVELS):
            _propagate(now.covariances[level], transition, gathered[level], workspace)
        for level in range(1, _LEVELS):
            derivative[:] = augmented[level]
            for i in range(STATES):
                augmented[level, i] = 0.0
                for j in range(SIZE):
                    augmented[level, i] += transition[i, j] * derivative[j]
            for i in range(STATES, SIZE):
                augmented[level, i] *= transition[i, i]
        gained = model.walk * abs(middle[AugmentedState.RIM]) * step_s
        for n in range(SCALES):
            scales[1, n] = scales[1, n] / (1.0 + scales[1, n] * gained)


_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())

_MOST_STEP: Final = 0.5  # of the logarithm of a factor at one sample; assumed


@cached_njit()
def correct(
    now: Levels,
    sensor: int,
    value: tuple[float, float],
    variance: float,
    gate: float,
    forced: bool,
    learns: bool,
    model: Model,
    rows: FloatArray,
    pairs: FloatArray,
) -> tuple[float, float, float, float]:
    """Correct a filter by one sample in place and return its innovation nu, normalised.

    With S = L L' the covariance of nu, that is nu' S^-1 nu, log det S and the two entries of
    L^-1 nu, of which a sample of one number has the first.

    `sensor` is a `SensorIndex` as a number, `value` the sample (of a gyro, the angle turned since
    its last sample and the time since then), `variance` that of each entry. A sample beyond the
    `gate` (chi-square) changes nothing unless it is `forced`: then its noise is raised until it
    just passes. The update has Joseph's form, see `_reduce`; disturbances are clipped to their
    bounds. If it `learns`, the likelihood of the sample updates the factors, see `_learn`. `rows`
    (8, 2, 22) and `pairs` (16, 2) are workspace.
    """
    augmented, covariances, scales = now.augmented, now.covariances, now.scales
    size = augmented.shape[1]  # no constant: loops over one are unrolled before they can be vector
    # instructions
    jacobian, cross = rows[0], rows[1:5]  # cross: H P and its derivatives, rows become vectors
    gain, gain_derivative, workspace = rows[5], rows[6], rows[7]
    for n in range(len(rows)):
        for i in range(size):
            rows[n, 0, i] = rows[n, 1, i] = 0.0
    for n in range(len(pairs)):
        pairs[n, 0] = pairs[n, 1] = 0.0
    reading, weighted = pairs[0], pairs[1]  # weighted: S^-1 nu
    precision, nu = pairs[2:4], pairs[4:8]  # nu: innovation and its derivatives
    spread = pairs[8:16].reshape((_LEVELS, 2, 2))  # S = H P H' + R and its derivatives
    x = augmented[0]
    m = measure(sensor, x, model.parameters, value[1], reading, jacobian)
    for r in range(m):
        nu[0, r] = value[r] - reading[r]
    if (
        sensor == SensorIndex.STEERING_TRACTOR
        or sensor == SensorIndex.STEERING_TRAILER
        or sensor == SensorIndex.HITCH
    ):
        nu[0, 0] -= 2.0 * math.pi * round(nu[0, 0] / (2.0 * math.pi))
    for level in range(_LEVELS):
        for r in range(m):
            for k in range(size):
                weight = jacobian[r, k]
                if weight != 0.0:
                    for i in range(size):
                        cross[level, r, i] += covariances[level, k, i] * weight
        for r in range(m):
            for c in range(m):
                for k in range(size):
                    spread[level, r, c] += jacobian[r, k] * cross[level, c, k]
    for r in range(m):
        spread[0, r, r] += variance
    root = math.sqrt(spread[0, 0, 0])
    first, second, determinant = nu[0, 0] / root, 0.0, spread[0, 0, 0]
    if m == 1:
        precision[0, 0] = 1.0 / determinant
    else:
        determinant = spread[0, 0, 0] * spread[0, 1, 1] - spread[0, 0, 1] * spread[0, 1, 0]
        precision[0, 0] = spread[0, 1, 1] / determinant
        precision[1, 1] = spread[0, 0, 0] / determinant
        precision[0, 1] = precision[1, 0] = -spread[0, 0, 1] / determinant
        second = (nu[0, 1] - spread[0, 1, 0] / root * first) * root / math.sqrt(determinant)
    normalised = 0.0
    for r in range(m):
        for c in range(m):
            weighted[r] += precision[r, c] * nu[0, c]
        normalised += weighted[r] * nu[0, r]
    result = normalised, math.log(determinant), first, second
    factor = 1.0  # by which S is raised, all of it through the noise
    if not normalised <= gate:
        if not forced:
            return result
        factor = normalised / gate
    for level in range(1, _LEVELS):
        for r in range(m):
            for k in range(size):
                nu[level, r] -= jacobian[r, k] * augmented[level, k]
    if factor == 1.0 and learns:
        for n in range(SCALES):
            _learn(scales[:, n], SCALE_RANGE[n], precision, spread[1 + n], weighted, nu[1 + n], m)
    for r in range(m):
        for c in range(m):
            weight = precision[c, r] / factor
            for i in range(size):
                gain[r, i] += cross[0, c, i] * weight
        for i in range(size):
            x[i] += gain[r, i] * nu[0, r]
    for i in range(STATES, size):
        x[i] = min(max(x[i], -_BOUND[i - STATES]), _BOUND[i - STATES])
    for level in range(1, _LEVELS):
        for i in range(size):
            gain_derivative[0, i] = gain_derivative[1, i] = 0.0
        for c in range(m):
            rest = workspace[0]
            for i in range(size):
                rest[i] = cross[level, c, i]
            for q in range(m):
                weight = spread[level, q, c]
                for i in range(size):
                    rest[i] -= gain[q, i] * weight
            for r in range(m):
                weight = precision[c, r] / factor
                for i in range(size):
                    gain_derivative[r, i] += rest[i] * weight
        for r in range(m):
            by_gain, by_derivative = nu[level, r], nu[0, r]
            for i in range(size):
                augmented[level, i] += gain[r, i] * by_gain + gain_derivative[r, i] * by_derivative
        _reduce(covariances[level], gain, cross[level], spread[level], m, workspace)
    for r in range(m):
        for c in range(m):
            spread[0, r, c] *= factor
    _reduce(covariances[0], gain, cross[0], spread[0], m, workspace)
    return result


@cached_njit()
def _learn(
    scale: FloatArray,
    allowed: tuple[float, float],
    precision: FloatArray,
    spread_derivative: FloatArray,
    weighted: FloatArray,
    innovation_derivative: FloatArray,
    m: int,
) -> None:
    """Update a factor s and the information I on its logarithm, `scale` (2,), by a sample.

    For nu ~ N(0, S) with derivatives dS and dnu by s (Astrom 1980),

        score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2 - nu' S^-1 dnu
        information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu,

    s^2 times this information is gathered in I, and s <- s (1 + s score / I), within the range
    `allowed`.
    """
    score, information = 0.0, 0.0
    for r in range(m):
        score -= weighted[r] * innovation_derivative[r]
        for c in range(m):
            score += 0.5 * weighted[r] * spread_derivative[r, c] * weighted[c]
            information += innovation_derivative[r] * precision[r, c] * innovation_derivative[c]
            one, other = 0.0, 0.0  # S^-1 dS at (r, c) and (c, r)
            for q in range(m):
                one += precision[r, q] * spread_derivative[q, c]
                other += precision[c, q] * spread_derivative[q, r]
            information += 0.5 * one * other
            if r == c:
                score -= 0.5 * one
    scale[1] += scale[0] * scale[0] * information
    step = min(max(scale[0] * score / scale[1], -_MOST_STEP), _MOST_STEP)
    scale[0] = min(max(scale[0] * (1.0 + step), allowed[0]), allowed[1])


@cached_njit()
def _reduce(
    matrix: FloatArray,
    gain: FloatArray,
    cross: FloatArray,
    spread: FloatArray,
    m: int,
    half: FloatArray,
) -> None:
    """Replace M (22, 22) by (I - K H) M (I - K H)' + K R K', written as M + K W' + W K'.

    `gain` K' (2, 22), `cross` C' = H M (2, 22), `spread` S = H M H' + R (2, 2), W = K S / 2 - C,
    written into `half` W' (2, 22). The sum is symmetric, and right for any K. Of the two
    measurements the first `m` are used.
    """
    size = len(matrix)
    for r in range(m):
        for i in range(size):
            half[r, i] = -cross[r, i]
        for c in range(m):
            for i in range(size):
                half[r, i] += 0.5 * gain[c, i] * spread[c, r]
    for i in range(size):
        for r in range(m):
            by_gain, by_half = gain[r, i], half[r, i]  # for the compiler: `matrix` is not they
            for j in range(size):
                matrix[i, j] += by_gain * half[r, j] + by_half * gain[r, j]


# Begin of each part in the row of a state, see `FilterState`; the time [s] is its first entry.
AUGMENTED: Final = 1
COVARIANCES: Final = AUGMENTED + (1 + SCALES) * SIZE
LEARNT_SCALES: Final = COVARIANCES + (1 + SCALES) * SIZE * SIZE
VALVES: Final = LEARNT_SCALES + 2 * SCALES
REJECTED_SINCE: Final = VALVES + 2
IMUS: Final = REJECTED_SINCE + len(SensorIndex)
ROW: Final = IMUS + 2 * 4
"""Entries of a row."""

_PATIENCE_S: Final = 1.0  # for which the gate may reject a sensor
_LONGEST_SPAN_S: Final = 0.1  # between samples of a gyro, for their mean to be that of the rate


@cached_njit()
def predict_until(
    now: Levels,
    since_s: float,
    until_s: float,
    ends_s: FloatArray,
    commands: FloatArray,
    model: Model,
) -> None:
    """Advance a filter from `since_s` to `until_s` under the commands held in between, in place.

    Command n of `commands` (m, 3) ends at `ends_s[n]`; where an entry is NaN, that steering or the
    speed is taken as constant.
    """
    command = np.empty(3)
    for n in range(len(ends_s)):
        if until_s - since_s <= SAME_TIME_S:
            break
        if ends_s[n] > since_s + SAME_TIME_S:
            end_s = ends_s[n] if ends_s[n] < until_s - SAME_TIME_S else until_s
            command[:] = commands[n]
            for i in range(len(now.valves)):
                if math.isnan(command[i]):
                    command[i] = now.valves[i]
            if math.isnan(command[Input.HP]):
                rim = now.augmented[0, AugmentedState.RIM]
                command[Input.HP] = rim / model.parameters[VehicleParameter.SPEED_GAIN]
            span_s = end_s - since_s
            predict(now, command, model, span_s, steps_over(span_s))
            since_s = end_s


@cached_njit()
def _turned(last: FloatArray, sample: FloatArray) -> float:
    """Return the angle by which the heading turned between two samples of an IMU [rad].

    `last` is (4,) as in `process`, `sample` (5,). The yaw rate w of an IMU is that about the
    vertical; a vehicle that rolls while it stands at a pitch changes its heading beside it. From
    the angular velocity of the angles yaw, pitch and roll (Diebel 2006, sec. 5.6),

        psi' = w + roll' sin(pitch).

    The integral of the second term keeps no memory of the noise of roll.
    """
    pitch = 0.5 * (last[3] + sample[4])
    rate = 0.5 * (last[1] + sample[2])
    return rate * (sample[0] - last[0]) + (sample[3] - last[2]) * math.sin(pitch)


@cached_njit()
def _keep_yaw(now: Levels, body: int) -> None:
    """Make the yaw of a body, 0 or 1, that at the last sample of its gyro (`PAST_*`), in place."""
    psi, past = AugmentedState.PSI_T + body, AugmentedState.PAST_T + body
    for level in range(_LEVELS):
        now.augmented[level, past] = now.augmented[level, psi]
        covariance = now.covariances[level]
        for i in range(SIZE):
            covariance[past, i] = covariance[psi, i]
        for i in range(SIZE):
            covariance[i, past] = covariance[i, psi]


@cached_njit()
def process(
    states: FloatArray,
    samples: FloatArray,
    variances: FloatArray,
    gates: FloatArray,
    ends_s: FloatArray,
    commands: FloatArray,
    model: Model,
    sampling: float,
    results: FloatArray,
) -> None:
    """Predict and correct a filter through all `samples` (n, 5), which are in order of time.

    A sample is its time [s], its `SensorIndex` and its value of one to three entries. Of the
    `states` (k, `ROW`), see `FilterState`, the first is that of the start; one after the other is
    filled with the state after all samples of one time. `variances` and `gates` (sensors,) are
    those of each entry of a sample, `sampling` that of the yaw of a gyro over a metre. `results`
    (n, 5) receives what `correct` returns, and whether the sample was accepted. All else is as in
    `predict_until`.
    """
    rows, pairs = np.empty((8, 2, SIZE)), np.empty((16, 2))
    k = 0
    state = states[k]
    for n in range(len(samples)):
        time_s, sensor = samples[n, 0], int(samples[n, 1])
        begins = n == 0 or time_s > state[0]
        if begins:
            k += 1
            state = states[k]
            state[:] = states[k - 1]
            state[0] = time_s
        now = Levels(
            state[AUGMENTED:COVARIANCES].reshape((_LEVELS, SIZE)),
            state[COVARIANCES:LEARNT_SCALES].reshape((_LEVELS, SIZE, SIZE)),
            state[LEARNT_SCALES:VALVES].reshape((2, SCALES)),
            state[VALVES:REJECTED_SINCE],
        )
        if begins:
            predict_until(now, states[k - 1, 0], time_s, ends_s, commands, model)
        value, variance = (samples[n, 2], samples[n, 3]), variances[sensor]
        gyro = sensor >= SensorIndex.IMU_TRACTOR
        if gyro:
            body = sensor - SensorIndex.IMU_TRACTOR
            last = state[IMUS + 4 * body : IMUS + 4 * body + 4]
            span_s = time_s - last[0]
            value = _turned(last, samples[n]), span_s
            travel = abs(now.augmented[0, AugmentedState.RIM]) * span_s
            variance = variance * span_s * span_s + sampling * travel
            last[0], last[1:] = time_s, samples[n, 2:]
            if not span_s <= _LONGEST_SPAN_S:
                _keep_yaw(now, body)
                results[n, :] = 0.0
                continue
        rejected = state[REJECTED_SINCE:IMUS]
        gate = gates[sensor]
        forced = time_s - rejected[sensor] >= _PATIENCE_S - SAME_TIME_S
        result = correct(now, sensor, value, variance, gate, forced, not gyro, model, rows, pairs)
        if gyro:
            _keep_yaw(now, sensor - SensorIndex.IMU_TRACTOR)
        inside = result[0] <= gate
        if inside:
            rejected[sensor] = math.nan
        elif math.isnan(rejected[sensor]):
            rejected[sensor] = time_s
        results[n, :4] = result
        results[n, 4] = inside or forced


def first_state(
    readings: Mapping[Sensor, Measurement], vehicle: Vehicle, noise: SensorNoise
) -> tuple[FloatArray, FloatArray]:
    """Return state (7,) and covariance (7, 7) from one reading of every sensor.

    The heading follows from the line between the two GNSS points: in the tractor's frame it is

        b = (a + d cos(beta) + L_i cos(beta + delta_i), -d sin(beta) - L_i sin(beta + delta_i)),

    so psi_t is the direction of the line less the direction of b. The covariance is that of the
    readings, carried through this map to first order. The standard deviation of a position that is
    older than the newest reading grows by the distance travelled since.
    """
    value = {sensor: reading.value for sensor, reading in readings.items()}
    (x, y), (x_i, y_i) = value[Sensor.GNSS_TRACTOR], value[Sensor.GNSS_TRAILER]
    (delta_t,), (delta_i,) = value[Sensor.STEERING_TRACTOR], value[Sensor.STEERING_TRAILER]
    (beta,), (v,) = value[Sensor.HITCH], value[Sensor.ENCODER]
    a, d, length_i = vehicle.hitch_offset, vehicle.drawbar_length, vehicle.trailer_length
    dx, dy = x - x_i, y - y_i
    trailer_x, trailer_y = length_i * math.cos(beta + delta_i), -length_i * math.sin(beta + delta_i)
    b_x, b_y = a + d * math.cos(beta) + trailer_x, trailer_y - d * math.sin(beta)
    psi_t = wrap_angle(math.atan2(dy, dx) - math.atan2(b_y, b_x))
    psi_i = psi_t - beta - delta_i
    state = np.array([x, y, psi_t, psi_i, delta_t, delta_i, v])

    line_squared, b_squared = dx**2 + dy**2, b_x**2 + b_y**2
    by_x, by_y = -dy / line_squared, dx / line_squared
    by_beta = (b_x * (b_x - a) + b_y * b_y) / b_squared  # minus d(direction of b) / d(beta)
    by_delta_i = (b_x * trailer_x + b_y * trailer_y) / b_squared
    # Columns: x, y, x_i, y_i, delta_t, delta_i, beta, v.
    jacobian = np.zeros((7, 8))
    jacobian[State.X, 0] = jacobian[State.Y, 1] = 1.0
    jacobian[State.PSI_T] = by_x, by_y, -by_x, -by_y, 0.0, by_delta_i, by_beta, 0.0
    jacobian[State.PSI_I] = jacobian[State.PSI_T]
    jacobian[State.PSI_I, 5:7] -= 1.0
    jacobian[State.DELTA_T, 4] = jacobian[State.DELTA_I, 5] = jacobian[State.V, 7] = 1.0

    newest = max(reading.time_s for reading in readings.values())
    variances: list[float] = []
    for sensor, length in LENGTH.items():
        travel = v * (newest - readings[sensor].time_s) if length == 2 else 0.0
        variances += [noise.of(sensor) ** 2 + travel**2] * length
    return state, (jacobian * variances) @ jacobian.T


HeldCommands = list[tuple[float, FloatArray | None]]
"""End time [s] and value (3,) of each of the commands held one after the other; the first one was
held before, too. NaN where an input's command is not known; None where none is."""


def after_dead_times(
    sent: Sequence[tuple[float, FloatArray | None]], vehicle: Vehicle
) -> HeldCommands:
    """Return what acts on `vehicle` until the end of the newest of the commands `sent`."""
    dead_times = vehicle.dead_times
    if not sent or not dead_times.any():
        return list(sent)
    ends_s = np.array([end_s for end_s, _ in sent])
    unknown = np.full(len(Input), np.nan)
    values = np.array([unknown if command is None else command for _, command in sent])
    changes_s = np.unique(np.append(ends_s[:, None] + dead_times, ends_s[-1]))
    changes_s = changes_s[changes_s <= ends_s[-1]]
    # What acts just before a change was sent a dead time earlier.
    index = np.searchsorted(ends_s, changes_s[:, None] - dead_times - SAME_TIME_S)
    acting = values[index, range(len(Input))]
    return list(zip(changes_s.tolist(), acting, strict=True))


SampleRow = tuple[float, int, float, float, float]
"""Time [s], `SensorIndex` and value of a sample, entries that it does not have with any number."""

_UNKNOWN: Final = np.full(len(Input), math.nan)
_LEAST_VARIANCE: Final = 1e-12  # of an entry without uncertainty: covariances are invertible


def _part(begin: int, end: int, *shape: int) -> property:
    return property(lambda state: state.row[begin:end].reshape(shape))


class FilterState:
    """All that a filter carries from one time to the next; `KalmanFilter` changes it in place."""

    __slots__ = ("row",)

    def __init__(self, row: FloatArray) -> None:
        self.row = row

    augmented = _part(AUGMENTED, COVARIANCES, _LEVELS, SIZE)
    covariances = _part(COVARIANCES, LEARNT_SCALES, _LEVELS, SIZE, SIZE)
    scales = _part(LEARNT_SCALES, VALVES, 2, SCALES)
    valves = _part(VALVES, REJECTED_SINCE, 2)
    rejected_since = _part(REJECTED_SINCE, IMUS, -1)  # without a break [s] by `SensorIndex`, or NaN
    gyros = _part(IMUS, ROW, 2, 4)  # last samples: time [s], yaw rate, roll, pitch, or NaN

    @property
    def time_s(self) -> float:
        """Time of the state [s]."""
        return self.row.item(0)

    @time_s.setter
    def time_s(self, time_s: float) -> None:
        self.row[0] = time_s

    @property
    def levels(self) -> Levels:
        """The parts that are predicted and corrected."""
        return Levels(self.augmented, self.covariances, self.scales, self.valves)

    def copy(self) -> FilterState:
        return FilterState(self.row.copy())


class KalmanFilter:
    """Extended Kalman filter without memory: every step takes and changes a `FilterState`.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensor_noise: SensorNoise,
        process_noise: ProcessNoise,
        gate_probability: float,
    ) -> None:
        if not 0.0 < gate_probability < 1.0:
            raise InvalidTuning(f"gate_probability: got {gate_probability}, must be in (0, 1)")
        self._vehicle = vehicle
        self._sensor_noise = sensor_noise
        self._process_noise = process_noise
        self.model = Model(
            vehicle_parameters(vehicle),
            process_noise.rates(sensor_noise),
            process_noise.fading(sensor_noise),
            process_noise.scale_walk**2,
        )
        lengths = {**LENGTH, **dict.fromkeys(GYROS, 1)}
        self._variances = np.array([float(sensor_noise.of(sensor)) ** 2 for sensor in lengths])
        self._gates = np.array([float(chdtri(m, gate_probability)) for m in lengths.values()])

    def start(self, readings: Mapping[Sensor, Measurement]) -> FilterState:
        """Return the state that follows from one reading of every sensor, at the newest of them."""
        whole_error = replace(self._sensor_noise, gnss_white_share=1.0)
        state, covariance = first_state(readings, self._vehicle, whole_error)
        slow = max(self._sensor_noise.difference_variance, _LEAST_VARIANCE)
        start = FilterState(np.zeros(ROW))
        start.time_s = max(reading.time_s for reading in readings.values())
        start.augmented[0, :STATES] = state
        bias = max(self._sensor_noise.yaw_rate_bias**2, _LEAST_VARIANCE)
        others = [slow, slow, bias, bias, _LEAST_VARIANCE, _LEAST_VARIANCE]
        start.covariances[0] = np.diag([*np.zeros(STATES), *INITIAL_SD**2, *others])
        start.covariances[0, :STATES, :STATES] = covariance
        noise = self._process_noise
        start.scales[:] = noise.scales, np.full(SCALES, noise.scale_sd**-2)
        start.valves[:] = state[AugmentedState.DELTA_T : AugmentedState.RIM]
        start.rejected_since[:] = math.nan
        start.gyros[:] = math.nan
        return start

    def predict(self, state: FilterState, time_s: float, held: HeldCommands) -> None:
        """Advance `state` to `time_s` in place under the commands `held` since its time."""
        ends_s, commands = _arrays(held)
        predict_until(
            state.levels, float(state.time_s), float(time_s), ends_s, commands, self.model
        )
        state.time_s = time_s

    def process(
        self, start: FilterState, samples: Sequence[SampleRow], held: HeldCommands
    ) -> tuple[FloatArray, list[FilterState]]:
        """Return the results of `samples`, (n, 5), and the states after all samples of each time.

        A sample corrects the state at its time, unless the gate rejects it. The results are those
        of `correct`, then 1 or 0 for accepted or not. There is a sample at least; they are in order
        of time, none is before the state `start`, which stays as it is; the commands `held` begin
        there.
        """
        ends_s, commands = _arrays(held)
        rows = np.fromiter(chain.from_iterable(samples), float).reshape(-1, 5)
        count = 1 + len({row[0] for row in samples})
        states, results = np.empty((count, ROW)), np.empty((len(rows), 5))
        states[0] = start.row
        process(
            states,
            rows,
            self._variances,
            self._gates,
            ends_s,
            commands,
            self.model,
            self._process_noise.gyro_sampling**2,
            results,
        )
        return results, [FilterState(state) for state in states[1:]]


def _arrays(held: HeldCommands) -> tuple[FloatArray, FloatArray]:
    """Return end times (m,) [s] and commands (m, 3), NaN where a command is not known."""
    commands = [_UNKNOWN if command is None else command for _, command in held]
    return np.array([end_s for end_s, _ in held]), np.array(commands).reshape(-1, len(Input))
