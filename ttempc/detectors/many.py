"""Detector of many sensors that contradict the estimate at once: noise that nothing explains."""

from typing import Final

import numpy as np

from ..layout import AlarmColumn
from .board import Record, TickData, has_alarm
from .history import kernel
from .table import DetectorIndex

MANY: Final = np.dtype(
    [
        ("count", "f8"),  # sensors with innovations that are too large
        ("mean", "f8"),  # of that number
    ]
)
"""Memory of the detector."""

_MEAN_S: Final = 10.0
_LONGEST_TICK_S: Final = 1.0


@kernel
def observe_many(memory: Record, board: Record, data: TickData) -> None:
    """Average how many sensors contradict the estimate, over ten seconds.

    One that does is reported only, since wrong lengths do that too. Two at a time for long are no
    matter of one sensor: the estimate is worse than it says.

    Args:
        memory: record `MANY`.
        board: record `BOARD`, with the alarms of the tick before.
        data: of the tick.
    """
    index = DetectorIndex.MANY
    if not 0.0 < data.span_s <= _LONGEST_TICK_S:
        return
    count = 0
    for sensor in range(DetectorIndex.INNOVATIONS_GNSS_TRACTOR, DetectorIndex.HITCH):
        count += int(has_alarm(board, sensor))
    memory.count = count
    memory.mean += data.span_s / _MEAN_S * (count - memory.mean)
    board.statistic[index] = memory.mean
    board.residual[index] = memory.mean
    board.proposed[index, AlarmColumn.FIRST] = memory.mean
