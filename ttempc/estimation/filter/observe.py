"""A tick of the filter: new samples go in, the estimate comes out."""

from __future__ import annotations

import math
from typing import Final

from ...jit import cached_njit, local, record
from ...layout import ESTIMATE, InnovationColumn, SampleColumn
from ...models.augmented_state import STATES, AugmentedState, write_estimate
from ...sensors import (
    IMU_OF_BODY,
    INNOVATION_SIZES,
    NEEDED_AT_START,
    SENSOR_BODIES,
    SENSOR_COUNT,
    SENSOR_KINDS,
    SENSOR_LENGTHS,
    Body,
    SensorKind,
)
from ...types import FloatArray, State
from ..noise import SCALES, NoiseScale
from .correct import CORRECTION_SIZE, Comparison
from .history import (
    BUFFERED_SAMPLE,
    HISTORY,
    FilterMemory,
    append_command,
    copy_row,
    forget_commands,
    forget_samples,
    forget_snapshots,
    insert_sample,
    is_finite,
    is_inertial,
    is_repeated,
    nearest_inertial,
    newest_snapshot,
    place_of,
    snapshot_at,
    spare_snapshot,
)
from .predict import predict_until
from .records import DISTURBANCES, FILTER, SAME_TIME_S, SNAPSHOT, GyroColumn
from .sample import apply_sample, knows_attitude, shift_on_slope, trailer_arm

LONGEST_GAP_S: Final = 1.0
"""Without update and sample for longer [s], the filter starts anew, see `observe_filter`."""

_SPACING_S: Final = 0.15  # of snapshots: short enough where every update has a late sample
_BODIES: Final = len(Body)
_SIDE: Final = int(AugmentedState.SIDE_X)


@cached_njit(error_model="numpy", nogil=True)
def observe_filter(
    parameters: FloatArray,
    memory: FilterMemory,
    rows: FloatArray,
    now_s: float,
    command: FloatArray,
    estimate: FloatArray,
    innovations: FloatArray,
) -> bool:
    """Take in the samples `rows` of a tick, and write the estimate at `now_s`.

    Args:
        parameters: `FILTER`.
        memory: changed in place; it needs space for all rows, see `with_space`.
        rows: (n, `SAMPLE`) in the order of arrival; rows of no sensor are left out.
        now_s: time of this update [s]; the one before may be repeated.
        command: (6,), the rest of a row of commands, of the period that ends at `now_s`: inputs,
            NaN where none is known, and changes.
        estimate: `ESTIMATE`.
        innovations: rows (n, `INNOVATION`) of the samples, of dimension 0 where there is none.

    Returns whether the filter has not started and has a reading of every sensor: then the caller
    may write the first snapshot, and update to the same time again.

    A late sample takes the filter back to the last snapshot before it; all samples from there on
    are processed again in the order of their times. The result depends neither on the order of
    arrival nor on where snapshots stand. If neither a sample nor an update came for more than
    `LONGEST_GAP_S`, or the clock was set back by more, the filter starts anew from the next
    readings, whatever the time in between. It takes over the factors of the noise, and the
    disturbances, faded as if the vehicle had driven on at its speed, with the variances of a start.
    """
    f = record(parameters, FILTER)
    h = record(memory.history, HISTORY)
    earliest_s = now_s - f.memory_s - SAME_TIME_S
    _leave_after_gap(parameters, memory, rows, now_s, earliest_s)
    h.now_s = now_s
    append_command(memory, now_s, command)
    yaws = local((_BODIES,))
    _write_headings(parameters, memory, rows, yaws)
    since_s = _insert_samples(parameters, memory, rows, now_s, yaws, innovations)

    # Process what is new, and drop what no late sample can need
    oldest_s = earliest_s
    present = local((SENSOR_COUNT,))
    newest = spare_snapshot(memory)
    if h.snapshots > 0:
        newest = _process_samples(parameters, memory, since_s, innovations)
        forget_snapshots(memory, earliest_s)
        # Nothing older can arrive: the snapshot itself moves on, so that later ticks predict less.
        if record(newest, SNAPSHOT).time_s < earliest_s:
            predict_until(parameters, newest, memory.commands, h.commands, earliest_s)
        oldest_s = min(earliest_s, record(snapshot_at(memory, 0), SNAPSHOT).time_s)
    forget_samples(memory, oldest_s, present)
    forget_commands(memory, parameters, oldest_s)

    if h.snapshots == 0:
        _write_no_estimate(estimate, now_s)
        return _may_start(present)
    _write_present(parameters, memory, newest, now_s, estimate)
    _add_innovations(innovations, estimate)
    return False


