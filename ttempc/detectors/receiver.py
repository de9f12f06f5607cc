"""Detector of what a receiver says of itself; one for each receiver."""

from typing import Final

import numpy as np

from ..layout import AlarmColumn, SampleColumn
from ..sensors import GNSS_OF_BODY, RECEIVER_OF_BODY, ReceiverFlag
from ..types import FloatArray
from .board import Record, TickData, has_alarm
from .history import kernel
from .interface import Reaction
from .table import DetectorIndex

RECEIVER: Final = np.dtype([("status", "f8", 3)])  # `ReceiverStatus.value`, the last one
"""Memory of the detector."""

OLDEST_CORRECTIONS_S: Final = 60.0  # with which an RTK solution is still taken for one; assumed
LARGEST_PROTECTION_M: Final = 1.2  # as of the guidance's own protection level; assumed

_WARN: Final = float(Reaction.WARN)
_SLOW: Final = float(Reaction.SLOW)
_STOP_ON_PATH: Final = float(Reaction.STOP_ON_PATH)
_DEAD_RECKONING: Final = int(ReceiverFlag.DEAD_RECKONING)
_SPOOFED: Final = int(ReceiverFlag.SPOOFED)


def new_receiver() -> FloatArray:
    """Return a record `RECEIVER` of one that has said nothing, flat."""
    return np.zeros(RECEIVER.itemsize // 8)


@kernel
def observe_receiver(memory: Record, board: Record, data: TickData, body: int) -> None:
    """React to the status of the receiver of a body.

    - spoofed: stop, on dead reckoning;
    - dead reckoning: its position is no measurement, and is not used;
    - corrections older than a minute, a protection level above 1.2 m: half speed;
    - jammed, few satellites: reported.

    An alarm ends as soon as the receiver takes its warning back.

    Args:
        memory: record `RECEIVER`.
        board: record `BOARD`.
        data: of the tick.
        body: `Body` that carries the receiver.
    """
    index = DetectorIndex.RECEIVER_TRACTOR + body
    for row in range(len(data.rows)):
        sample = data.rows[row]
        if sample[SampleColumn.SENSOR] == RECEIVER_OF_BODY[body]:
            for entry in range(len(memory.status)):
                memory.status[entry] = sample[SampleColumn.FIRST + entry]

    flags = int(memory.status[0]) if memory.status[0] >= 0.0 else 0
    reaction = _WARN
    old = memory.status[1] > OLDEST_CORRECTIONS_S
    uncertain = memory.status[2] > LARGEST_PROTECTION_M
    if flags & _SPOOFED:
        reaction = _STOP_ON_PATH
    elif old or uncertain:
        reaction = _SLOW
    warns = flags != 0 or old or uncertain
    board.statistic[index] = 1.0 if warns else 0.0
    board.residual[index] = board.statistic[index]

    row_of_alarm = board.alarms[index] if has_alarm(board, index) else board.proposed[index]
    row_of_alarm[AlarmColumn.REACTION] = reaction
    row_of_alarm[AlarmColumn.FIRST] = flags
    row_of_alarm[AlarmColumn.SECOND] = memory.status[1]
    row_of_alarm[AlarmColumn.THIRD] = memory.status[2]
    if flags & _DEAD_RECKONING:
        board.excluded[GNSS_OF_BODY[body]] = 1.0
