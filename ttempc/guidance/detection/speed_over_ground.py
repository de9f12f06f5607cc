"""Speed over ground of a vehicle from the positions of its GNSS receivers."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...jit import cached_njit
from ...types import FloatArray, Measurement, Sensor

SPAN_S: Final = 1.0
"""Time over which speeds are compared [s]."""

_LEAST_S: Final = 0.6  # between the first and the last position of a span
_FASTEST_MPS: Final = 5.0  # of a vehicle; assumed
_LARGEST_ERROR_M: Final = 0.5  # of a position that is no outlier; assumed
_RECEIVERS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
# Of second differences of positions, from which their noise is estimated.
_LEAST_DIFFERENCES: Final = 20
_MOST_DIFFERENCES: Final = 200  # 20 s of both axes at 5 Hz
_MEDIAN_TO_SD: Final = 1.4826 / math.sqrt(6.0)  # x(k+1) - 2 x(k) + x(k-1) of white noise


@dataclass(frozen=True, slots=True)
class GroundSpeed:
    """Speed over a span of time."""

    mps: float
    begin_s: float
    end_s: float
    sd_mps: float  # by the scatter of the positions of the last 20 s; 0 before there are enough


class SpeedOverGround:
    """Slope of the positions of a second over time, by Theil and Sen (Sen 1968, JASA 63).

    Each axis has the median of the slopes between all pairs of positions, which a single outlier
    does not move. A position farther from the last one than a vehicle goes is left out, for a
    second at most. The result is the mean of the receivers that have sent enough positions, without
    a sign; positions of a time before the last one are left out.
    """

    def __init__(self) -> None:
        self._positions = {sensor: deque[tuple[float, float, float]]() for sensor in _RECEIVERS}
        self._differences = deque[float]()  # second ones, unsigned [m]
        self._ordered: list[float] = []  # the same by size
        self._seen: Sequence[Measurement] | None = None  # samples of the last call
        self._last: GroundSpeed | None = None  # its result

    def warm_up(self) -> None:
        """Compile the median of slopes; nothing else changes."""
        median_slopes(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))

    def speed(self, samples: Sequence[Measurement]) -> GroundSpeed | None:
        """Take in samples; return the speed of the span that ends with the newest.

        None where no receiver has sent positions over 0.6 s, or none of them is new. Several
        monitors may ask with the same samples.
        """
        if samples is not self._seen:
            self._seen, self._last = samples, self._speed(samples)
        return self._last

    def _speed(self, samples: Sequence[Measurement]) -> GroundSpeed | None:
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
                if len(kept) > 2:
                    (_, x0, y0), (_, x1, y1), (_, x2, y2) = kept[-3], kept[-2], kept[-1]
                    self._add_difference(abs(x2 - 2.0 * x1 + x0))
                    self._add_difference(abs(y2 - 2.0 * y1 + y0))
        newest = max((kept[-1][0] for kept in self._positions.values() if kept), default=0.0)
        spans = [
            kept
            for kept in self._positions.values()
            if kept and kept[-1][0] - kept[0][0] >= _LEAST_S and kept[-1][0] > newest - _LEAST_S
        ]
        if not new or not spans:
            return None
        speeds = [math.hypot(*median_slopes(np.array(kept))) for kept in spans]
        begin_s, end_s = min(kept[0][0] for kept in spans), max(kept[-1][0] for kept in spans)
        return GroundSpeed(sum(speeds) / len(speeds), begin_s, end_s, self._sd_mps(spans))

    def _add_difference(self, difference: float) -> None:
        self._differences.append(difference)
        insort(self._ordered, difference)
        if len(self._ordered) > _MOST_DIFFERENCES:
            del self._ordered[bisect_left(self._ordered, self._differences.popleft())]

    def _sd_mps(self, spans: Sequence[Sequence[tuple[float, float, float]]]) -> float:
        """Return the standard deviation of a speed by least squares, for white noise [m/s]."""
        count = len(self._ordered)
        if count < _LEAST_DIFFERENCES:
            return 0.0
        middle = self._ordered[(count - 1) // 2] + self._ordered[count // 2]
        inverse = 0.0  # of the squares of the times about their mean
        for kept in spans:
            times = [time_s for time_s, _, _ in kept]
            mean = sum(times) / len(times)
            inverse += 1.0 / sum([(time_s - mean) ** 2 for time_s in times])
        return _MEDIAN_TO_SD * 0.5 * middle * math.sqrt(inverse) / len(spans)


def _is_plausible(last: tuple[float, float, float], sample: Measurement) -> bool:
    """Whether a vehicle may have gone from the last position to that of a later sample."""
    span_s = sample.time_s - last[0]
    way = math.hypot(sample.value[0] - last[1], sample.value[1] - last[2])
    return span_s > 0.0 and way <= _FASTEST_MPS * span_s + _LARGEST_ERROR_M


@cached_njit()
def median_slopes(positions: FloatArray) -> tuple[float, float]:
    """Return the medians of the slopes of x and y between all pairs of rows t, x, y (n, 3)."""
    count = len(positions)
    slopes = np.empty((2, count * (count - 1) // 2))
    pair = 0
    for later in range(count):
        for earlier in range(later):
            span_s = positions[later, 0] - positions[earlier, 0]
            for axis in range(2):
                way = positions[later, 1 + axis] - positions[earlier, 1 + axis]
                slopes[axis, pair] = way / span_s
            pair += 1
    slopes[0].sort()
    slopes[1].sort()
    lower, upper = (pair - 1) // 2, pair // 2
    if lower == upper:
        return slopes[0, lower], slopes[1, lower]
    return (
        (slopes[0, lower] + slopes[0, upper]) / 2.0,
        (slopes[1, lower] + slopes[1, upper]) / 2.0,
    )
