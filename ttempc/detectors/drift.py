"""Detector of a common drift of both receivers, told from the ground while driving."""

import math
from typing import Final

import numpy as np

from ..layout import FLOAT, AlarmColumn, SampleColumn
from ..sensors import GNSS_OF_BODY, IMU_OF_BODY, Body
from ..types import FloatArray, State
from .board import Record, TickData, has_alarm
from .changes import COMPARISON, compare_changes
from .ground import GROUND, ONSETS, WAYS, begin_onset, new_ground, place, travel
from .gyro import begin_gyro_alarms
from .history import kernel
from .speeds import wheel_speed
from .table import DetectorIndex
from .velocity import contradicts_drift

BINS: Final = 5
_SHORT_S: Final = 6.0
BIN_ENDS_S: Final = (_SHORT_S, 15.0, 30.0, 55.0, math.inf)
"""Ages of an onset up to which its ratio counts in a bin.

Bumps and ruts look like short drifts: the ratios of short windows are larger, so that each bin has
a limit of its own."""

DRIFT: Final = np.dtype(
    [
        ("receivers", GROUND, 2),
        ("time_s", "f8"),  # of the tick before, NaN: none yet
        ("yaws", "f8", 2),  # of the bodies at that tick [rad]
        ("between", "f8", 2),  # from tractor point to trailer point at that tick [m]
        ("slopes", "f8", (2, 2)),  # of the bodies: roll and pitch [rad]
        ("knows_slope", "f8"),  # whether an IMU has measured them
        ("ages_s", "f8", ONSETS),  # since the assumed begin of each change, -1: not in use
        ("restless_at", "f8", ONSETS),  # how restless the ground was at that begin
        ("next_onset", "f8"),  # number of the onset that is replaced next
        ("next_s", "f8"),  # time until then [s]
        ("restless", "f8"),  # mean ratio of the shortest windows
        ("restless_s", "f8"),  # over how long it is taken
        ("comparison", COMPARISON),  # of what may have begun at each onset
        ("scaled", "f8", BINS),  # largest ratio of each bin, over that of restless ground
        ("drifts_mps", "f8", (BINS, 2)),  # of the onset with that ratio, east and north
        ("drift_ages_s", "f8", BINS),  # and its age
        ("likeliest", "f8"),  # number of the bin whose ratio is largest beside its limit
        ("way", "f8", 1 + 2 * WAYS),  # workspace
    ]
)
"""Memory of the detector."""

LIMITS_WITH_SLOPE: Final = (7.6, 10.4, 11.4, 11.3, 11.8)
"""First limits of the scaled ratio by the bins of `BIN_ENDS_S`, where an IMU measures the slope.

They are a fifth above those for one false alarm an hour over all fields, by
`python -m proving_ground.experiments.papers drift-limits`."""
LIMITS_WITHOUT_SLOPE: Final = (11.5, 16.0, 18.5, 16.5, 17.5)
"""Those for one false alarm an hour without an IMU, by the same command; ground that a tool loads
makes them twice what the other fields need."""
# Where velocities of GNSS confirm the positions: times the first limits, and bins that count. A
# slip that no slope explains is far more likely than a drift that both measurements of a receiver
# share: those of 41 healthy drives on rough ground (trials of seed 10801) came to 2.5 times the
# limits in these bins, to five times in the others
_CONFIRMED_FACTOR: Final = 3.0
_CONFIRMED_BINS: Final = 3

_RESTLESS_S: Final = 60.0  # of the mean ratio of the shortest windows
_FIRST_RESTLESS_S: Final = 15.0  # weight of what is assumed of it at first
_FIRST_RESTLESS: Final = 2.5
_LARGEST_RESTLESS: Final = 12.0  # that a tick adds: a step is no restless ground
_RESTLESS_POWER: Final = 1.5  # of the restlessness, by which long ratios grow; by drives
_LONGEST_TICK_S: Final = 1.0
_EVERY_S: Final = 5.0  # from one onset to the next: the longest window is 120 s
_LEAST_AGE_S: Final = 3.0


