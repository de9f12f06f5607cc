"""Detector of a gyro that contradicts the turn of its receiver's track; one for each body.

Beside it stands the turn of the wheels: the hitch detector asks whether a gyro that contradicts
it is what it sees. The detector of drift does not ask the wheels: in 17 of 102 drives whose
receivers drifted (seed 9101) a gyro without a fault contradicted them. It blames both gyros where
velocities of GNSS contradict the drift.
"""

import math
from typing import Final

import numpy as np

from ..layout import FLOAT, AlarmColumn, SampleColumn
from ..models.augmented_state import VehicleParameter
from ..sensors import GNSS_OF_BODY, IMU_OF_BODY, Body, SensorIndex
from ..types import FloatArray, State
from .board import Record, TickData, has_alarm
from .history import Entry, forget, kernel, remember, sums
from .table import DetectorIndex

_BASE: Final = 10  # positions from which a direction is taken: 2 s at five a second
_WINDOW: Final = 100  # directions over which the turns are compared: 20 s
_PLACE: Final = 3  # numbers of a place: x, y [m], angle of the gyro [rad]
_TURNS_S: Final = 3.0  # for which the turns of the wheels are summed up
_TURNS: Final = 302  # of these seconds: control at 100 Hz

ANGLES: Final = np.dtype([("front", "f8"), ("hitch", "f8"), ("trailer", "f8")])
"""Latest readings of front steering, hitch and trailer steering [rad]."""

GYRO: Final = np.dtype(
    [
        ("time_s", "f8"),  # of the latest sample of the IMU, 0: none yet
        ("angle", "f8"),  # integral of the yaw rate [rad]
        ("places", "f8", (_BASE + 1, _PLACE)),  # ring of the last places
        ("place", "f8"),  # number of places
        ("differences", "f8", _WINDOW),  # ring: direction of the track less angle of the gyro [rad]
        ("difference", "f8"),  # number of differences
        ("contradicted", "f8"),  # comparisons in succession that contradict
        ("angles", ANGLES),
        ("angle_before", "f8"),  # of the gyro at the tick before [rad]
        # History of each tick: turn of the gyro less that of the wheels, size of the latter [rad]
        ("turns", "f8", (1 + _TURNS, 3)),
    ]
)
"""Memory of the detector."""

_LARGEST: Final = 0.20  # difference of both turns in 20 s [rad]: side slip changes in curves
_LEAST_M: Final = 0.8  # moved between both ends of a direction
_IN_SUCCESSION: Final = 15.0  # longer than a step of the positions turns the track
# Difference of the turns of gyro and wheels in 3 s; all by hand
_LEAST_TURN: Final = 0.02  # [rad] by an offset of the front steering
_SHARE_OF_TURN: Final = 0.06  # by side slip
_AT_ONCE: Final = 0.6  # of the difference, in one tick
_BLAMED: Final = 2.0  # times its limit: the statistic of a gyro that is blamed


