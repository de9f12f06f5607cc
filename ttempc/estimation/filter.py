"""Extended Kalman filter over the augmented state: predict, correct, observe; compiled.

Of arrays (4, ...) the first entry is a value, the others are its derivatives by the factors of
`NoiseScale`. A row has 24 entries, three vectors of eight numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from ..errors import InvalidTuning
from ..jit import cached_njit, local, record
from ..jit.rows import WIDTH, add_row, add_rows, clear_row, scale_row, set_row
from ..layout import ESTIMATE, FLOAT
from ..models.augmented_state import (
    DISTURBANCE_BOUND,
    INITIAL_SD,
    MAPPED,
    SIZE,
    STATES,
    AugmentedState,
    VehicleParameter,
    advance_augmented_state,
    vehicle_parameters,
    write_estimate,
)
from ..models.kinematics import wrap_angle
from ..models.measurement import measure
from ..sensors import INNOVATION_SIZES, STARTING_SENSORS, SensorIndex
from ..types import FloatArray, Input, Measurement, Sensor, State
from ..vehicle import Vehicle
from .noise import SCALE_RANGE, SCALES, ProcessNoise, SensorNoise

_LEVELS: Final = 1 + SCALES
_CROSS: Final = 2 * WIDTH  # begin of parts of the workspace of `correct`
_HALF: Final = 10 * WIDTH
# Of a row of process noise: entries (x, y) and (psi_i, delta_i). The past yaws gather no noise.
_XY: Final = int(AugmentedState.PAST_T)
_JOINT: Final = int(AugmentedState.PAST_I)
_SENSORS: Final = len(SensorIndex)
_INPUTS: Final = len(Input)
_CHANGE: Final = 1 + _INPUTS  # column of a row of commands: see `predict_until`
_SIDE: Final = int(AugmentedState.SIDE_X)
_SLIPS: Final = int(AugmentedState.SLIP_T)  # the first of the mapped disturbances
_UNWEIGHED: Final = int(SensorIndex.IMU_TRACTOR)  # the first sensor without a reading at the start

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: four times the resolution of a double at Unix time [s]."""

LONGEST_GAP_S: Final = 1.0
"""Without update and sample for longer [s], the filter starts anew, see `observe_filter`."""

_SPACING_S: Final = 0.15  # of moments: they keep up with samples where every update has a late one

_LONGEST_STEP_S: Final = 0.05  # a third of the front steering's lag
_PATIENCE_S: Final = 1.0  # for which the gate may reject a sensor
_LONGER_S: Final = 5.0  # the same of a receiver that may find a wrong fix; assumed
_LONGEST_SPAN_S: Final = 0.1  # between samples of a gyro, for their mean to be that of the rate
_SLOPE_S: Final = 0.5  # over which roll and pitch are smoothed; bumps last less
_MOST_STEP: Final = 0.5  # of the logarithm of a factor at one sample; assumed
_LEAST_VARIANCE: Final = 1e-12  # of an entry without uncertainty: covariances are invertible

FILTER: Final = np.dtype(
    [
        ("vehicle", "f8", len(VehicleParameter)),
        ("fading", "f8", 2 * (SIZE - STATES)),  # see `ProcessNoise.fading`
        ("rates", "f8", (2, _LEVELS, SIZE)),  # see `ProcessNoise.rates`
        ("walk", "f8"),  # variance that a metre adds to the logarithms of the factors
        ("gyro_sampling", "f8"),  # variance of the yaw of a gyro that a metre adds [rad^2/m]
        ("variances", "f8", _SENSORS),  # of each entry of a sample; 0 for a gyro that is not used
        ("float_variance", "f8"),  # of each entry of a float solution
        ("patience", "f8", _SENSORS),  # for which the gate may reject a sensor [s]
        ("gates", "f8", _SENSORS),  # of the normalised squared innovation
        ("heights", "f8", 2),  # of the antennas above the axle points [m]
        ("memory_s", "f8"),
        ("unfollowed", "f8", STATES),  # variances of what no state follows, but that of the speed
        ("fast_speed", "f8"),  # variance of the speed at 1 m/s and a factor of 1, likewise
        ("roll_arm", "f8"),  # shift of the trailer's position by the slip on a slope [m/rad]
        ("line", "f8"),  # between both positions on a straight [m]
        ("side_per_slope", "f8"),  # side slip on a slope [rad/rad]
    ]
)
"""Record of a filter's constants: its vehicle and its noise."""

MOMENT: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("augmented", "f8", (_LEVELS, WIDTH)),
        ("covariances", "f8", (_LEVELS, SIZE, WIDTH)),
        ("scales", "f8", (2, SCALES)),  # factors of `NoiseScale`, information on their logarithms
        ("valves", "f8", 2),  # set points of the steering valves [rad]
        ("rejected_since", "f8", _SENSORS),  # by the gate, without a break [s], or NaN
        ("gyros", "f8", (2, 4)),  # last samples: time [s], yaw rate, roll, pitch, or NaN
        ("slopes", "f8", (2, 2)),  # side slip on the slope that each IMU shows, see `_weigh`
    ]
)
"""Record of all that a filter carries from one time to the next."""

ROW: Final = MOMENT.itemsize // 8
FADING: Final = len(VehicleParameter)
AUGMENTED: Final = MOMENT.fields["augmented"][1] // 8  # type: ignore[index]
COVARIANCE: Final = MOMENT.fields["covariances"][1] // 8  # type: ignore[index]
VALVES: Final = MOMENT.fields["valves"][1] // 8  # type: ignore[index]

