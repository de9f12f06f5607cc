"""Speed over ground of a vehicle from the positions of its GNSS receivers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import combinations
from statistics import median
from typing import Final

from ...types import Measurement, Sensor

SPAN_S: Final = 1.0
"""Time over which speeds are compared [s]."""

_LEAST_S: Final = 0.6  # between the first and the last position of a span
_FASTEST_MPS: Final = 5.0  # of a vehicle; assumed
_LARGEST_ERROR_M: Final = 0.5  # of a position that is no outlier; assumed
_RECEIVERS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)


class SpeedOverGround:
    """Slope of the positions of a second over time, by Theil and Sen (Sen 1968, JASA 63).

    Each axis has the median of the slopes between all pairs of positions, which a single outlier
    does not move. A position farther from the last one than a vehicle goes is left out, for a
    second at most. The result is the mean of the receivers that have sent enough positions, without
    a sign; positions of a time before the last one are left out.
    """

    def __init__(self) -> None:
        self._positions = {sensor: deque[tuple[float, float, float]]() for sensor in _RECEIVERS}

    def speed(self, samples: Sequence[Measurement]) -> tuple[float, float, float] | None:
        """Take in samples; return the speed [m/s] and begin and end of its span [s].

        None where no receiver has sent positions over 0.6 s, or none of them is new.
        """
        new = False
        for sample in samples:
            kept = self._positions.get(sample.sensor)
            if kept is None or not all(map(math.isfinite, sample.value)):
                continue
            while kept and kept[0][0] < sample.time_s - SPAN_S - 1e-6:
                kept.popleft()
            if not kept or _is_plausible(kept[-1], sample):
                new = True
                kept.append((sample.time_s, sample.value[0], sample.value[1]))
        newest = max((kept[-1][0] for kept in self._positions.values() if kept), default=0.0)
        spans = [
            kept
            for kept in self._positions.values()
            if kept and kept[-1][0] - kept[0][0] >= _LEAST_S and kept[-1][0] > newest - _LEAST_S
        ]
        if not new or not spans:
            return None
        speeds = [math.hypot(_slope(kept, 1), _slope(kept, 2)) for kept in spans]
        begin_s, end_s = min(kept[0][0] for kept in spans), max(kept[-1][0] for kept in spans)
        return sum(speeds) / len(speeds), begin_s, end_s


def _is_plausible(last: tuple[float, float, float], sample: Measurement) -> bool:
    """Whether a vehicle may have gone from the last position to that of a later sample."""
    span_s = sample.time_s - last[0]
    way = math.hypot(sample.value[0] - last[1], sample.value[1] - last[2])
    return span_s > 0.0 and way <= _FASTEST_MPS * span_s + _LARGEST_ERROR_M


def _slope(positions: Iterable[tuple[float, float, float]], axis: int) -> float:
    """Return the median slope [m/s] of an axis between all pairs of positions."""
    return median((b[axis] - a[axis]) / (b[0] - a[0]) for a, b in combinations(positions, 2))