@cached_njit(error_model="numpy")
def _leave_after_gap(
    parameters: FloatArray, memory: FilterMemory, rows: FloatArray, now_s: float, earliest_s: float
) -> None:
    """Empty the memory after a gap of updates and samples, or when the clock was set back."""
    h = record(memory.history, HISTORY)
    newest_s = math.nan  # time to which samples were processed
    if h.snapshots > 0:
        newest_s = record(newest_snapshot(memory), SNAPSHOT).time_s
    elif h.samples > 0:
        newest_s = record(memory.samples[h.samples - 1], BUFFERED_SAMPLE).time_s
    next_s = now_s  # first new sample after that
    for n in range(len(rows)):
        time_s = rows[n, SampleColumn.TIME_S]
        if max(earliest_s, newest_s) < time_s < next_s:
            next_s = time_s
    set_back = now_s - h.now_s < -LONGEST_GAP_S
    gap = now_s - h.now_s > LONGEST_GAP_S and next_s - newest_s > LONGEST_GAP_S
    if not (set_back or gap):
        return
    if h.snapshots > 0:
        spare = spare_snapshot(memory)
        copy_row(newest_snapshot(memory), spare)
        _fade_disturbances(parameters, spare, abs(now_s - newest_s))
        h.resumes = 1
    h.snapshots = 0
    h.samples = 0
    h.commands = 0


@cached_njit(error_model="numpy")
def _fade_disturbances(parameters: FloatArray, snapshot: FloatArray, span_s: float) -> None:
    """Let the disturbances of a snapshot fade over a time at its wheel speed."""
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    travel = abs(now.augmented[0, AugmentedState.WHEEL_SPEED]) * span_s
    for i in range(DISTURBANCES):
        fading = f.fading[i] * span_s + f.fading[DISTURBANCES + i] * travel
        now.augmented[0, STATES + i] *= math.exp(-fading)


@cached_njit(error_model="numpy")
def _write_headings(
    parameters: FloatArray, memory: FilterMemory, rows: FloatArray, yaws: FloatArray
) -> None:
    """Write the headings (2,) of both bodies, with which antenna positions are corrected [rad].

    They are those of the newest snapshot; before the start, of the line between both antennas.
    """
    f = record(parameters, FILTER)
    h = record(memory.history, HISTORY)
    for body in range(_BODIES):
        yaws[body] = 0.0
    if h.snapshots > 0:
        last = record(newest_snapshot(memory), SNAPSHOT)
        yaws[Body.TRACTOR] = last.augmented[0, State.PSI_T]
        yaws[Body.TRAILER] = last.augmented[0, State.PSI_I]
        return
    if not (f.antenna_heights[Body.TRACTOR] > 0.0 or f.antenna_heights[Body.TRAILER] > 0.0):
        return
    places = local((_BODIES, 2))
    for body in range(_BODIES):
        places[body, 0] = math.nan
        places[body, 1] = math.nan
    for n in range(h.samples):
        s = record(memory.samples[n], BUFFERED_SAMPLE)
        _note_place(int(s.sensor), s.entries[0], s.entries[1], places)
    for n in range(len(rows)):
        if _is_sensor(rows[n]):
            sensor = int(rows[n, SampleColumn.SENSOR])
            _note_place(sensor, rows[n, SampleColumn.FIRST], rows[n, SampleColumn.SECOND], places)
    x = places[Body.TRACTOR, 0] - places[Body.TRAILER, 0]
    y = places[Body.TRACTOR, 1] - places[Body.TRAILER, 1]
    line = math.atan2(y, x)
    if not math.isnan(line):
        yaws[Body.TRACTOR] = line
        yaws[Body.TRAILER] = line


@cached_njit(error_model="numpy")
def _note_place(sensor: int, x: float, y: float, places: FloatArray) -> None:
    """Write a sample of a receiver that is a number into the places (2, 2) of the bodies."""
    if SENSOR_KINDS[sensor] == SensorKind.POSITION and not math.isnan(x + y):
        places[SENSOR_BODIES[sensor], 0] = x
        places[SENSOR_BODIES[sensor], 1] = y


