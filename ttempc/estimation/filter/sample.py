"""From a sample to a reading: float solutions, gyros, and for how long the gate may reject."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ...jit import cached_njit, local, record
from ...layout import FLOAT
from ...models.augmented_state import SIZE, AugmentedState, VehicleParameter
from ...sensors import SENSOR_BODIES, SENSOR_KINDS, Body, SensorIndex, SensorKind
from ...types import FloatArray
from .correct import Comparison, Reading, correct
from .history import BUFFERED_SAMPLE
from .records import FILTER, GYRO, LEVELS, SAME_TIME_S, SNAPSHOT, GyroColumn

_LONGEST_SPAN_S: Final = 0.1  # between samples of a gyro, for their mean to be its mean rate
_SLOPE_S: Final = 0.5  # over which roll and pitch are smoothed; bumps last less


@cached_njit(error_model="numpy")
def apply_sample(
    parameters: FloatArray, snapshot: FloatArray, sample: FloatArray, workspace: FloatArray
) -> Comparison:
    """Correct a snapshot by a `BUFFERED_SAMPLE` of its time; note in the sample if it was accepted.

    `workspace` is that of `correct`.
    """
    f = record(parameters, FILTER)
    s = record(sample, BUFFERED_SAMPLE)
    sensor = int(s.sensor)
    s.accepted = 0.0
    if SENSOR_KINDS[sensor] == SensorKind.INERTIAL:
        return _apply_inertial(parameters, snapshot, sample, workspace)
    variance = f.variances[sensor]
    if SENSOR_KINDS[sensor] == SensorKind.POSITION and s.entries[2] == FLOAT:
        variance = max(variance, f.float_variance)
    first = s.entries[0]
    second = s.entries[1]
    if sensor == SensorIndex.GNSS_TRAILER and knows_attitude(snapshot):
        shift = shift_on_slope(parameters, snapshot)
        psi_i = record(snapshot, SNAPSHOT).augmented[0, AugmentedState.PSI_I]
        first -= shift.ahead * math.cos(psi_i) - shift.left * math.sin(psi_i)
        second -= shift.ahead * math.sin(psi_i) + shift.left * math.cos(psi_i)
    if sensor == SensorIndex.HITCH and knows_attitude(snapshot):
        first -= tilt_of_hitch_angle(snapshot)
    reading = Reading(sensor, first, second, variance)
    return _gate(parameters, snapshot, sample, reading, workspace)


@cached_njit(error_model="numpy")
def _apply_inertial(
    parameters: FloatArray, snapshot: FloatArray, sample: FloatArray, workspace: FloatArray
) -> Comparison:
    """Move a snapshot by the roll, and correct it by the angle turned, since the IMU's last sample.

    The first sample of an IMU only begins both.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    s = record(sample, BUFFERED_SAMPLE)
    sensor = int(s.sensor)
    body = SENSOR_BODIES[sensor]
    last = now.gyros[body]
    present = local((GYRO,))
    present[GyroColumn.TIME_S] = s.time_s
    present[GyroColumn.YAW_RATE] = s.entries[0]
    present[GyroColumn.ROLL] = s.entries[1]
    present[GyroColumn.PITCH] = s.entries[2]

    span_s = s.time_s - last[GyroColumn.TIME_S]
    angle = turned(last, present)
    travel = abs(now.augmented[0, AugmentedState.WHEEL_SPEED]) * span_s
    variance = f.variances[sensor] * span_s * span_s + f.gyro_sampling * travel
    rolled = present[GyroColumn.ROLL] - last[GyroColumn.ROLL]
    for column in range(GYRO):
        last[column] = present[column]
    if not math.isnan(rolled):
        _step_aside(parameters, snapshot, body, rolled)
    _follow_slope(parameters, snapshot, body, span_s)
    comparison = Comparison(0.0, 0.0, 0.0, 0.0)
    if span_s <= _LONGEST_SPAN_S:
        reading = Reading(sensor, angle, span_s, variance)
        comparison = _gate(parameters, snapshot, sample, reading, workspace)

    # The yaw at this sample is the past one of the next
    psi = AugmentedState.PSI_T + body
    past = AugmentedState.PAST_T + body
    for level in range(LEVELS):
        now.augmented[level, past] = now.augmented[level, psi]
        for i in range(SIZE):
            now.covariances[level, past, i] = now.covariances[level, psi, i]
        for i in range(SIZE):
            now.covariances[level, i, past] = now.covariances[level, i, psi]
    return comparison


