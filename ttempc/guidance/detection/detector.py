"""Detector of a fault: a statistic of the observations, a limit, and the reaction to an alarm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Final, Protocol

from ...types import Command, Estimate, Measurement, Sensor
from ...vehicle import Vehicle

_ENDS: Final = 0.5  # share of its limit below which a statistic ends an alarm
_MOST: Final = 1.5  # limits at which a sum saturates, so that an alarm ends soon after its cause


class Reaction(IntEnum):
    """Reaction of the supervisor to an alarm, the mildest first."""

    GO_ON = 0  # degraded: the reason is reported
    SLOW = 1  # half speed
    STOP_ON_PATH = 2  # stop, and steer along the path for as long as the vehicle rolls
    STOP = 3  # stop and hold the steering


@dataclass(frozen=True, slots=True)
class Observation:
    """Data of one control tick that a detector may use."""

    time_s: float  # of the tick, from the first one
    samples: Sequence[Measurement]  # that arrived since the tick before, of sensors that work
    command: Command | None  # of the period before; None at the first tick
    estimate: Estimate
    vehicle: Vehicle  # present model parameters
    _of_sensor: dict[Sensor, list[Measurement]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        for sample in self.samples:
            self._of_sensor.setdefault(sample.sensor, []).append(sample)

    def of(self, sensor: Sensor) -> Sequence[Measurement]:
        """Return the samples of one sensor in the order of arrival."""
        return self._of_sensor.get(sensor, ())


@dataclass(frozen=True, slots=True)
class Alarm:
    """A detector's statement that something is wrong."""

    detector: str  # its name
    reason: str  # for log and driver
    reaction: Reaction
    unused: frozenset[Sensor] = frozenset()  # sensors whose samples are not to be used


class Detector(Protocol):
    """A statistic that grows with a fault, and the limit at which it is one.

    The limits follow from drives without faults, see `ttempc.guidance.detection.limits`.
    """

    name: str
    limit: float

    @property
    def statistic(self) -> float:
        """Present value, 0 or above."""
        ...

    @property
    def residual(self) -> float:
        """Latest value of what the statistic is made from; NaN before the first."""
        ...

    def observe(self, observation: Observation) -> None:
        """Take in the data of a tick; they are not changed."""
        ...

    def alarm(self) -> Alarm:
        """Return the alarm for the present statistic."""
        ...


class Cusum:
    """Cumulative sums of a residual to both sides (Page 1954, Biometrika 41).

        g+ = max(0, g+ + r - k),   g- = max(0, g- - r - k)

    They grow where the mean residual is above the allowance k, half of the shift to be detected.

    Args:
        allowance: k, in the unit of the residual.
        limit: of the sums; they saturate at 1.5 times the limit.
    """

    def __init__(self, allowance: float, limit: float) -> None:
        self._allowance, self._most = allowance, _MOST * limit
        self.above = self.below = 0.0  # g+, g-
        self.residual = math.nan  # of the last tick

    def add(self, residual: float) -> None:
        """Take in the residual of a tick."""
        self.residual = residual
        self.above = min(max(0.0, self.above + residual - self._allowance), self._most)
        self.below = min(max(0.0, self.below - residual - self._allowance), self._most)

    @property
    def largest(self) -> float:
        """The larger sum."""
        return max(self.above, self.below)


class Monitors:
    """Runs detectors and keeps their alarms until the causes end.

    An alarm begins where a statistic exceeds its limit and ends where it falls below half of it.
    A detector does not see the samples that are not to be used by an alarm of one before it.
    """

    def __init__(self, detectors: Sequence[Detector]) -> None:
        self.detectors = tuple(detectors)
        self._active: dict[str, Alarm] = {}  # by detector

    def observe(self, observation: Observation) -> tuple[Alarm, ...]:
        """Return the alarms that stand after the data of a tick."""
        for detector in self.detectors:
            detector.observe(observation)
            statistic = detector.statistic
            if statistic > detector.limit:
                self._active.setdefault(detector.name, detector.alarm())
            elif not self._active:
                continue
            elif statistic < _ENDS * detector.limit:
                self._active.pop(detector.name, None)
            alarm = self._active.get(detector.name)
            if alarm is not None and alarm.unused:
                samples = _without(observation.samples, alarm.unused)
                observation = replace(observation, samples=samples)
        return tuple(self._active.values())

    def usable(self, samples: Sequence[Measurement]) -> Sequence[Measurement]:
        """Return the samples without those of sensors that an alarm rules out."""
        for alarm in self._active.values():
            if alarm.unused:
                samples = _without(samples, alarm.unused)
        return samples


def _without(samples: Sequence[Measurement], unused: frozenset[Sensor]) -> list[Measurement]:
    return [sample for sample in samples if sample.sensor not in unused]
