"""Innovation monitor: normalised squares of a sensor's innovations over a second."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from ...types import Sensor
from .detector import Alarm, Observation, Reaction
from .limits import INNOVATION

_SPAN_S: Final = 1.0
# Largest contribution of a sample: a single outlier, which the gate rejects, gives no alarm.
_MOST: Final = 25.0


class InnovationMonitor:
    """Sums up the normalised squared innovations of one sensor over a second.

    For a consistent filter the sum is chi-square with n degrees of freedom, the entries of all
    samples. The statistic is its standard normal equivalent (Wilson and Hilferty 1931):

        ((S / n)^(1/3) - (1 - 2 / (9 n))) / sqrt(2 / (9 n)).

    Args:
        what: name of the sensor for the reason.
        sensor: whose innovations count.
    """

    def __init__(self, what: str, sensor: Sensor) -> None:
        self.name = f"innovations of the {what}"
        self.limit = INNOVATION[sensor]
        self._sensor, self._what = sensor, what
        self._ticks: deque[tuple[float, float, int]] = deque()  # time [s], sum of squares, entries
        self._statistic = 0.0

    @property
    def statistic(self) -> float:
        """Standard normal equivalent of the sum, 0 where it is below its mean."""
        return self._statistic

    @property
    def residual(self) -> float:
        """The statistic itself; NaN without a sample."""
        return self._statistic if self._ticks else math.nan

    def observe(self, observation: Observation) -> None:
        """Take in the innovations of a tick; a refused sample, of a false time say, has none."""
        now, sensor, total, n = observation.time_s, self._sensor, 0.0, 0
        for item in observation.estimate.innovations:
            if item.sensor is sensor and math.isfinite(item.normalised_squared):
                total += min(item.normalised_squared, _MOST)
                n += item.dimension
        if n:
            self._ticks.append((now, total, n))
        while self._ticks and self._ticks[0][0] < now - _SPAN_S + 1e-6:
            self._ticks.popleft()
        self._statistic = 0.0
        if self._ticks:
            n = sum([entries for _, _, entries in self._ticks])
            mean, spread = sum([square for _, square, _ in self._ticks]) / n, 2.0 / (9.0 * n)
            equivalent = (mean ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
            self._statistic = max(0.0, equivalent)

    def alarm(self) -> Alarm:
        """Return the alarm."""
        reason = f"{self._what} contradicts the estimate"
        return Alarm(self.name, reason, Reaction.GO_ON)