HISTORY: Final = np.dtype(
    [
        ("begin", "i8"),  # index of the oldest moment in their ring
        ("moments", "i8"),  # numbers of entries
        ("samples", "i8"),
        ("commands", "i8"),
        ("resumes", "i8"),  # whether the last row of moments has what a restart keeps
        ("now_s", "f8"),  # time of the last update, or NaN
    ]
)
"""Record of how full the arrays of a filter's memory are, see `observe_filter`."""

HELD: Final = 7
"""Entries of a sample in memory: those of `SAMPLE`, whether the filter accepted it, and the row in
which it came at this update, else -1."""

_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())


@cached_njit()
def steps_over(span_s: float) -> int:
    """Return the number of integration steps over a span of time [s], at least 1."""
    return max(1, math.ceil((span_s - SAME_TIME_S) / _LONGEST_STEP_S))


@cached_njit(error_model="numpy")
def predict(
    parameters: FloatArray, moment: FloatArray, command: FloatArray, span_s: float, steps: int
) -> None:
    """Advance a `MOMENT`, but for its time, by `span_s` in `steps` equal steps, in place.

    `command` (3,) is held. With Q the noise of a step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q
    acts before the step, half after it. The lower rows of Phi are diagonal, most entries of its
    seven upper rows are 0.
    """
    f, now = record(parameters, FILTER), record(moment, MOMENT)
    vehicle, fading = parameters[:FADING], parameters[FADING : FADING + 2 * (SIZE - STATES)]
    x, valves = moment[AUGMENTED : AUGMENTED + WIDTH], moment[VALVES : VALVES + 2]
    transition = local((SIZE, WIDTH))
    noise = local((_LEVELS, WIDTH))  # half of it
    upper = local((_LEVELS, STATES, WIDTH))  # the upper rows of Phi P
    columns = local((SIZE, _CROSS))  # their columns, all levels side by side
    corner, change = local((STATES, _CROSS)), local((_LEVELS, STATES))
    middle, fade = local((STATES,)), local((WIDTH,))
    clear_row(fade, 0)
    for k in range(2 * SIZE):
        clear_row(columns, k * WIDTH)
    step_s = span_s / steps
    for _ in range(steps):
        for i in range(STATES):
            middle[i] = x[i]
        advance_augmented_state(x, valves, command, vehicle, fading, step_s, transition)
        for i in range(STATES):
            middle[i] = 0.5 * (middle[i] + x[i])
        # Noise, as `ProcessNoise.density` times the step: the diagonal and two entries beside it
        travel = abs(middle[AugmentedState.RIM]) * step_s
        psi_t = middle[AugmentedState.PSI_T]
        cos, sin = math.cos(psi_t), math.sin(psi_t)
        drawbar = f.vehicle[VehicleParameter.DRAWBAR_LENGTH] * math.cos(
            middle[AugmentedState.DELTA_I]
        )
        trailer = f.vehicle[VehicleParameter.TRAILER_LENGTH]
        trailer += f.vehicle[VehicleParameter.TRAILER_TURNING_OFFSET]
        swing = -drawbar / (trailer + drawbar)
        for level in range(_LEVELS):
            for i in range(SIZE):
                variance = step_s * f.rates[0, level, i] + travel * f.rates[1, level, i]
                noise[level, i] = 0.5 * variance
            forward, lateral = noise[level, 0], noise[level, 1]
            noise[level, 0] = forward * cos * cos + lateral * sin * sin
            noise[level, 1] = forward * sin * sin + lateral * cos * cos
            noise[level, _XY] = (forward - lateral) * cos * sin
            joint = noise[level, AugmentedState.DELTA_I]
            noise[level, AugmentedState.PSI_I] += swing * swing * joint
            noise[level, _JOINT] = swing * joint
        for n in range(SCALES):
            add_row(noise, 0, now.scales[0, n], noise, (1 + n) * WIDTH)
        for i in range(STATES, SIZE):
            fade[i] = transition[i, i]
        for level in range(_LEVELS):
            _add(now.covariances[level], noise[level])
            for i in range(STATES):
                clear_row(upper, (level * STATES + i) * WIDTH)
                change[level, i] = 0.0
        for k in range(SIZE):  # innermost over rows, so that no sum waits for the one before
            for i in range(STATES):
                weight = transition[i, k]
                if weight != 0.0:
                    for level in range(_LEVELS):
                        at = COVARIANCE + (level * SIZE + k) * WIDTH
                        add_row(upper, (level * STATES + i) * WIDTH, weight, moment, at)
                        change[level, i] += weight * now.augmented[level, k]
        for i in range(STATES):
            clear_row(corner, 2 * i * WIDTH)
            clear_row(corner, (2 * i + 1) * WIDTH)
            for level in range(_LEVELS):
                for k in range(SIZE):
                    columns[k, 8 * level + i] = upper[level, i, k]
        for k in range(SIZE):
            for i in range(STATES):
                weight = transition[i, k]
                if weight != 0.0:
                    add_row(corner, 2 * i * WIDTH, weight, columns, 2 * k * WIDTH)
                    add_row(corner, (2 * i + 1) * WIDTH, weight, columns, (2 * k + 1) * WIDTH)
        for level in range(_LEVELS):
            for i in range(STATES, SIZE):
                by = fade[i]
                scale_row(moment, COVARIANCE + (level * SIZE + i) * WIDTH, by, fade, 0)
                for j in range(STATES):
                    now.covariances[level, i, j] = upper[level, j, i] * by
            for i in range(STATES):
                to = COVARIANCE + (level * SIZE + i) * WIDTH
                set_row(moment, to, 1.0, upper, (level * STATES + i) * WIDTH)
                scale_row(moment, to, 1.0, fade, 0)
            for i in range(STATES):
                for j in range(i + 1):
                    value = corner[i, 8 * level + j]
                    now.covariances[level, i, j] = now.covariances[level, j, i] = value
            _add(now.covariances[level], noise[level])
            if level:
                for i in range(STATES):
                    now.augmented[level, i] = change[level, i]
                for i in range(STATES, SIZE):
                    now.augmented[level, i] *= fade[i]
        gained = f.walk * travel
        for n in range(SCALES):
            now.scales[1, n] = now.scales[1, n] / (1.0 + now.scales[1, n] * gained)