@cached_njit(error_model="numpy")
def _is_sensor(row: FloatArray) -> bool:
    """Whether a row of samples has the number of a sensor."""
    return 0.0 <= row[SampleColumn.SENSOR] < SENSOR_COUNT


@cached_njit(error_model="numpy")
def _insert_samples(
    parameters: FloatArray,
    memory: FilterMemory,
    rows: FloatArray,
    now_s: float,
    yaws: FloatArray,
    innovations: FloatArray,
) -> float:
    """Insert new samples in the order of time; return the earliest time of one that is used [s].

    Those of the IMUs go first: antenna positions are corrected with them.
    """
    since_s = math.inf
    for inertial in (True, False):
        for n in range(len(rows)):
            if _is_sensor(rows[n]) and is_inertial(rows[n]) == inertial:
                time_s = _insert_row(parameters, memory, rows[n], n, now_s, yaws, innovations[n])
                since_s = min(since_s, time_s)
    return since_s


@cached_njit(error_model="numpy")
def _insert_row(
    parameters: FloatArray,
    memory: FilterMemory,
    row: FloatArray,
    arrival: int,
    now_s: float,
    yaws: FloatArray,
    innovation: FloatArray,
) -> float:
    """Insert a new sample and begin its innovation; return its time, infinite if it is not used.

    Left out are samples that are not finite, that have come before, from the future, or from before
    the memory or its first snapshot.
    """
    f = record(parameters, FILTER)
    h = record(memory.history, HISTORY)
    time_s = row[SampleColumn.TIME_S]
    sensor = int(row[SampleColumn.SENSOR])
    begin_s = -math.inf
    if h.snapshots > 0:
        begin_s = record(snapshot_at(memory, 0), SNAPSHOT).time_s
    earliest_s = now_s - f.memory_s - SAME_TIME_S
    latest_s = now_s + SAME_TIME_S
    in_memory = earliest_s <= time_s <= latest_s and time_s > begin_s
    good = is_finite(row) and in_memory
    used = f.variances[sensor] > 0.0
    at = place_of(memory, time_s, sensor)
    repeated = is_repeated(memory, at, time_s, sensor)

    # Of a sample that is compared later, the rest is written then; others are rejected here
    rejected = used and (repeated or not good)
    innovation[InnovationColumn.SENSOR] = sensor
    innovation[InnovationColumn.NORMALISED_SQUARED] = math.inf
    innovation[InnovationColumn.DIMENSION] = SENSOR_LENGTHS[sensor] if rejected else 0.0
    innovation[InnovationColumn.ACCEPTED] = 0.0
    innovation[InnovationColumn.WHITENED_FIRST] = math.nan
    innovation[InnovationColumn.WHITENED_SECOND] = math.nan
    innovation[InnovationColumn.LOG_DETERMINANT] = math.nan

    corrects = f.antenna_heights[Body.TRACTOR] + f.antenna_heights[Body.TRAILER] > 0.0
    if repeated or not good or not (used or corrects):
        return math.inf
    insert_sample(memory, at, row, arrival)
    if SENSOR_KINDS[sensor] == SensorKind.POSITION:
        _move_to_axle(parameters, memory, at, yaws)
    return time_s if used else math.inf


@cached_njit(error_model="numpy")
def _move_to_axle(parameters: FloatArray, memory: FilterMemory, at: int, yaws: FloatArray) -> None:
    """Move a position in the buffer from the antenna to the axle point below it.

    An antenna at height h moves h sin(roll) to the right of its point and h cos(roll) sin(pitch)
    ahead of it. Roll and pitch are those of the sample of the body's IMU that is nearest in time;
    without one a position stays as it is.
    """
    f = record(parameters, FILTER)
    s = record(memory.samples[at], BUFFERED_SAMPLE)
    body = SENSOR_BODIES[int(s.sensor)]
    height = f.antenna_heights[body]
    if not height > 0.0:
        return
    nearest = nearest_inertial(memory, IMU_OF_BODY[body], s.time_s)
    if nearest < 0:
        return
    attitude = record(memory.samples[nearest], BUFFERED_SAMPLE)
    roll = attitude.entries[1]
    pitch = attitude.entries[2]
    right = height * math.sin(roll)
    ahead = height * math.cos(roll) * math.sin(pitch)
    cos = math.cos(yaws[body])
    sin = math.sin(yaws[body])
    s.entries[0] -= ahead * cos + right * sin
    s.entries[1] -= ahead * sin - right * cos