@cached_njit(error_model="numpy")
def _step_aside(parameters: FloatArray, snapshot: FloatArray, body: int, rolled: float) -> None:
    """Move axle point and trailer by an angle by which a body has rolled [rad], left side up.

    Both bodies roll about the ground. The tractor's axle point, h above it, and RJ1, h_j above it,
    step to the left by -h rolled and -h_j rolled; the trailer's roll moves the ground below its
    axle against RJ1 by h_j rolled. With the arm l of the trailer and its yaw `lam` behind the
    tractor, as a side slip would do it (`state_rate`),

        tractor: x -= h rolled n(psi_t), psi_i -= h_j rolled cos(lam) / l
        trailer: psi_i += h_j rolled / l.

    The noise of roll is that of two samples in a step. In the sum of the steps it is that of the
    last sample alone: the position gathers none, and `write_snapshot` adds it. The trailer's yaw
    takes each step's as process noise, which its gyro then removes.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    x = now.augmented[0]
    yaw_per_roll = f.roll_levers[body] / trailer_arm(parameters, snapshot)
    if body == Body.TRACTOR:
        psi_t = x[AugmentedState.PSI_T]
        yaw_per_roll *= -math.cos(psi_t - x[AugmentedState.PSI_I])
        x[AugmentedState.X] += f.axle_height * rolled * math.sin(psi_t)
        x[AugmentedState.Y] -= f.axle_height * rolled * math.cos(psi_t)
    x[AugmentedState.PSI_I] += yaw_per_roll * rolled
    variance = 2.0 * f.roll_variance * yaw_per_roll**2
    now.covariances[0, AugmentedState.PSI_I, AugmentedState.PSI_I] += variance


@cached_njit(error_model="numpy")
def trailer_arm(parameters: FloatArray, snapshot: FloatArray) -> float:
    """Return L_i + c + d cos(delta_i), over which a side step turns the trailer [m]."""
    f = record(parameters, FILTER)
    delta_i = record(snapshot, SNAPSHOT).augmented[0, AugmentedState.DELTA_I]
    arm = f.vehicle[VehicleParameter.TRAILER_LENGTH]
    arm += f.vehicle[VehicleParameter.TRAILER_TURNING_OFFSET]
    return arm + f.vehicle[VehicleParameter.DRAWBAR_LENGTH] * math.cos(delta_i)


class Direction(NamedTuple):
    """Unit vector in the frame of a body: ahead, to the left, up."""

    ahead: float
    left: float
    up: float


@cached_njit(error_model="numpy")
def tilt_of_hitch_angle(snapshot: FloatArray) -> float:
    """Return the angle between tractor and drawbar less the one between their headings [rad].

    The hitch angle is one about the tractor's own vertical. On a roll a pitch of the bodies against
    each other therefore turns it: for small angles by roll_t (pitch_d - pitch_t). The drawbar is in
    the plane of the trailer. The attitudes are those of the last samples of the IMUs.
    """
    now = record(snapshot, SNAPSHOT)
    x = now.augmented[0]
    tractor = now.gyros[Body.TRACTOR]
    trailer = now.gyros[Body.TRAILER]
    delta_i = x[AugmentedState.DELTA_I]
    along = Direction(math.cos(delta_i), math.sin(delta_i), 0.0)
    along = _pitched(_rolled(along, trailer[GyroColumn.ROLL]), trailer[GyroColumn.PITCH])
    along = _yawed(along, x[AugmentedState.PSI_I] - x[AugmentedState.PSI_T])
    along = _rolled(_pitched(along, -tractor[GyroColumn.PITCH]), -tractor[GyroColumn.ROLL])
    of_headings = x[AugmentedState.PSI_T] - x[AugmentedState.PSI_I] - delta_i
    tilt = -math.atan2(along.left, along.ahead) - of_headings
    return tilt - math.tau * round(tilt / math.tau)


@cached_njit(error_model="numpy")
def _rolled(vector: Direction, angle: float) -> Direction:
    """Return a vector turned about the axis ahead, left side up."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    left = cos * vector.left - sin * vector.up
    return Direction(vector.ahead, left, sin * vector.left + cos * vector.up)


@cached_njit(error_model="numpy")
def _pitched(vector: Direction, angle: float) -> Direction:
    """Return a vector turned about the axis to the left, nose down."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    ahead = cos * vector.ahead + sin * vector.up
    return Direction(ahead, vector.left, cos * vector.up - sin * vector.ahead)


@cached_njit(error_model="numpy")
def _yawed(vector: Direction, angle: float) -> Direction:
    """Return a vector turned about the vertical, to the left."""
    cos = math.cos(angle)
    sin = math.sin(angle)
    ahead = cos * vector.ahead - sin * vector.left
    return Direction(ahead, sin * vector.ahead + cos * vector.left, vector.up)


class Shift(NamedTuple):
    """Shift of the trailer's axle point on a slope against its place in the flat model [m]."""

    ahead: float
    left: float