@cached_njit(error_model="numpy")
def _add(matrix: FloatArray, noise: FloatArray) -> None:
    """Add a row of noise (24,), see `predict`, to a covariance."""
    for i in range(_XY):
        matrix[i, i] += noise[i]
    matrix[0, 1] += noise[_XY]
    matrix[1, 0] += noise[_XY]
    matrix[AugmentedState.PSI_I, AugmentedState.DELTA_I] += noise[_JOINT]
    matrix[AugmentedState.DELTA_I, AugmentedState.PSI_I] += noise[_JOINT]


@cached_njit(error_model="numpy")
def correct(
    parameters: FloatArray,
    moment: FloatArray,
    sensor: int,
    first: float,
    second: float,
    variance: float,
    forced: bool,
    learns: bool,
    rows: FloatArray,
) -> tuple[float, float, float, float]:
    """Correct a `MOMENT` by one sample in place and return its innovation nu, normalised.

    With S = L L' the covariance of nu, that is nu' S^-1 nu, log det S and the two entries of
    L^-1 nu, of which a sample of one number has the first.

    `sensor` is a `SensorIndex` as a number, `first` and `second` are the sample (of a gyro, the
    angle turned since its last sample and the time since then), `variance` is that of each entry. A
    sample beyond the gate (chi-square) changes nothing unless it is `forced`: then its noise is
    raised until it just passes, S by all of the factor. In the whitened measurement L^-1 H, the
    gain is G = P H' L^-T and, with C = L^-1 H dP and D = L^-1 H dP H' L^-T of a derivative dP,

        P <- P - G G',    dP <- dP + G W' + W G',    W = G D / 2 - C',

    which are symmetric. Disturbances are clipped to their bounds.

    If it `learns`, the sample updates the factors s and the information I on their logarithms. For
    nu ~ N(0, S) with derivatives dS and dnu by s (Astrom 1980),

        score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2 - nu' S^-1 dnu
        information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu,

    s^2 times this information is gathered in I, and s <- s (1 + s score / I), within its range.
    `rows` (8, 2, 24) are workspace, and have G' in rows[1] and L (diagonal, entry below, diagonal)
    in rows[7, 1] afterwards.
    """
    f, now = record(parameters, FILTER), record(moment, MOMENT)
    gate = f.gates[sensor]
    reading, jacobian = rows[7, 0], rows[0]
    cross, half = rows[1:5], rows[5]  # H P and its derivatives; W'
    spread = local((5, _LEVELS))  # H P H' and its derivatives: (0, 0), (1, 0), (1, 1)
    slope = spread[3:5]  # derivatives of the innovation
    x = moment[AUGMENTED : AUGMENTED + WIDTH]
    size = measure(sensor, x, parameters[:FADING], second, reading, jacobian)
    for level in range(_LEVELS):
        for r in range(size):
            clear_row(rows, _CROSS + (2 * level + r) * WIDTH)
            spread[2 * r, level] = spread[1, level] = slope[r, level] = 0.0
    for r in range(size):
        for k in range(SIZE):
            weight = jacobian[r, k]
            if weight != 0.0:
                for level in range(_LEVELS):
                    at = COVARIANCE + (level * SIZE + k) * WIDTH
                    add_row(rows, _CROSS + (2 * level + r) * WIDTH, weight, moment, at)
                    slope[r, level] -= weight * now.augmented[level, k]
    for r in range(size):
        for k in range(SIZE):
            weight = jacobian[r, k]
            if weight != 0.0:
                for c in range(r + 1):
                    for level in range(_LEVELS):
                        spread[r + c, level] += weight * cross[level, c, k]
    nu = first - reading[0]
    if SensorIndex.STEERING_TRACTOR <= sensor <= SensorIndex.HITCH:
        nu -= 2.0 * math.pi * round(nu / (2.0 * math.pi))
    root = math.sqrt(spread[0, 0] + variance)  # L: its diagonal, and the entry below
    below, corner = 0.0, 1.0
    e, e_2 = nu / root, 0.0
    if size == 2:
        below = spread[1, 0] / root
        corner = math.sqrt(spread[2, 0] + variance - below * below)
        e_2 = (second - reading[1] - below * e) / corner
    normalised = e * e + e_2 * e_2
    result = normalised, 2.0 * math.log(root * corner), e, e_2
    raised = not normalised <= gate
    if raised:
        if not forced:
            return result
        factor = math.sqrt(normalised / gate)
        root, below, corner = root * factor, below * factor, corner * factor
        e, e_2 = e / factor, e_2 / factor
    rows[7, 1, 0], rows[7, 1, 1], rows[7, 1, 2] = root, below, corner
    for level in range(_LEVELS):  # cross becomes G' and the C
        at = _CROSS + 2 * level * WIDTH
        set_row(rows, at, 1.0 / root, rows, at)
        if size == 2:
            set_row(rows, at + WIDTH, 1.0 / corner, rows, at + WIDTH)
            add_row(rows, at + WIDTH, -below / corner, rows, at)
    gain = cross[0]
    for level in range(1, _LEVELS):
        d, d_21, d_22 = spread[0, level] / root / root, 0.0, 0.0
        slope_1, slope_2 = slope[0, level] / root, 0.0  # of the whitened innovation
        if size == 2:
            d_21 = (spread[1, level] / root - below * d) / corner
            d_22 = (spread[2, level] / corner - below * spread[1, level] / root / corner) / corner
            d_22 -= below * d_21 / corner
            slope_2 = (slope[1, level] - below * slope_1) / corner
        by, by_2 = d * e + d_21 * e_2, d_21 * e + d_22 * e_2
        if learns and not raised:
            n = level - 1
            scale = now.scales[0, n]
            score = 0.5 * (e * by + e_2 * by_2 - d - d_22) - e * slope_1 - e_2 * slope_2
            information = 0.5 * (d * d + d_22 * d_22) + d_21 * d_21
            information += slope_1 * slope_1 + slope_2 * slope_2
            now.scales[1, n] += scale * scale * information
            step = min(max(scale * score / now.scales[1, n], -_MOST_STEP), _MOST_STEP)
            least, most = SCALE_RANGE[n]
            now.scales[0, n] = min(max(scale * (1.0 + step), least), most)
        of_state, of_cross = AUGMENTED + level * WIDTH, _CROSS + 2 * level * WIDTH
        add_rows(moment, of_state, slope_1 - by, rows, _CROSS, e, rows, of_cross)
        set_row(rows, _HALF, 0.5 * d, rows, _CROSS)
        add_row(rows, _HALF, -1.0, rows, of_cross)
        if size == 2:
            second_gain, of_cross = _CROSS + WIDTH, of_cross + WIDTH
            add_rows(moment, of_state, slope_2 - by_2, rows, second_gain, e_2, rows, of_cross)
            add_row(rows, _HALF, 0.5 * d_21, rows, second_gain)
            set_row(rows, _HALF + WIDTH, -1.0, rows, of_cross)
            add_rows(rows, _HALF + WIDTH, 0.5 * d_21, rows, _CROSS, 0.5 * d_22, rows, second_gain)
        for r in range(size):
            of_gain, of_half = _CROSS + r * WIDTH, _HALF + r * WIDTH
            for i in range(SIZE):
                to = COVARIANCE + (level * SIZE + i) * WIDTH
                add_rows(moment, to, gain[r, i], rows, of_half, half[r, i], rows, of_gain)
    for r in range(size):
        add_row(moment, AUGMENTED, e_2 if r else e, rows, _CROSS + r * WIDTH)
        for i in range(SIZE):
            add_row(moment, COVARIANCE + i * WIDTH, -gain[r, i], rows, _CROSS + r * WIDTH)
    for i in range(STATES, SIZE):
        x[i] = min(max(x[i], -_BOUND[i - STATES]), _BOUND[i - STATES])
    return result