def new_gyro() -> FloatArray:
    """Return a record `GYRO` before the first sample, flat."""
    flat = np.zeros(GYRO.itemsize // 8)
    angles = flat.view(GYRO)[0]["angles"]
    for name in ANGLES.names or ():
        angles[name] = math.nan
    return flat


@kernel
def observe_gyro(memory: Record, board: Record, data: TickData, body: int) -> None:
    """Compare the turn of a gyro with that of the track of the receiver on the same body.

    The direction of the last 2 s of the track, less the angle of the gyro in the middle of them,
    is constant but for side slip. Its change over 20 s beyond 0.2 rad in 3 s of comparisons in
    succession is an alarm: a wrong sign, axis, unit or scale shows in the first curve, whatever
    the gyro of the other body says. The alarm stands until `resume`; the IMU is not used.

    Args:
        memory: record `GYRO`.
        board: record `BOARD`.
        data: of the tick.
        body: `Body` that carries both.
    """
    index = DetectorIndex.GYRO_TRACTOR + body
    if has_alarm(board, index):
        return
    _integrate(memory, data.rows, IMU_OF_BODY[body])
    _add_turn(memory, board, data, body)
    for row in range(len(data.rows)):
        sample = data.rows[row]
        total = sample[SampleColumn.FIRST] + sample[SampleColumn.SECOND]
        is_mine = sample[SampleColumn.SENSOR] == GNSS_OF_BODY[body] and math.isfinite(total)
        if not is_mine or memory.time_s == 0.0:
            continue
        if sample[SampleColumn.THIRD] == FLOAT or board.excluded[GNSS_OF_BODY[body]] > 0.0:
            memory.place = 0.0
            memory.difference = 0.0
        else:
            _compare(memory, sample[SampleColumn.FIRST], sample[SampleColumn.SECOND])
    board.statistic[index] = memory.contradicted / _IN_SUCCESSION
    board.residual[index] = memory.contradicted
    board.proposed[index, AlarmColumn.FIRST] = 0.0


@kernel
def _integrate(memory: Record, rows: FloatArray, sensor: int) -> None:
    """Add the yaw rates of a tick to the angle of the gyro."""
    for row in range(len(rows)):
        sample = rows[row]
        rate = sample[SampleColumn.FIRST]
        if sample[SampleColumn.SENSOR] != sensor or not math.isfinite(rate):
            continue
        span_s = sample[SampleColumn.TIME_S] - memory.time_s
        if memory.time_s > 0.0 and 0.0 < span_s < 1.0:
            memory.angle += span_s * rate
        memory.time_s = sample[SampleColumn.TIME_S]


@kernel
def _compare(memory: Record, x: float, y: float) -> None:
    """Take in a position: a new direction of the track, and its change over the window."""
    size = _BASE + 1
    newest = memory.places[int(memory.place) % size]
    newest[0] = x
    newest[1] = y
    newest[2] = memory.angle
    memory.place += 1.0
    if memory.place < size:
        return
    oldest = memory.places[int(memory.place) % size]
    middle = memory.places[(int(memory.place) + _BASE // 2) % size]
    if math.hypot(x - oldest[0], y - oldest[1]) < _LEAST_M:
        memory.difference = 0.0  # a vehicle that stands or creeps has no direction
        return
    difference = math.atan2(y - oldest[1], x - oldest[0]) - middle[2]

    number = int(memory.difference)
    before = memory.differences[number % _WINDOW]
    memory.differences[number % _WINDOW] = difference
    memory.difference += 1.0
    if number < _WINDOW:
        return
    change = difference - before
    change -= math.tau * math.floor(change / math.tau + 0.5)
    memory.contradicted = memory.contradicted + 1.0 if abs(change) > _LARGEST else 0.0


@kernel
def blame_gyros(gyros: Record, board: Record) -> bool:
    """Begin the alarms of both gyros where one contradicts the wheels; return whether one does.

    For the hitch detector where its statistic is above its limit, which a lying gyro raises as
    well as a wrong angle. A gyro whose detector does not run, or that has its alarm already, is
    not asked.

    Args:
        gyros: records `GYRO` of tractor and trailer, after this tick.
        board: record `BOARD`.
    """
    blamed = False
    for body in range(2):
        index = DetectorIndex.GYRO_TRACTOR + body
        is_judged = board.enabled[index] and not has_alarm(board, index)
        blamed = blamed or (is_judged and _contradicts_wheels(gyros[body]))
    return blamed and begin_gyro_alarms(board)


@kernel
def begin_gyro_alarms(board: Record) -> bool:
    """Begin the alarms of both gyros; return whether one begins that did not stand yet.

    Gyros of one make fail alike, so that neither is used any more.
    """
    begins = False
    for index in (DetectorIndex.GYRO_TRACTOR, DetectorIndex.GYRO_TRAILER):
        if board.enabled[index] and not has_alarm(board, index):
            board.statistic[index] = _BLAMED * board.limit[index]
            begins = True
    return begins


@kernel
def _contradicts_wheels(memory: Record) -> bool:
    """Return whether the gyro has turned otherwise than the wheels in the last 3 s.

    The bound is a part of the turn and a constant, which a vehicle without a fault passes where it
    slips much: it says which of two sensors lies, not that one does. A difference that comes in one
    tick is an offset of an angle.
    """
    turns = memory.turns
    difference, size = sums(turns)
    largest = 0.0
    for n in range(1, 1 + int(turns[0, 0])):
        largest = max(largest, abs(turns[n, Entry.FIRST]))
    comes_at_once = largest > _AT_ONCE * abs(difference)
    return not comes_at_once and abs(difference) > _LEAST_TURN + _SHARE_OF_TURN * size


@kernel
def _add_turn(memory: Record, board: Record, data: TickData, body: int) -> None:
    """Add the turns of a tick: of the gyro, and of the wheels that the other sensors tell.

    The tractor turns at v tan(delta_t) / L_t. The trailer's heading is that of the tractor less
    hitch angle and trailer steering. Where one of the angles is not known, because it has not been
    measured yet or its sensor repeats one reading, the comparison begins anew.
    """
    angles = memory.angles
    hitch = angles.hitch
    trailer = angles.trailer
    for row in range(len(data.rows)):
        sample = data.rows[row]
        sensor = int(sample[SampleColumn.SENSOR])
        angle = sample[SampleColumn.FIRST] if board.excluded[sensor] == 0.0 else math.nan
        if sensor == SensorIndex.STEERING_TRACTOR:
            angles.front = angle
        elif sensor == SensorIndex.HITCH:
            angles.hitch = angle
        elif sensor == SensorIndex.STEERING_TRAILER:
            angles.trailer = angle

    gyro = memory.angle - memory.angle_before
    memory.angle_before = memory.angle
    speed = data.estimate.state[State.V]
    wheels = speed * math.tan(angles.front) / data.parameters[VehicleParameter.WHEELBASE]
    wheels *= data.span_s
    if body == Body.TRAILER:
        wheels -= angles.hitch - hitch + angles.trailer - trailer
    if memory.time_s == 0.0 or not math.isfinite(wheels):
        forget(memory.turns)
        return
    remember(memory.turns, data.now - _TURNS_S, data.now, gyro - wheels, abs(wheels))