@cached_njit(error_model="numpy")
def knows_attitude(snapshot: FloatArray) -> bool:
    """Whether there was a sample of both IMUs."""
    now = record(snapshot, SNAPSHOT)
    tractor_s = now.gyros[Body.TRACTOR, GyroColumn.TIME_S]
    trailer_s = now.gyros[Body.TRAILER, GyroColumn.TIME_S]
    return not math.isnan(tractor_s + trailer_s)


@cached_njit(error_model="numpy")
def shift_on_slope(parameters: FloatArray, snapshot: FloatArray) -> Shift:
    """Return the shift of the trailer's axle point, by the last samples of both IMUs.

    Across a slope the tractor's axle point, e higher above the ground than the trailer's, is e
    sin(roll) further to the right; along it, e sin(pitch) further ahead. With RJ1 halfway between
    both heights, roll and pitch are the means of both bodies.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    roll = 0.5 * (now.gyros[0, GyroColumn.ROLL] + now.gyros[1, GyroColumn.ROLL])
    pitch = 0.5 * (now.gyros[0, GyroColumn.PITCH] + now.gyros[1, GyroColumn.PITCH])
    return Shift(-f.axle_difference * math.sin(pitch), f.axle_difference * math.sin(roll))


@cached_njit(error_model="numpy")
def turned(last: FloatArray, present: FloatArray) -> float:
    """Return the angle by which the heading turned between two samples of an IMU [rad].

    Both are rows of `GyroColumn`. The yaw rate w of an IMU is that about the vertical; a vehicle
    that rolls while it stands at a pitch changes its heading in addition. From the angular velocity
    of the angles yaw, pitch and roll (Diebel 2006, sec. 5.6),

        psi' = w + roll' sin(pitch).

    The integral of the second term keeps no memory of the noise of roll.
    """
    pitch = 0.5 * (last[GyroColumn.PITCH] + present[GyroColumn.PITCH])
    rate = 0.5 * (last[GyroColumn.YAW_RATE] + present[GyroColumn.YAW_RATE])
    span_s = present[GyroColumn.TIME_S] - last[GyroColumn.TIME_S]
    rolled = present[GyroColumn.ROLL] - last[GyroColumn.ROLL]
    return rate * span_s + rolled * math.sin(pitch)


@cached_njit(error_model="numpy")
def _follow_slope(parameters: FloatArray, snapshot: FloatArray, body: int, span_s: float) -> None:
    """Move the side slip that is fixed in the map with the slope that an IMU shows.

    Roll and pitch, smoothed and averaged over both bodies, are the slope; the filter follows the
    rest of that side slip. `span_s` is the time since the last sample, NaN for the first one.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    roll = now.gyros[body, GyroColumn.ROLL]
    pitch = now.gyros[body, GyroColumn.PITCH]
    share = 1.0 if math.isnan(span_s) else -math.expm1(-span_s / _SLOPE_S)
    psi = AugmentedState.PSI_T + body
    cos = math.cos(now.augmented[0, psi])
    sin = math.sin(now.augmented[0, psi])
    slip = local((2,))  # side slip on the slope: east, north
    slip[0] = f.side_per_slope * (pitch * cos + roll * sin)
    slip[1] = f.side_per_slope * (pitch * sin - roll * cos)
    for axis in range(2):
        change = share * (slip[axis] - now.slopes[body, axis])
        now.slopes[body, axis] += change
        now.augmented[0, AugmentedState.SIDE_X + axis] += 0.5 * change


@cached_njit(error_model="numpy")
def _gate(
    parameters: FloatArray,
    snapshot: FloatArray,
    sample: FloatArray,
    reading: Reading,
    workspace: FloatArray,
) -> Comparison:
    """Correct a snapshot by a reading that passes the gate, or that was rejected for too long.

    The trailer's receiver is forced on the filter only while the gate rejects the tractor's too:
    otherwise the tractor's says where the vehicle is. A gyro teaches the filter no noise factor.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    s = record(sample, BUFFERED_SAMPLE)
    sensor = reading.sensor
    since_s = now.rejected_since[sensor]
    forced = s.time_s - since_s >= f.patience[sensor] - SAME_TIME_S
    if sensor == SensorIndex.GNSS_TRAILER:
        forced = forced and not math.isnan(now.rejected_since[SensorIndex.GNSS_TRACTOR])
    learns = SENSOR_KINDS[sensor] != SensorKind.INERTIAL
    comparison = correct(parameters, snapshot, reading, forced, learns, workspace)
    passes = comparison.normalised_squared <= f.gates[sensor]
    if passes:
        now.rejected_since[sensor] = math.nan
    elif math.isnan(since_s):
        now.rejected_since[sensor] = s.time_s
    if passes or forced:
        s.accepted = 1.0
    return comparison