def new_drift() -> FloatArray:
    """Return a record `DRIFT` before the first estimate, flat."""
    flat = np.zeros(DRIFT.itemsize // 8)
    memory = flat.view(DRIFT)[0]
    for body in Body:
        memory["receivers"][body] = new_ground().view(GROUND)[0]
    memory["time_s"] = math.nan
    memory["ages_s"] = -1.0
    memory["restless"] = _FIRST_RESTLESS
    memory["restless_s"] = _FIRST_RESTLESS_S
    return flat


@kernel
def observe_drift(
    memory: Record, velocity: Record, board: Record, data: TickData, confirmed: bool
) -> None:
    """Tell a drift of the positions from slopes, slips and bumps.

    Of each receiver, r is its position less dead reckoning by encoder and heading; of the trailer
    through the geometry of the estimate. With the way B that was travelled (`ground.Way`), slip
    coefficients k that wander slowly, and a drift w from a time t0 on,

        r <- r + B k + w T + noise,   position = dead reckoning + r + noise.

    A Kalman filter without w gives innovations u of covariance S, in which a drift east or north
    would show as the columns of G. Of each onset t0, every 5 s over 120 s (Willsky and Jones 1976,
    IEEE TAC 21, 108-112),

        C = sum(G' S^-1 G) / misfit + 1 / w_0^2,   d = sum(G' S^-1 u) / misfit,   J = d' C^-1 d,

    with the sums over the positions of both receivers, which share the drift.

    An encoder that is wrong by a share from t0 on, or wheels that begin to slip, move both
    positions along the heading and would pass for a drift. G has a column for this share as well:
    J is the smaller one of two, without that column, and with it less what it explains alone; it
    is 0 where an error of the encoder explains more than the drift. A drift along the heading is
    thus none until the heading turns.

    J is divided by R^1.5, R how restless the ground was when the onset was assumed: the mean over a
    minute of the largest J of the shortest windows, without that column, which bumps and slips move
    more than a slow drift. Taken before the onset, it has nothing of a drift that began with it.
    The statistic is the largest ratio of a scaled J to the limit of its bin of window lengths.

    Roll and pitch of the IMUs are what side slip and wheel slip on a slope follow, by two
    coefficients that are learnt. Without IMUs slopes look like drifts: limits are higher.

    Above the first limit the vehicle slows down, above the second one it stops, unless velocities
    of GNSS confirm the positions: then only a drift of the last 30 s counts, its limit is higher,
    it slows the vehicle down at most, and where the velocities contradict it both gyros are blamed.

    Args:
        memory: record `DRIFT`.
        velocity: record `VELOCITY` after this tick.
        board: record `BOARD`.
        data: of the tick.
        confirmed: whether measured velocities of GNSS confirm the positions: what is left to the
            ground is a drift of both.
    """
    if has_alarm(board, DetectorIndex.DRIFT_SURE):
        return  # both statistics stay
    _take_slopes(memory, data.rows)
    span_s = data.now - memory.time_s
    if 0.0 < span_s <= _LONGEST_TICK_S:
        _travel_tick(memory, data, span_s)
        _age_onsets(memory, span_s)
    _remember_pose(memory, data)

    placed = False
    for row in range(len(data.rows)):
        sample = data.rows[row]
        for body in range(2):
            if sample[SampleColumn.SENSOR] == GNSS_OF_BODY[body] and _is_usable(board, sample):
                placed |= place(
                    memory.receivers[body],
                    sample[SampleColumn.TIME_S],
                    sample[SampleColumn.FIRST],
                    sample[SampleColumn.SECOND],
                    memory.knows_slope > 0.0,
                    memory.way,
                )
    if placed and span_s > 0.0:
        _write_ratios(memory, min(span_s, _LONGEST_TICK_S))
        _judge(memory, board, confirmed)
        if confirmed:
            _blame_gyros(memory, velocity, board)


@kernel
def _is_usable(board: Record, sample: FloatArray) -> bool:
    """Return whether a position is a number, of a fixed solution, of a receiver that is used."""
    total = sample[SampleColumn.TIME_S] + sample[SampleColumn.FIRST] + sample[SampleColumn.SECOND]
    used = board.excluded[int(sample[SampleColumn.SENSOR])] == 0.0
    return used and math.isfinite(total) and sample[SampleColumn.THIRD] != FLOAT


@kernel
def _take_slopes(memory: Record, rows: FloatArray) -> None:
    """Take the mean roll and pitch that each IMU has measured in a tick.

    Means over longer times would lag behind: the slopes of a field turn with the vehicle.
    """
    for body in range(2):
        count = 0
        roll = 0.0
        pitch = 0.0
        for row in range(len(rows)):
            sample = rows[row]
            total = sample[SampleColumn.SECOND] + sample[SampleColumn.THIRD]
            if sample[SampleColumn.SENSOR] == IMU_OF_BODY[body] and math.isfinite(total):
                count += 1
                roll += sample[SampleColumn.SECOND]
                pitch += sample[SampleColumn.THIRD]
        if count:
            memory.slopes[body, 0] = roll / count
            memory.slopes[body, 1] = pitch / count
            memory.knows_slope = 1.0


@kernel
def _travel_tick(memory: Record, data: TickData, span_s: float) -> None:
    """Add the ways of both bodies in a tick."""
    state = data.estimate.state
    distance = span_s * wheel_speed(data)
    turn = _wrapped(state[State.PSI_T] - memory.yaws[Body.TRACTOR])
    yaw = memory.yaws[Body.TRACTOR] + 0.5 * turn
    tractor = memory.receivers[Body.TRACTOR]
    if math.isfinite(distance + yaw):
        travel(tractor, data.now, span_s, distance, yaw, turn, memory.slopes[Body.TRACTOR])

    # The trailer point moves as the tractor point does, and with the geometry of the vehicle
    trailer_turn = _wrapped(state[State.PSI_I] - memory.yaws[Body.TRAILER])
    trailer_yaw = memory.yaws[Body.TRAILER] + 0.5 * trailer_turn
    east = distance * math.cos(yaw)
    north = distance * math.sin(yaw)
    east += data.estimate.trailer_xy[0] - state[State.X] - memory.between[0]
    north += data.estimate.trailer_xy[1] - state[State.Y] - memory.between[1]
    along = east * math.cos(trailer_yaw) + north * math.sin(trailer_yaw)
    trailer = memory.receivers[Body.TRAILER]
    slope = memory.slopes[Body.TRAILER]
    if math.isfinite(along + trailer_yaw):
        travel(trailer, data.now, span_s, along, trailer_yaw, trailer_turn, slope)


@kernel
def _wrapped(angle: float) -> float:
    """Return an angle wrapped to half a turn."""
    return angle - math.tau * math.floor(angle / math.tau + 0.5)


@kernel
def _remember_pose(memory: Record, data: TickData) -> None:
    """Keep yaws and geometry of this tick."""
    state = data.estimate.state
    memory.yaws[Body.TRACTOR] = state[State.PSI_T]
    memory.yaws[Body.TRAILER] = state[State.PSI_I]
    memory.between[0] = data.estimate.trailer_xy[0] - state[State.X]
    memory.between[1] = data.estimate.trailer_xy[1] - state[State.Y]
    memory.time_s = data.now


@kernel
def _age_onsets(memory: Record, span_s: float) -> None:
    """Let all onsets age, and assume every five seconds that a drift begins now."""
    for number in range(ONSETS):
        if memory.ages_s[number] >= 0.0:
            memory.ages_s[number] += span_s
    memory.next_s -= span_s
    if memory.next_s > 0.0:
        return
    memory.next_s = _EVERY_S
    number = int(memory.next_onset)
    memory.next_onset = (number + 1) % ONSETS
    memory.ages_s[number] = 0.0
    memory.restless_at[number] = max(memory.restless, 1.0)
    for body in range(2):
        begin_onset(memory.receivers[body], number)


@kernel
def _write_ratios(memory: Record, span_s: float) -> None:
    """Write the largest scaled ratio of each bin, with the drift and the age of its onset.

    A ratio is over how restless the ground was at its onset: a drift is restless too, once it is.
    """
    for n in range(BINS):
        memory.scaled[n] = 0.0
    shortest = 0.0
    for number in range(ONSETS):
        age_s = memory.ages_s[number]
        if age_s >= _LEAST_AGE_S:
            compare_changes(memory.comparison, memory.receivers, number)
            if age_s < _SHORT_S:
                shortest = max(shortest, memory.comparison.ratios[number].drift)
    for number in range(ONSETS):
        age_s = memory.ages_s[number]
        ratios = memory.comparison.ratios[number]
        if age_s < _LEAST_AGE_S or _is_of_encoder(memory, number):
            continue
        n = 0
        while age_s >= BIN_ENDS_S[n]:
            n += 1
        scaled = min(ratios.drift, ratios.beside) / memory.restless_at[number] ** _RESTLESS_POWER
        if scaled > memory.scaled[n]:
            memory.scaled[n] = scaled
            memory.drifts_mps[n, 0] = ratios.drift_mps[0]
            memory.drifts_mps[n, 1] = ratios.drift_mps[1]
            memory.drift_ages_s[n] = age_s
    if shortest > 0.0:
        memory.restless_s = min(memory.restless_s + span_s, _RESTLESS_S)
        share = span_s / memory.restless_s
        memory.restless += share * (min(shortest, _LARGEST_RESTLESS) - memory.restless)


@kernel
def _is_of_encoder(memory: Record, number: int) -> bool:
    """Return whether an error of the encoder explains more than the drift of an onset.

    It may have begun at any time from the onset before on: at the wrong one it leaves a rest that
    a drift explains.
    """
    ratios = memory.comparison.ratios
    oldest_s = memory.ages_s[number] + 1.5 * _EVERY_S
    for other in range(ONSETS):
        counts = _LEAST_AGE_S <= memory.ages_s[other] < oldest_s
        if counts and ratios[other].encoder > ratios[number].drift:
            return True
    return False


@kernel
def _judge(memory: Record, board: Record, confirmed: bool) -> None:
    """Write the statistic of both limits, and the drift.

    Where GNSS velocities confirm the positions that of the second limit is 0: a slip that no slope
    explains is far more likely than a receiver that lies alike in both.
    """
    factor = _CONFIRMED_FACTOR if confirmed else 1.0
    largest = 0.0
    memory.likeliest = 0.0
    for n in range(_CONFIRMED_BINS if confirmed else BINS):
        limit = LIMITS_WITH_SLOPE[n] if memory.knows_slope > 0.0 else LIMITS_WITHOUT_SLOPE[n]
        if memory.scaled[n] / (factor * limit) > largest:
            largest = memory.scaled[n] / (factor * limit)
            memory.likeliest = n
    n = int(memory.likeliest)
    drift_mps = math.hypot(memory.drifts_mps[n, 0], memory.drifts_mps[n, 1])
    board.statistic[DetectorIndex.DRIFT] = largest
    board.statistic[DetectorIndex.DRIFT_SURE] = 0.0 if confirmed else largest
    for index in (DetectorIndex.DRIFT, DetectorIndex.DRIFT_SURE):
        board.residual[index] = largest
        board.proposed[index, AlarmColumn.FIRST] = 100.0 * drift_mps
        board.proposed[index, AlarmColumn.SECOND] = drift_mps * memory.drift_ages_s[n]


@kernel
def _blame_gyros(memory: Record, velocity: Record, board: Record) -> None:
    """Blame both gyros for a drift that velocities of GNSS contradict; begin anew without them.

    Gyros of one make fail alike and bend dead reckoning. The alarm is that of the drift where the
    velocities do not tell yet, where the gyros are not used any more, and where their detectors do
    not run.
    """
    index = DetectorIndex.DRIFT
    if memory.knows_slope == 0.0 or not board.statistic[index] > board.limit[index]:
        return
    n = int(memory.likeliest)
    drift_mps = memory.drifts_mps[n]
    if contradicts_drift(velocity, drift_mps, memory.drift_ages_s[n]) and begin_gyro_alarms(board):
        board.statistic[index] = 0.0
        memory.ages_s[:] = -1.0