@cached_njit(error_model="numpy")
def _process_samples(
    parameters: FloatArray, memory: FilterMemory, since_s: float, innovations: FloatArray
) -> FloatArray:
    """Process all samples from `since_s` on; return the snapshot after the last one.

    Snapshots from there on are dropped and made again, `_SPACING_S` apart. There must be one
    before.
    """
    f = record(parameters, FILTER)
    h = record(memory.history, HISTORY)
    while record(newest_snapshot(memory), SNAPSHOT).time_s >= since_s:
        h.snapshots -= 1
    now = newest_snapshot(memory)
    start_s = record(now, SNAPSHOT).time_s
    made_s = start_s  # time of the first sample of the snapshot that still moves on
    workspace = local((CORRECTION_SIZE,))
    for k in range(h.samples):
        s = record(memory.samples[k], BUFFERED_SAMPLE)
        if s.time_s <= start_s or f.variances[int(s.sensor)] == 0.0:
            continue
        time_s = record(now, SNAPSHOT).time_s
        if s.time_s > time_s:
            if time_s - made_s >= _SPACING_S or time_s == start_s:
                h.snapshots += 1
                made_s = s.time_s
                copy_row(now, newest_snapshot(memory))
                now = newest_snapshot(memory)
            predict_until(parameters, now, memory.commands, h.commands, s.time_s)
        comparison = apply_sample(parameters, now, memory.samples[k], workspace)
        if s.arrival >= 0.0 and not is_inertial(memory.samples[k]):
            _write_innovation(comparison, memory.samples[k], innovations[int(s.arrival)])
    return now


@cached_njit(error_model="numpy")
def _write_innovation(comparison: Comparison, sample: FloatArray, innovation: FloatArray) -> None:
    """Write the innovation of a new sample; its sensor stands there already."""
    s = record(sample, BUFFERED_SAMPLE)
    innovation[InnovationColumn.NORMALISED_SQUARED] = comparison.normalised_squared
    innovation[InnovationColumn.DIMENSION] = INNOVATION_SIZES[int(s.sensor)]
    innovation[InnovationColumn.ACCEPTED] = s.accepted
    innovation[InnovationColumn.WHITENED_FIRST] = comparison.first
    innovation[InnovationColumn.WHITENED_SECOND] = comparison.second
    innovation[InnovationColumn.LOG_DETERMINANT] = comparison.log_determinant


@cached_njit(error_model="numpy")
def _may_start(present: FloatArray) -> bool:
    """Whether there is a sample of every sensor that the start needs."""
    for sensor in range(SENSOR_COUNT):
        if NEEDED_AT_START[sensor] and present[sensor] == 0.0:
            return False
    return True


@cached_njit(error_model="numpy")
def _write_no_estimate(estimate: FloatArray, now_s: float) -> None:
    """Write the `ESTIMATE` of a filter that has not started: NaN."""
    for i in range(len(estimate)):
        estimate[i] = math.nan
    e = record(estimate, ESTIMATE)
    e.time_s = now_s
    e.nis = 0.0
    e.nis_dof = 0.0
    e.position_seen = 0.0


@cached_njit(error_model="numpy")
def _write_present(
    parameters: FloatArray,
    memory: FilterMemory,
    newest: FloatArray,
    now_s: float,
    estimate: FloatArray,
) -> None:
    """Predict a copy of the newest state to `now_s` and write the estimate of it."""
    h = record(memory.history, HISTORY)
    present = newest
    if now_s - record(newest, SNAPSHOT).time_s > SAME_TIME_S:
        present = spare_snapshot(memory)
        copy_row(newest, present)
        predict_until(parameters, present, memory.commands, h.commands, now_s)
    write_snapshot(parameters, present, estimate)
    record(estimate, ESTIMATE).time_s = now_s


@cached_njit(error_model="numpy")
def _add_innovations(innovations: FloatArray, estimate: FloatArray) -> None:
    """Add the normalised innovations of this tick, and whether a position was accepted."""
    e = record(estimate, ESTIMATE)
    for n in range(len(innovations)):
        size = innovations[n, InnovationColumn.DIMENSION]
        normalised_squared = innovations[n, InnovationColumn.NORMALISED_SQUARED]
        if size > 0.0 and normalised_squared < math.inf:
            e.nis += normalised_squared
            e.nis_dof += size
            sensor = int(innovations[n, InnovationColumn.SENSOR])
            if SENSOR_KINDS[sensor] == SensorKind.POSITION:
                e.position_seen = max(e.position_seen, innovations[n, InnovationColumn.ACCEPTED])