@cached_njit(error_model="numpy")
def turned(last: FloatArray, sample: FloatArray) -> float:
    """Return the angle by which the heading turned between two samples of an IMU [rad].

    Both begin with time, and have yaw rate w, roll and pitch, `last` (4,) from 1 on, `sample` (5,)
    from 2 on. The yaw rate of an IMU is that about the vertical; a vehicle that rolls while it
    stands at a pitch changes its heading beside it. From the angular velocity of the angles yaw,
    pitch and roll (Diebel 2006, sec. 5.6),

        psi' = w + roll' sin(pitch).

    The integral of the second term keeps no memory of the noise of roll.
    """
    pitch = 0.5 * (last[3] + sample[4])
    rate = 0.5 * (last[1] + sample[2])
    return rate * (sample[0] - last[0]) + (sample[3] - last[2]) * math.sin(pitch)


@cached_njit(error_model="numpy")
def _weigh(
    parameters: FloatArray, moment: FloatArray, sample: FloatArray, rows: FloatArray
) -> tuple[float, float, float, float]:
    """Correct a moment by a sample (7,) of its time; note whether it was accepted in the sample."""
    f, now = record(parameters, FILTER), record(moment, MOMENT)
    time_s, sensor = sample[0], int(sample[1])
    body = sensor - _UNWEIGHED
    first, second, variance = sample[2], sample[3], f.variances[sensor]
    psi, past = AugmentedState.PSI_T + body, AugmentedState.PAST_T + body
    usable = True
    if sensor <= SensorIndex.GNSS_TRAILER and sample[4] == FLOAT:
        variance = max(variance, f.float_variance)
    if body >= 0:
        last = now.gyros[body]
        span_s = time_s - last[0]
        first, second = turned(last, sample), span_s
        travel = abs(now.augmented[0, AugmentedState.RIM]) * span_s
        variance = variance * span_s * span_s + f.gyro_sampling * travel
        last[0], last[1], last[2], last[3] = time_s, sample[2], sample[3], sample[4]
        usable = span_s <= _LONGEST_SPAN_S
        # Roll and pitch, smoothed and averaged over both bodies, are the slope; the filter follows
        # the rest of the side slip that is fixed in the map.
        share = 1.0 if math.isnan(span_s) else -math.expm1(-span_s / _SLOPE_S)
        cos, sin = math.cos(now.augmented[0, psi]), math.sin(now.augmented[0, psi])
        for i in range(2):
            along, across = (sin, cos) if i else (cos, -sin)
            slip = f.side_per_slope * (sample[4] * along - sample[3] * across)
            change = share * (slip - now.slopes[body, i])
            now.slopes[body, i] += change
            now.augmented[0, AugmentedState.SIDE_X + i] += 0.5 * change
    result = 0.0, 0.0, 0.0, 0.0
    sample[5] = 0.0
    if usable:
        since_s = now.rejected_since[sensor]
        forced = time_s - since_s >= f.patience[sensor] - SAME_TIME_S
        if sensor == SensorIndex.GNSS_TRAILER:  # the receiver of the tractor tells where it is
            forced = forced and not math.isnan(now.rejected_since[1 - sensor])
        result = correct(
            parameters, moment, sensor, first, second, variance, forced, body < 0, rows
        )
        inside = result[0] <= f.gates[sensor]
        if inside:
            now.rejected_since[sensor] = math.nan
        elif math.isnan(since_s):
            now.rejected_since[sensor] = time_s
        sample[5] = 1.0 if inside or forced else 0.0
    if body >= 0:  # the yaw at this sample is the past one of the next
        for level in range(_LEVELS):
            now.augmented[level, past] = now.augmented[level, psi]
            for i in range(SIZE):
                now.covariances[level, past, i] = now.covariances[level, psi, i]
            for i in range(SIZE):
                now.covariances[level, i, past] = now.covariances[level, i, psi]
    return result


