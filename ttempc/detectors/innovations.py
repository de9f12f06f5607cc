"""Detector of a sensor whose innovations are too large for the filter; one for each sensor."""

import math
from typing import Final

import numpy as np

from ..layout import InnovationColumn
from .board import Record, TickData
from .history import kernel, remember, sums

_ENTRIES: Final = 102  # of a second: control at 100 Hz

INNOVATIONS: Final = np.dtype([("squares", "f8", (1 + _ENTRIES, 3))])
"""Memory of the detector: history of the sums of a tick's normalised squares, their dimensions."""

_SPAN_S: Final = 1.0  # of the innovations that are summed up
_SAME_TIME_S: Final = 1e-6
# Largest contribution of a sample: a single outlier, which the gate rejects, gives no alarm.
_MOST_SQUARE: Final = 25.0


@kernel
def observe_innovations(
    memory: Record, board: Record, data: TickData, index: int, sensor: int
) -> None:
    """Test whether the innovations of a sensor in a second are as large as the filter expects.

    The sum S of their normalised squares is chi-square with n degrees of freedom for a consistent
    filter, n the entries of all samples. The statistic is its standard normal equivalent (Wilson
    and Hilferty 1931, PNAS 17, 684-688), 0 below the mean,

        ((S / n)^(1/3) - (1 - 2 / (9 n))) / sqrt(2 / (9 n)).

    The limits of 5.0 to 8.3 deviations are by drives without faults, see `table.py`.

    Args:
        memory: record `INNOVATIONS`.
        board: record `BOARD`.
        data: of the tick.
        index: `DetectorIndex`.
        sensor: `SensorIndex`.
    """
    total = 0.0
    entries = 0.0
    for row in range(len(data.innovations)):
        innovation = data.innovations[row]
        square = innovation[InnovationColumn.NORMALISED_SQUARED]
        if int(innovation[InnovationColumn.SENSOR]) == sensor and math.isfinite(square):
            total += min(square, _MOST_SQUARE)
            entries += innovation[InnovationColumn.DIMENSION]
    time_s = data.now if entries else math.nan
    remember(memory.squares, data.now - _SPAN_S + _SAME_TIME_S, time_s, total, entries)

    total, entries = sums(memory.squares)
    board.statistic[index] = 0.0
    board.residual[index] = math.nan
    if entries:
        spread = 2.0 / (9.0 * entries)
        equivalent = ((total / entries) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
        board.statistic[index] = max(0.0, equivalent)
        board.residual[index] = max(0.0, equivalent)