@cached_njit(error_model="numpy")
def write_snapshot(parameters: FloatArray, snapshot: FloatArray, estimate: FloatArray) -> None:
    """Write what an `ESTIMATE` has from a `SNAPSHOT`; nothing came in at it.

    The covariance is the filter's and that of what no state follows (Jazwinski 1970, sec. 8.4). On
    a slope the axle points, at different heights above it, are shifted against each other, see
    `_write_shift`.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    e = record(estimate, ESTIMATE)
    x = now.augmented[0]
    write_estimate(x, now.covariances[0], f.vehicle, estimate)
    for i in range(STATES):
        e.covariance[i, i] += f.unmodelled[i]

    if knows_attitude(snapshot):
        _write_shift(parameters, snapshot, estimate)
    else:
        _add_unknown_shift(parameters, snapshot, estimate)

    # The position has the noise of the last roll, see `_step_aside`
    if not math.isnan(now.gyros[Body.TRACTOR, GyroColumn.TIME_S]):
        by_roll = f.axle_height**2 * f.roll_variance
        e.covariance[State.X, State.X] += by_roll * math.sin(x[AugmentedState.PSI_T]) ** 2
        e.covariance[State.Y, State.Y] += by_roll * math.cos(x[AugmentedState.PSI_T]) ** 2

    wheel_speed = x[AugmentedState.WHEEL_SPEED]
    by_bumps = now.scales[NoiseScale.GROUND] * f.speed_unmodelled * wheel_speed * wheel_speed
    e.covariance[State.V, State.V] += by_bumps
    for n in range(SCALES):
        e.noise_factors[n] = now.scales[n]
    e.time_s = now.time_s
    e.nis = 0.0
    e.nis_dof = 0.0
    e.position_seen = 0.0


@cached_njit(error_model="numpy")
def _write_shift(parameters: FloatArray, snapshot: FloatArray, estimate: FloatArray) -> None:
    """Move the trailer in an `ESTIMATE` by the shift of its axle point on the slope.

    Controllers use a flat model. The yaw of the trailer is therefore the one with which that model
    has the trailer point where it is; the covariance has the difference to the true yaw.
    """
    now = record(snapshot, SNAPSHOT)
    e = record(estimate, ESTIMATE)
    shift = shift_on_slope(parameters, snapshot)
    psi_i = now.augmented[0, AugmentedState.PSI_I]
    e.trailer_xy[0] += shift.ahead * math.cos(psi_i) - shift.left * math.sin(psi_i)
    e.trailer_xy[1] += shift.ahead * math.sin(psi_i) + shift.left * math.cos(psi_i)
    turn = -shift.left / trailer_arm(parameters, snapshot)
    e.state[State.PSI_I] += turn
    e.hitch_angle -= turn
    e.covariance[State.PSI_I, State.PSI_I] += turn**2


@cached_njit(error_model="numpy")
def _add_unknown_shift(parameters: FloatArray, snapshot: FloatArray, estimate: FloatArray) -> None:
    """Add the variance of a shift of the axle points against each other on an unknown slope.

    Half of the shift goes into the position, and the line between both points turns. The slope's
    square is the square of the side slip on it, less its variance.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    e = record(estimate, ESTIMATE)
    x = now.augmented[0]
    side_x = x[AugmentedState.SIDE_X]
    side_y = x[AugmentedState.SIDE_Y]
    square = side_x**2 + side_y**2
    variance = now.covariances[0, AugmentedState.SIDE_X, AugmentedState.SIDE_X]
    variance += now.covariances[0, AugmentedState.SIDE_Y, AugmentedState.SIDE_Y]
    if square <= variance:
        return
    shift_squared = (f.axle_difference * f.slope_per_slip) ** 2 * (1.0 - variance / square)
    psi_i = x[AugmentedState.PSI_I]
    across = side_y * math.cos(psi_i) - side_x * math.sin(psi_i)
    e.covariance[State.PSI_I, State.PSI_I] += shift_squared * (across / f.line) ** 2
    for i in range(2):
        for j in range(2):
            e.covariance[i, j] += 0.25 * shift_squared * x[_SIDE + i] * x[_SIDE + j]