@cached_njit(error_model="numpy")
def acting(
    parameters: FloatArray, commands: FloatArray, count: int, time_s: float, command: FloatArray
) -> float:
    """Write the command (3,) that acts just after `time_s`; return until when it does [s].

    Of the rows `commands` the first `count` are in use: end of the period in which a command was
    sent, and its inputs, NaN where one is not known. The first was sent before, too. Each input
    acts its own dead time later (`Vehicle.dead_times`).
    """
    until_s = math.inf
    for j in range(_INPUTS):
        dead_time = parameters[VehicleParameter.DEAD_TIME_T + j]
        n = 0
        while n < count - 1 and commands[n, 0] + dead_time <= time_s + SAME_TIME_S:
            n += 1
        command[j] = commands[n, 1 + j]
        if n < count - 1:
            until_s = min(until_s, commands[n, 0] + dead_time)
    return until_s


@cached_njit(error_model="numpy")
def predict_until(
    parameters: FloatArray, moment: FloatArray, commands: FloatArray, count: int, until_s: float
) -> None:
    """Advance a `MOMENT` to `until_s` in place under the commands of the time in between.

    The commands are as in `acting`. Where one is not known, that steering or the speed is constant.
    The last three columns of a row are by how much a map of the field lets the first `MAPPED`
    disturbances change over its period [rad]. Of a part of the period its share changes, half of
    that before the prediction and half after it.
    """
    f, now = record(parameters, FILTER), record(moment, MOMENT)
    command, half = local((_INPUTS,)), local((MAPPED,))
    while until_s - now.time_s > SAME_TIME_S:
        end_s = acting(parameters, commands, count, now.time_s, command)
        n = 1
        while n < count - 1 and commands[n, 0] <= now.time_s + SAME_TIME_S:
            n += 1
        changes = False
        for i in range(MAPPED):
            changes = changes or (n < count and commands[n, _CHANGE + i] != 0.0)
        half_share = 0.0
        if changes:
            if commands[n, 0] > now.time_s + SAME_TIME_S:
                end_s = min(end_s, commands[n, 0])
            period_s = max(commands[n, 0] - commands[n - 1, 0], SAME_TIME_S)
            half_share = 0.5 * (min(end_s, until_s) - now.time_s) / period_s
        if end_s >= until_s - SAME_TIME_S:
            end_s = until_s
        for i in range(MAPPED):
            half[i] = half_share * commands[n, _CHANGE + i] if changes else 0.0
            now.augmented[0, _SLIPS + i] += half[i]
        for i in range(2):
            if math.isnan(command[i]):
                command[i] = now.valves[i]
        if math.isnan(command[Input.HP]):
            rim = now.augmented[0, AugmentedState.RIM]
            command[Input.HP] = rim / f.vehicle[VehicleParameter.SPEED_GAIN]
        span_s = end_s - now.time_s
        predict(parameters, moment, command, span_s, steps_over(span_s))
        for i in range(MAPPED):
            now.augmented[0, _SLIPS + i] += half[i]
        now.time_s = end_s
    now.time_s = until_s


