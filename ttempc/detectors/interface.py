"""Interface of detectors: what one observes, its statistic, its alarm, the reaction to that."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from ..types import Command, Estimate, Measurement, Sensor
from ..vehicle import Vehicle


class Reaction(IntEnum):
    """Reaction of the supervisor to an alarm, the mildest first."""

    WARN = 0  # the reason is reported, the vehicle drives on
    SLOW = 1  # the vehicle drives on at half speed
    STOP_ON_PATH = 2  # stop, and steer along the path for as long as the vehicle rolls
    STOP = 3  # stop and hold the steering


@dataclass(frozen=True, slots=True)
class Observation:
    """Data of one control tick that a detector may use."""

    time_s: float  # of the tick, from the first one
    samples: Sequence[Measurement]  # that arrived since the tick before, of sensors that work
    command: Command | None  # of the period before; None at the first tick
    estimate: Estimate
    vehicle: Vehicle  # model parameters, those that were learnt included

    def of(self, sensor: Sensor) -> Sequence[Measurement]:
        """Return the samples of one sensor in the order of arrival."""
        return [sample for sample in self.samples if sample.sensor == sensor]


@dataclass(frozen=True, slots=True)
class Alarm:
    """Statement of a detector that something is wrong."""

    detector: str  # name of the detector
    reason: str  # for log and driver
    reaction: Reaction
    unused: frozenset[Sensor] = frozenset()  # sensors whose samples are not to be used


@dataclass
class Detector:
    """A statistic that grows with a fault, and the limit at which it is one."""

    name: str
    limit: float
    statistic: float = 0.0  # present value, 0 or above
    residual: float = math.nan  # latest value of what the statistic is made from

    def observe(self, observation: Observation) -> None:
        """Take in the data of a tick; they are not changed."""
        raise NotImplementedError

    def alarm(self) -> Alarm:
        """Return the alarm for the present statistic."""
        raise NotImplementedError
