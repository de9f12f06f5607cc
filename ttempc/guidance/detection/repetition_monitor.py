"""Repetition monitor: a sensor that sends the same reading again and again."""

from __future__ import annotations

import math
from typing import Final

from ...types import Sensor
from .detector import Alarm, Observation, Reaction
from .limits import REPETITIONS

# A sensor of coarse resolution repeats readings in good health; it is not judged. Assumed.
_LEAST_READINGS: Final = 50
_LARGEST_SHARE: Final = 1 / 500  # of repetitions among the readings of a sensor that is judged


class RepetitionMonitor:
    """Counts the bit-identical readings of one sensor in succession.

    The noise of a sensor that works changes every reading. Its samples are not used while it
    repeats itself; the first other reading ends the alarm. Samples under an old time stamp do not
    count.

    Args:
        what: name of the sensor for the reason.
        sensor: whose readings count.
    """

    limit = REPETITIONS

    def __init__(self, what: str, sensor: Sensor) -> None:
        self.name = f"readings of the {what}"
        self._what, self._sensor = what, sensor
        self._last: tuple[float, tuple[float, ...]] = (-math.inf, ())  # time [s], value
        self._run = 0  # repetitions since the last new value
        self._readings = self._repetitions = 0  # in good health

    @property
    def _judged(self) -> bool:
        return (
            self._readings >= _LEAST_READINGS
            and self._repetitions <= _LARGEST_SHARE * self._readings
        )

    @property
    def statistic(self) -> float:
        """Repetitions in succession, 0 for a sensor that repeats readings in good health."""
        return float(self._run) if self._judged else 0.0

    @property
    def residual(self) -> float:
        """The statistic itself."""
        return self.statistic

    def observe(self, observation: Observation) -> None:
        """Compare every new sample with the one before."""
        for sample in observation.of(self._sensor):
            if sample.time_s <= self._last[0]:
                continue
            if sample.value == self._last[1]:
                self._run += 1
            else:
                if self._run and self.statistic <= self.limit:
                    self._repetitions += self._run
                    self._readings += self._run
                self._readings += 1
                self._run = 0
            self._last = sample.time_s, sample.value

    def alarm(self) -> Alarm:
        """Return the alarm: the vehicle goes on without the sensor."""
        reason = f"{self._what} repeats one reading: not used"
        return Alarm(self.name, reason, Reaction.GO_ON, unused=frozenset({self._sensor}))