@cached_njit(error_model="numpy", nogil=True)
def observe_filter(
    parameters: FloatArray,
    history: FloatArray,
    moments: FloatArray,
    samples: FloatArray,
    commands: FloatArray,
    rows: FloatArray,
    now_s: float,
    command: FloatArray,
    estimate: FloatArray,
    innovations: FloatArray,
) -> bool:
    """Take in the samples `rows` of a tick, and write the estimate at `now_s`.

    Args:
        parameters: `FILTER`.
        history: `HISTORY`, how full the three arrays after it are. All four are one filter's state,
            changed in place; a copy of them is a copy of the filter.
        moments: ring of `MOMENT`, and a last row for the prediction to `now_s`.
        samples: rows (n, `HELD`), by time, then sensor.
        commands: rows (n, 7), see `acting` and `predict_until`.
        rows: rows (n, `SAMPLE`) in the order of arrival.
        now_s: time of this update [s]; the one before may be repeated.
        command: (6,), the rest of a row of `commands`, of the period that ends at `now_s`: inputs,
            NaN where none is known, and changes.
        estimate: `ESTIMATE`.
        innovations: rows (n, `INNOVATION`) of the samples, of dimension 0 where there is none.

    The arrays need space for all rows, see `ExtendedKalmanFilter`. Returns whether the filter has
    not started and has a reading of every sensor: then the caller may write the first moment, and
    update to the same time again.

    A late sample takes the filter back to the last moment before it; all samples from there on are
    processed again in the order of their times. The result depends neither on the order of arrival
    nor on where moments are kept. If neither a sample nor an update came for more
    than `LONGEST_GAP_S`, or the clock was set back by more, the filter starts anew from the next
    readings, whatever the time in between. It keeps the factors of the noise, and the disturbances,
    faded as if the vehicle had kept its speed, with the variances of a start.
    """
    f, h = record(parameters, FILTER), record(history, HISTORY)
    ring, spare = len(moments) - 1, moments[len(moments) - 1]
    entries = moments.shape[1]
    earliest, latest = now_s - f.memory_s - SAME_TIME_S, now_s + SAME_TIME_S

    newest_s = math.nan
    if h.moments:
        newest_s = moments[(h.begin + h.moments - 1) % ring, 0]
    elif h.samples:
        newest_s = samples[h.samples - 1, 0]
    next_s = now_s
    for n in range(len(rows)):
        if max(earliest, newest_s) < rows[n, 0] < next_s:
            next_s = rows[n, 0]
    if now_s - h.now_s < -LONGEST_GAP_S or (
        now_s - h.now_s > LONGEST_GAP_S and next_s - newest_s > LONGEST_GAP_S
    ):
        if h.moments:
            last = moments[(h.begin + h.moments - 1) % ring]
            for i in range(entries):
                spare[i] = last[i]
            kept, span_s = record(spare, MOMENT), abs(now_s - newest_s)
            travel = abs(kept.augmented[0, AugmentedState.RIM]) * span_s
            rates = parameters[FADING : FADING + 2 * (SIZE - STATES)]
            for i in range(SIZE - STATES):
                fading = rates[i] * span_s + rates[SIZE - STATES + i] * travel
                kept.augmented[0, STATES + i] *= math.exp(-fading)
            h.resumes = 1
        h.moments = h.samples = h.commands = 0
    h.now_s = now_s

    if h.commands == 0 or commands[h.commands - 1, 0] != now_s:
        h.commands += 1
    commands[h.commands - 1, 0] = now_s
    for j in range(_INPUTS + MAPPED):
        commands[h.commands - 1, 1 + j] = command[j]

    # Headings of both bodies for the antennas: before the start the line between them
    yaw = local((2,))
    yaw[0] = yaw[1] = 0.0
    begin_s = -math.inf
    if h.moments:
        begin_s = moments[h.begin % ring, 0]
        last = moments[(h.begin + h.moments - 1) % ring]
        yaw[0], yaw[1] = last[AUGMENTED + State.PSI_T], last[AUGMENTED + State.PSI_I]
    elif f.heights[0] > 0.0 or f.heights[1] > 0.0:
        place = local((2, 2))
        place[0, 0] = place[0, 1] = place[1, 0] = place[1, 1] = math.nan
        for n in range(h.samples + len(rows)):
            row = samples[n] if n < h.samples else rows[n - h.samples]
            if 0.0 <= row[1] < 2.0 and not math.isnan(row[2] + row[3]):
                place[int(row[1]), 0], place[int(row[1]), 1] = row[2], row[3]
        line = math.atan2(place[0, 1] - place[1, 1], place[0, 0] - place[1, 0])
        if not math.isnan(line):
            yaw[0] = yaw[1] = line

    # New samples in order of time; those of the IMUs first, with which antennas are corrected
    since_s = math.inf
    for imus in range(1, -1, -1):
        for n in range(len(rows)):
            time_s, sensor = rows[n, 0], int(rows[n, 1])
            if (sensor >= _UNWEIGHED) != (imus == 1):
                continue
            used = f.variances[sensor] > 0.0
            length = 3 if imus else (2 if sensor < 2 else 1)
            at = h.samples
            while at > 0 and (
                samples[at - 1, 0] > time_s
                or (samples[at - 1, 0] == time_s and samples[at - 1, 1] > sensor)
            ):
                at -= 1
            repeated = at > 0 and samples[at - 1, 0] == time_s and samples[at - 1, 1] == sensor
            total = 0.0  # not finite if one of its terms is not
            for j in range(length):
                total += rows[n, 2 + j] * 0.0
            good = total == 0.0 and earliest <= time_s <= latest and time_s > begin_s
            innovations[n, 0], innovations[n, 1] = sensor, math.inf
            innovations[n, 2] = length if used and (repeated or not good) else 0.0
            innovations[n, 3] = 0.0
            innovations[n, 4] = innovations[n, 5] = innovations[n, 6] = math.nan
            if repeated or not (good and (used or f.heights[0] + f.heights[1] > 0.0)):
                continue
            for k in range(h.samples, at, -1):
                for j in range(HELD):
                    samples[k, j] = samples[k - 1, j]
            h.samples += 1
            for j in range(5):
                samples[at, j] = rows[n, j]
            samples[at, 5], samples[at, 6] = 0.0, n
            if used:
                since_s = min(since_s, time_s)
            if sensor < 2 and f.heights[sensor] > 0.0:
                nearest = -1
                for k in range(h.samples):
                    if samples[k, 1] == _UNWEIGHED + sensor and (
                        nearest < 0
                        or abs(samples[k, 0] - time_s) < abs(samples[nearest, 0] - time_s)
                    ):
                        nearest = k
                if nearest >= 0:
                    roll, pitch = samples[nearest, 3], samples[nearest, 4]
                    right = f.heights[sensor] * math.sin(roll)
                    ahead = f.heights[sensor] * math.cos(roll) * math.sin(pitch)
                    cos, sin = math.cos(yaw[sensor]), math.sin(yaw[sensor])
                    samples[at, 2] = rows[n, 2] - (ahead * cos + right * sin)
                    samples[at, 3] = rows[n, 3] - (ahead * sin - right * cos)

    # Moments from the first new sample on are made again
    now, oldest_s = spare, earliest
    if h.moments:
        while moments[(h.begin + h.moments - 1) % ring, 0] >= since_s:
            h.moments -= 1
        now = moments[(h.begin + h.moments - 1) % ring]
        workspace, start_s, kept_s = local((8, 2, WIDTH)), now[0], now[0]
        for k in range(h.samples):
            sample = samples[k]
            if sample[0] <= start_s or f.variances[int(sample[1])] == 0.0:
                continue
            if sample[0] > now[0]:
                if now[0] - kept_s >= _SPACING_S or now[0] == start_s:
                    before, kept_s, h.moments = now, sample[0], h.moments + 1
                    now = moments[(h.begin + h.moments - 1) % ring]
                    for i in range(entries):
                        now[i] = before[i]
                predict_until(parameters, now, commands, h.commands, sample[0])
            result = _weigh(parameters, now, sample, workspace)
            n = int(sample[6])
            if n >= 0 and sample[1] < _UNWEIGHED:
                innovations[n, 1], innovations[n, 6] = result[0], result[1]
                innovations[n, 2] = 2.0 if sample[1] < 2.0 else 1.0
                innovations[n, 3], innovations[n, 4] = sample[5], result[2]
                innovations[n, 5] = result[3]
        while h.moments > 1 and moments[(h.begin + 1) % ring, 0] < oldest_s:
            h.begin, h.moments = (h.begin + 1) % ring, h.moments - 1
        if now[0] < oldest_s:  # no sample may come before
            predict_until(parameters, now, commands, h.commands, oldest_s)
        oldest_s = min(oldest_s, moments[h.begin % ring, 0])

    # What is too old goes, samples many at a time; until the start, the newest of each sensor stays
    present = 0  # sensors of which there is a reading, a bit each
    for k in range(h.samples - 1, -1, -1):
        bit = 1 << int(samples[k, 1])
        newest = not h.moments and present & bit == 0
        samples[k, 6] = -1.0 if newest or samples[k, 0] >= oldest_s else -2.0
        present |= bit
    if h.samples > 0 and (not h.moments or samples[h.samples // 4, 6] == -2.0):
        count = 0
        for k in range(h.samples):
            if samples[k, 6] == -1.0:
                for j in range(HELD):
                    samples[count, j] = samples[k, j]
                count += 1
        h.samples = count
    longest_s, count = 0.0, 0
    for j in range(_INPUTS):
        longest_s = max(longest_s, parameters[VehicleParameter.DEAD_TIME_T + j])
    for k in range(h.commands):
        if commands[k, 0] >= oldest_s - longest_s:
            for j in range(1 + _INPUTS + MAPPED):
                commands[count, j] = commands[k, j]
            count += 1
    h.commands = count

    e = record(estimate, ESTIMATE)
    if not h.moments:
        for i in range(len(estimate)):
            estimate[i] = math.nan
        e.time_s, e.nis, e.nis_dof, e.position_seen = now_s, 0.0, 0.0, 0.0
        return present & 63 == 63
    if now_s - now[0] > SAME_TIME_S:
        for i in range(entries):
            spare[i] = now[i]
        now = spare
        predict_until(parameters, now, commands, h.commands, now_s)
    write_moment(parameters, now, estimate)
    e.time_s = now_s
    for n in range(len(innovations)):
        if innovations[n, 2] > 0.0 and innovations[n, 1] < math.inf:
            e.nis += innovations[n, 1]
            e.nis_dof += innovations[n, 2]
            if innovations[n, 0] < 2.0:
                e.position_seen = max(e.position_seen, innovations[n, 3])
    return False


@cached_njit(error_model="numpy")
def write_moment(parameters: FloatArray, moment: FloatArray, estimate: FloatArray) -> None:
    """Write what an `ESTIMATE` has from a `MOMENT`; nothing came in at it.

    The covariance is the filter's and that of what no state follows (Jazwinski 1970, sec. 8.4). On
    a slope the axle points, at different heights above it, are shifted against each other: half of
    that goes into the position, and the line between them turns. The slope's square is that of the
    side slip on it, less its variance.
    """
    f, now, e = record(parameters, FILTER), record(moment, MOMENT), record(estimate, ESTIMATE)
    x = moment[AUGMENTED : AUGMENTED + WIDTH]
    write_estimate(x, now.covariances[0], parameters[:FADING], estimate)
    for i in range(STATES):
        e.covariance[i, i] += f.unfollowed[i]
    side, of_side = x[_SIDE : _SIDE + 2], now.covariances[0, _SIDE : _SIDE + 2, _SIDE : _SIDE + 2]
    square, variance = side[0] ** 2 + side[1] ** 2, of_side[0, 0] + of_side[1, 1]
    if square > variance:
        arm, psi_i = f.roll_arm**2 * (1.0 - variance / square), x[AugmentedState.PSI_I]
        across = side[1] * math.cos(psi_i) - side[0] * math.sin(psi_i)
        e.covariance[State.PSI_I, State.PSI_I] += arm * (across / f.line) ** 2
        for i in range(2):
            for j in range(2):
                e.covariance[i, j] += 0.25 * arm * side[i] * side[j]
    rim = now.augmented[0, AugmentedState.RIM]
    e.covariance[State.V, State.V] += now.scales[0, 0] * f.fast_speed * rim * rim
    for n in range(SCALES):
        e.noise_factors[n] = now.scales[0, n]
    e.time_s, e.nis, e.nis_dof, e.position_seen = now.time_s, 0.0, 0.0, 0.0


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
    for sensor in STARTING_SENSORS:
        length = len(value[sensor])
        travel = v * (newest - readings[sensor].time_s) if length == 2 else 0.0
        offset = noise.angle_offset if sensor in (Sensor.STEERING_TRAILER, Sensor.HITCH) else 0.0
        variances += [noise.of(sensor) ** 2 + travel**2 + offset**2] * length
    return state, (jacobian * variances) @ jacobian.T


def first_moment(
    readings: Mapping[Sensor, Measurement],
    vehicle: Vehicle,
    sensors: SensorNoise,
    process: ProcessNoise,
) -> FloatArray:
    """Return the `MOMENT` (`ROW`,) that follows from one reading of every sensor.

    It is at the newest of them.
    """
    state, covariance = first_state(readings, vehicle, replace(sensors, gnss_white_share=1.0))
    slow = max(sensors.difference_variance, _LEAST_VARIANCE)
    bias = max(sensors.yaw_rate_bias**2, _LEAST_VARIANCE)
    offset = max(sensors.angle_offset**2, _LEAST_VARIANCE)
    joint = sensors.angle_offset**2 or process.joint**2
    others = [*INITIAL_SD**2, slow, slow, joint, offset, bias, bias, *2 * [_LEAST_VARIANCE]]
    row = np.zeros(ROW)
    start = row.view(MOMENT)[0]
    start["time_s"] = max(reading.time_s for reading in readings.values())
    start["augmented"][0, :STATES] = state
    start["covariances"][0, range(STATES, SIZE), range(STATES, SIZE)] = others
    start["covariances"][0, :STATES, :STATES] = covariance
    start["scales"] = process.scales, np.full(SCALES, process.scale_sd**-2)
    start["valves"] = state[AugmentedState.DELTA_T : AugmentedState.RIM]
    start["rejected_since"] = start["gyros"] = math.nan
    return row


def filter_parameters(
    vehicle: Vehicle,
    sensors: SensorNoise,
    process: ProcessNoise,
    gate_probability: float = 1e-4,
    memory_s: float = 2.5,
) -> FloatArray:
    """Return the record `FILTER` of a filter as a flat array.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.
    """
    if not 0.0 < memory_s < math.inf:
        raise InvalidTuning(f"memory_s: got {memory_s}, must be finite and above 0")
    if not 0.0 < gate_probability < 1.0:
        raise InvalidTuning(f"gate_probability: got {gate_probability}, must be in (0, 1)")
    flat = np.zeros(FILTER.itemsize // 8)
    f = flat.view(FILTER)[0]
    f["vehicle"] = vehicle_parameters(vehicle, not sensors.angle_offset)
    f["fading"] = process.fading(sensors).ravel()
    f["rates"] = process.rates(sensors)
    f["walk"], f["gyro_sampling"] = process.scale_walk**2, process.gyro_sampling**2
    f["variances"] = [float(sensors.of(sensor)) ** 2 for sensor in Sensor]
    f["float_variance"], f["patience"] = sensors.gnss_float**2, _PATIENCE_S
    if sensors.gnss_float > 0.0:
        f["patience"][: SensorIndex.GNSS_TRAILER + 1] = _LONGER_S
    f["gates"] = [float(chdtri(m, gate_probability)) for m in INNOVATION_SIZES]
    f["heights"] = sensors.antenna_height_t, sensors.antenna_height_i
    f["memory_s"] = memory_s
    f["unfollowed"][[State.X, State.Y]] = sensors.position_variance
    f["line"] = vehicle.hitch_offset + vehicle.drawbar_length + vehicle.trailer_length
    # A bias of roll turns the line between both antennas for good
    f["unfollowed"][State.PSI_I] = (sensors.lean_bias / f["line"]) ** 2
    f["roll_arm"] = process.axle_heights / process.slip_per_slope
    f["unfollowed"][State.DELTA_T] = sensors.angle_offset**2  # `STEERING` takes it up
    if sensors.angle_offset:
        f["unfollowed"][State.DELTA_I] = process.joint**2
    # The slip behind `slip_forward` is white in the model, and correlated over `bump_m` in truth.
    # Of variance s^2 and autocorrelation exp(-|x| / l) it has the density 2 l s^2 (Gelb 1974, 3.6).
    f["fast_speed"] = process.slip_forward**2 / (2.0 * process.bump_m)
    f["side_per_slope"] = process.side_per_slope
    return flat
