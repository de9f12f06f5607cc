"""Board of the built-in detectors: statistics, limits, alarms; begin and end of an alarm."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from ..layout import ALARM, AlarmColumn
from ..sensors import SENSOR_COUNT
from ..types import FloatArray
from .history import kernel
from .interface import Reaction
from .table import BUILT_IN, COUNT

Record = Any
"""Record of a compiled call: fields by name, as `ttempc.jit.record` returns it."""

BOARD: Final = np.dtype(
    [
        ("enabled", "f8", COUNT),  # 1: the detector runs
        ("limit", "f8", COUNT),  # above which a statistic begins an alarm
        ("statistic", "f8", COUNT),  # present value, 0 or above
        ("residual", "f8", COUNT),  # latest value of what the statistic is made from, or NaN
        ("proposed", "f8", (COUNT, ALARM)),  # alarm that each detector would give
        ("alarms", "f8", (COUNT, ALARM)),  # that stand, see `ttempc.layout.ALARM`
        ("excluded", "f8", SENSOR_COUNT),  # 1: no sample of the sensor is used
    ]
)
"""Values of all detectors by `DetectorIndex`. Detectors read the alarms of the tick before."""

WARN: Final = float(Reaction.WARN)
NO_ALARM: Final = -1.0
"""Entry of an alarm in place of a reaction."""
ENDS: Final = 0.5
"""Share of its limit below which a statistic ends an alarm."""


class TickData(NamedTuple):
    """Data of a control tick that all detectors share."""

    now: float  # time of the tick [s]
    span_s: float  # since the last estimate that was finite [s]; NaN: there was none
    parameters: FloatArray  # of the vehicle, see `VehicleParameter`
    rows: FloatArray  # samples (n, `SAMPLE`) since the tick before, in the order of arrival
    command: FloatArray  # of the period before (3,), NaN where there was none
    estimate: Record  # `ESTIMATE`
    innovations: FloatArray  # of the samples of this tick (n, `INNOVATION`)


def new_board() -> FloatArray:
    """Return a record `BOARD` of all detectors without an alarm, flat."""
    flat = np.zeros(BOARD.itemsize // 8)
    board = flat.view(BOARD)[0]
    board["enabled"] = 1.0
    board["residual"] = math.nan
    board["alarms"][:, AlarmColumn.REACTION] = NO_ALARM
    for index, row in BUILT_IN.items():
        board["limit"][index] = row.limit
        board["proposed"][index, AlarmColumn.REACTION] = row.reaction
    return flat


@kernel
def has_alarm(board: Record, index: int) -> bool:
    """Return whether there is an alarm of a detector, since the tick before."""
    return board.alarms[index, AlarmColumn.REACTION] >= 0.0


@kernel
def latch_alarms(board: Record) -> None:
    """Begin and end the alarms.

    An alarm begins where a statistic is above its limit, and keeps the numbers of that moment. It
    ends where the statistic is below half of the limit.
    """
    for index in range(COUNT):
        if board.statistic[index] > board.limit[index]:
            if not has_alarm(board, index):
                for column in range(ALARM):
                    board.alarms[index, column] = board.proposed[index, column]
        elif board.statistic[index] < ENDS * board.limit[index]:
            board.alarms[index, AlarmColumn.REACTION] = NO_ALARM
