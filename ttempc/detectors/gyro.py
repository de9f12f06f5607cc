"""Detector of a gyro that contradicts the turn of its receiver's track; one for each body."""

import math
from typing import Final

import numpy as np

from ..layout import FLOAT, AlarmColumn, SampleColumn
from ..sensors import GNSS_OF_BODY, IMU_OF_BODY
from ..types import FloatArray
from .board import Record, TickData, has_alarm
from .history import kernel
from .table import DetectorIndex

_BASE: Final = 10  # positions from which a direction is taken: 2 s at five a second
_WINDOW: Final = 100  # directions over which the turns are compared: 20 s
_PLACE: Final = 3  # numbers of a place: x, y [m], angle of the gyro [rad]

GYRO: Final = np.dtype(
    [
        ("time_s", "f8"),  # of the latest sample of the IMU, 0: none yet
        ("angle", "f8"),  # integral of the yaw rate [rad]
        ("places", "f8", (_BASE + 1, _PLACE)),  # ring of the last places
        ("place", "f8"),  # number of places
        ("differences", "f8", _WINDOW),  # ring: direction of the track less angle of the gyro [rad]
        ("difference", "f8"),  # number of differences
        ("contradicted", "f8"),  # comparisons in succession that contradict
    ]
)
"""Memory of the detector."""

_LARGEST: Final = 0.20  # difference of both turns in 20 s [rad]: side slip changes in curves
_LEAST_M: Final = 0.8  # moved between both ends of a direction
_IN_SUCCESSION: Final = 15.0  # longer than a step of the positions turns the track


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
