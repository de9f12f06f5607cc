"""Speed over ground of a vehicle from the positions of its GNSS receivers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from ...types import Measurement, Sensor

SPAN_S: Final = 1.0
"""Time over which speeds are compared [s]: with 0.03 m a position, 0.03 m/s of two receivers."""

_LEAST_S: Final = 0.6  # between the first and the last position of a span
_RECEIVERS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)


class SpeedOverGround:
    """Distance between the first and the last position of a second, over their time.

    The mean of the receivers that have sent enough positions; positions of a time before the last
    one are left out. It has no sign, and is never below the error of a position over the time.
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
            if not kept or sample.time_s > kept[-1][0]:
                new = True
                kept.append((sample.time_s, sample.value[0], sample.value[1]))
                while kept[0][0] < sample.time_s - SPAN_S - 1e-6:
                    kept.popleft()
        newest = max((kept[-1][0] for kept in self._positions.values() if kept), default=0.0)
        spans = [
            (kept[0], kept[-1])
            for kept in self._positions.values()
            if kept and kept[-1][0] - kept[0][0] >= _LEAST_S and kept[-1][0] > newest - _LEAST_S
        ]
        if not new or not spans:
            return None
        speeds = [math.hypot(b[1] - a[1], b[2] - a[2]) / (b[0] - a[0]) for a, b in spans]
        return sum(speeds) / len(speeds), min(a[0] for a, _ in spans), max(b[0] for _, b in spans)
