"""Faults of GNSS receivers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import Measurement, Sensor

from ..configuration.config_io import STRICT, BearingDeg, Fraction, Positive
from ..sensing.sensor_errors import Correlated
from ..sensing.sensor_specification import SensorSpecification
from .fault import FaultContext, Window
from .sensor_faults import GNSS, SampleFilter, SensorFault, frozen

_RECEIVERS: Final = {"both": GNSS, "tractor": GNSS[:1], "trailer": GNSS[1:]}


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _GnssFault(SensorFault):
    receiver: Annotated[
        Literal["both", "tractor", "trailer"], Field(description="Receiver that is concerned.")
    ] = "both"

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The receivers."""
        return _RECEIVERS[self.receiver]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssLoss(_GnssFault):
    """`gnss_out`: no samples. `gnss_frozen`: the first position is repeated under new stamps."""

    kind: Literal["gnss_out", "gnss_frozen"] = "gnss_out"
    """Kind of fault."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        return (lambda sample: ()) if self.kind == "gnss_out" else frozen()


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssJump(_GnssFault):
    """All positions are off by a constant vector."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    """Kind of fault."""
    offset_m: Positive
    """Length of the offset."""
    direction_deg: BearingDeg = 0.0
    """Direction of the offset, counter-clockwise from east."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        return _shifted(lambda time_s: _vector(self.offset_m, self.direction_deg))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssDrift(_GnssFault):
    """An offset of the positions grows at a constant rate."""

    kind: Literal["gnss_drift"] = "gnss_drift"
    """Kind of fault."""
    rate_mps: Positive
    """Rate at which the offset grows."""
    direction_deg: BearingDeg = 0.0
    """Direction of the offset, counter-clockwise from east."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""

        def offset(time_s: float) -> tuple[float, float]:
            return _vector(self.rate_mps * (time_s - window.start_s), self.direction_deg)

        return _shifted(offset)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssOutlier(_GnssFault):
    """Single positions are off by a vector of constant length and random direction."""

    kind: Literal["gnss_outlier"] = "gnss_outlier"
    """Kind of fault."""
    offset_m: Positive
    """Length of the offset."""
    share: Fraction = 1.0
    """Share of the samples that are outliers, drawn one by one."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""

        def offset(time_s: float) -> tuple[float, float]:
            hit, direction = rng.random() < self.share, rng.uniform(0.0, 360.0)
            return _vector(self.offset_m * hit, direction)

        return _shifted(offset)

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        if not self.share:
            return "share is 0, must be above 0"
        return super().refusal(window, context)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssFloat(_GnssFault):
    """The receivers lose the fixed ambiguities: a correlated error is added."""

    kind: Literal["gnss_float"] = "gnss_float"
    """Kind of fault."""
    sd_m: Positive = 0.5
    """Standard deviation of the added error of an axis; assumed."""
    correlation_time_s: Positive = 20.0
    """Correlation time of that error; assumed."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        period_s = 1.0 / specification.gnss_rate_hz
        sd = np.full(2, self.sd_m)
        error = Correlated(sd, 0.0, self.correlation_time_s, period_s, rng, rng)

        def offset(time_s: float) -> tuple[float, float]:
            x, y = error.draw()
            return x, y

        return _shifted(offset)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssLate(_GnssFault):
    """Samples arrive later than the scenario's latency has it; their stamps are right."""

    kind: Literal["gnss_late"] = "gnss_late"
    """Kind of fault."""
    delay_s: Positive
    """Further time from sampling to delivery."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        return lambda sample: [(self.delay_s, sample)]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AntennasSwapped(SensorFault):
    """Each receiver's samples come under the name of the other one."""

    kind: Literal["antennas_swapped"] = "antennas_swapped"
    """Kind of fault."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """Both receivers."""
        return GNSS

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        tractor, trailer = self.sensors
        other = {tractor: trailer, trailer: tractor}
        return lambda sample: [(0.0, replace(sample, sensor=other[sample.sensor]))]


def _vector(length: float, direction_deg: float) -> tuple[float, float]:
    direction = math.radians(direction_deg)
    return length * math.cos(direction), length * math.sin(direction)


def _shifted(offset: Callable[[float], tuple[float, float]]) -> SampleFilter:
    """Return the filter that adds an offset of the sampling time [s] to positions [m]."""

    def apply(sample: Measurement) -> Sequence[tuple[float, Measurement]]:
        east, north = offset(sample.time_s)
        x, y = sample.value
        return [(0.0, replace(sample, value=(x + east, y + north)))]

    return apply
