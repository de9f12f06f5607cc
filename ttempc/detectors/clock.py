"""Detector of time stamps that run away from the rhythm of their sensor; one for each sensor.

A sensor whose delay grows and that stamps its samples as they arrive says nothing wrong but the
time: its samples come a little farther apart than it takes them.
"""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn, SampleColumn
from .board import Record, TickData, has_alarm
from .history import kernel
from .table import DetectorIndex

CLOCK: Final = np.dtype(
    [
        ("time_s", "f8"),  # of the latest sample, NaN: none yet
        ("period_s", "f8"),  # learnt
        ("count", "f8"),  # samples from which it is learnt
        ("irregular", "f8"),  # mean deviation of an interval from whole periods, over the period
        ("late_s", "f8"),  # of the latest sample behind the rhythm
    ]
)
"""Memory of the detector."""

_LEARNT: Final = 60.0  # samples before the first judgement
_FORGETS: Final = 20_000.0  # samples in the mean period: no sensor's clock changes sooner
_REGULAR: Final = 0.2  # largest mean deviation of a sensor that keeps a rhythm; assumed
_GAP: Final = 0.3  # of a period, from which on a deviation is a gap or a restart
_AGREED_S: Final = 300.0  # in which a constant delay is agreed with


@kernel
def observe_clock(memory: Record, board: Record, data: TickData, sensor: int) -> None:
    """Add up how far the stamps of a sensor run away from its own rhythm.

    With intervals d between stamps and the learnt period P, the lateness is the sum of
    d - P round(d / P), which is 0 on average for any jitter, and grows with a delay that grows. It
    fades in five minutes. A sensor that keeps no rhythm is not judged.

    Args:
        memory: record `CLOCK` of the sensor.
        board: record `BOARD`.
        data: of the tick.
        sensor: `SensorIndex`, one of the first six.
    """
    index = DetectorIndex.CLOCK
    for row in range(len(data.rows)):
        sample = data.rows[row]
        interval_s = sample[SampleColumn.TIME_S] - memory.time_s
        if sample[SampleColumn.SENSOR] != sensor or interval_s <= 0.0:
            continue
        if not math.isnan(interval_s):
            _take_interval(memory, interval_s)
        memory.time_s = sample[SampleColumn.TIME_S]

    judged = memory.count >= _LEARNT and memory.irregular <= _REGULAR
    late_s = abs(memory.late_s) if judged else 0.0
    if late_s > board.statistic[index]:
        board.statistic[index] = late_s
        board.residual[index] = late_s
        if not has_alarm(board, index):
            board.proposed[index, AlarmColumn.FIRST] = sensor
            board.proposed[index, AlarmColumn.SECOND] = late_s


@kernel
def _take_interval(memory: Record, interval_s: float) -> None:
    """Take in the interval between two stamps."""
    if memory.count == 0.0:
        memory.period_s = interval_s
    periods = max(1.0, math.floor(interval_s / memory.period_s + 0.5))
    deviation_s = interval_s - periods * memory.period_s
    is_gap = abs(deviation_s) > _GAP * memory.period_s or periods > 1.0
    memory.irregular += 0.02 * (abs(deviation_s) / memory.period_s - memory.irregular)
    if is_gap:
        return
    memory.count = min(memory.count + 1.0, _FORGETS)
    memory.period_s += deviation_s / memory.count
    memory.late_s += deviation_s if memory.count > _LEARNT else 0.0
    memory.late_s *= math.exp(-interval_s / _AGREED_S)
