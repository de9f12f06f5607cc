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
        self._terms: deque[tuple[float, float, int]] = deque()  # time [s], square, entries

    @property
    def statistic(self) -> float:
        """Standard normal equivalent of the sum, 0 where it is below its mean."""
        n = sum(entries for _, _, entries in self._terms)
        if n == 0:
            return 0.0
        total = sum(square for _, square, _ in self._terms)
        spread = 2.0 / (9.0 * n)
        return max(0.0, ((total / n) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread))

    @property
    def residual(self) -> float:
        """The statistic itself; NaN without a sample."""
        return self.statistic if self._terms else math.nan

    def observe(self, observation: Observation) -> None:
        """Take in the innovations of a tick; a refused sample, of a false time say, has none."""
        now = observation.time_s
        self._terms.extend(
            (now, min(item.normalised_squared, _MOST), item.dimension)
            for item in observation.estimate.innovations
            if item.sensor is self._sensor and math.isfinite(item.normalised_squared)
        )
        while self._terms and self._terms[0][0] < now - _SPAN_S + 1e-6:
            self._terms.popleft()

    def alarm(self) -> Alarm:
        """Return the alarm."""
        reason = f"{self._what} contradicts the estimate"
        return Alarm(self.name, reason, Reaction.GO_ON)
