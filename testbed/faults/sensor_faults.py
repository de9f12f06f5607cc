"""Faults of sensors: between the samples that a sensor takes and those that the estimator gets."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import Measurement, Sensor

from ..configuration.config_io import STRICT, BearingDeg, Positive, Signed
from ..sensing.sensor_specification import SensorSpecification
from .fault import FaultContext, LastingFault, Window

SampleFilter = Callable[[Measurement], Sequence[tuple[float, Measurement]]]
"""Turns a sample into the samples that arrive in its place, each with its further delay [s]."""

GNSS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
_ANGLES: Final = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
_GROUPS: Final = {
    "gnss": GNSS,
    "angles": _ANGLES,
    "encoder": (Sensor.ENCODER,),
    "all": (*GNSS, *_ANGLES, Sensor.ENCODER),
}
_RATE: Final = {"gnss": "gnss_rate_hz", "encoder": "encoder_rate_hz"}  # of others: angle_rate_hz


def sample_period_s(specification: SensorSpecification, sensor: Sensor) -> float:
    """Return the time from sample to sample of a sensor [s]."""
    if sensor.startswith("imu"):
        return 1.0 / specification.imu.rate_hz
    return 1.0 / getattr(specification, _RATE.get(sensor.split("_")[0], "angle_rate_hz"))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SensorFault(LastingFault):
    """A fault of the samples that are taken while it lasts."""

    @property
    @abstractmethod
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors that are concerned."""

    @abstractmethod
    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the samples of one of the sensors.

        Args:
            window: when the fault acts.
            specification: of the sensors.
            rng: of this fault and sensor alone.
        """

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act: nobody reads the samples, or there is none."""
        if context.true_state:
            return "no sample is read, since controller.estimator is the truth"
        for sensor in self.sensors:
            if not window.holds_multiple(sample_period_s(context.sensors, sensor)):
                return f"no sample of {sensor} is taken while it lasts"
        return ""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _AngleFault(SensorFault):
    sensor: Annotated[
        Literal["steering_tractor", "steering_trailer", "hitch"],
        Field(description="Sensor that is concerned."),
    ]

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensor."""
        return (Sensor(self.sensor),)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleStuck(_AngleFault):
    """An angle sensor repeats its first reading."""

    kind: Literal["angle_stuck"] = "angle_stuck"
    """Kind of fault."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the sensor."""
        return frozen()


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleBias(_AngleFault):
    """An angle sensor reads too much by a constant."""

    kind: Literal["angle_bias"] = "angle_bias"
    """Kind of fault."""
    bias_deg: BearingDeg
    """What is added to a reading."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the sensor."""
        return _first_shifted(lambda time_s: math.radians(self.bias_deg))

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        return super().refusal(window, context) if self.bias_deg else "bias_deg is 0"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleDrift(_AngleFault):
    """The error of an angle sensor grows at a constant rate."""

    kind: Literal["angle_drift"] = "angle_drift"
    """Kind of fault."""
    rate_degps: Signed
    """Rate at which the error grows."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the sensor."""
        rate = math.radians(self.rate_degps)
        return _first_shifted(lambda time_s: rate * (time_s - window.start_s))

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        return super().refusal(window, context) if self.rate_degps else "rate_degps is 0"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleNoise(_AngleFault):
    """White noise is added to an angle sensor."""

    kind: Literal["angle_noise"] = "angle_noise"
    """Kind of fault."""
    sd_deg: Positive
    """Standard deviation of the added error."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the sensor."""
        sd = math.radians(self.sd_deg)
        return _first_shifted(lambda time_s: sd * float(rng.standard_normal()))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GyroBias(SensorFault):
    """The yaw rate of an IMU is too large by a constant."""

    kind: Literal["gyro_bias"] = "gyro_bias"
    """Kind of fault."""
    body: Literal["tractor", "trailer"]
    """Body on which the IMU is."""
    bias_degps: Signed
    """What is added to a yaw rate."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The IMU."""
        return (Sensor(f"imu_{self.body}"),)

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the IMU."""
        return _first_shifted(lambda time_s: math.radians(self.bias_degps))

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        if not context.sensors.imu.on:
            return "there is no IMU, sensors.imu.on is false"
        return super().refusal(window, context) if self.bias_degps else "bias_degps is 0"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class EncoderDead(SensorFault):
    """The speed encoder reads 0."""

    kind: Literal["encoder_dead"] = "encoder_dead"
    """Kind of fault."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The encoder."""
        return (Sensor.ENCODER,)

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the encoder."""
        return lambda sample: [(0.0, replace(sample, value=(0.0,)))]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class EncoderScaled(SensorFault):
    """The speed encoder reads a multiple of the speed: 2 doubled, -1 reversed."""

    kind: Literal["encoder_scaled"] = "encoder_scaled"
    """Kind of fault."""
    factor: Signed
    """Factor on a reading, not 1."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The encoder."""
        return (Sensor.ENCODER,)

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the encoder."""
        return lambda sample: [(0.0, replace(sample, value=(self.factor * sample.value[0],)))]

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        return "factor is 1" if self.factor == 1.0 else super().refusal(window, context)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _StampFault(SensorFault):
    group: Annotated[
        Literal["all", "gnss", "angles", "encoder"],
        Field(description="Sensors that are concerned."),
    ] = "all"

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors of the group."""
        return _GROUPS[self.group]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SamplesDuplicated(_StampFault):
    """`samples_duplicated`: each sample arrives twice. `stamps_backward`: stamps run backward."""

    kind: Literal["samples_duplicated", "stamps_backward"] = "samples_duplicated"
    """Kind of fault."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one sensor."""
        if self.kind == "samples_duplicated":
            return lambda sample: [(0.0, sample), (0.0, sample)]
        return _stamped(lambda time_s: 2.0 * window.start_s - time_s)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class StampsShifted(_StampFault):
    """Time stamps are wrong by a constant: negative ones are too old."""

    kind: Literal["stamps_shifted"] = "stamps_shifted"
    """Kind of fault."""
    offset_s: Signed
    """What is added to a stamp, not 0."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one sensor."""
        return _stamped(lambda time_s: time_s + self.offset_s)

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        return super().refusal(window, context) if self.offset_s else "offset_s is 0"


def frozen() -> SampleFilter:
    """Return the filter that repeats the value of its first sample."""
    first: list[tuple[float, ...]] = []

    def apply(sample: Measurement) -> Sequence[tuple[float, Measurement]]:
        if not first:
            first.append(sample.value)
        return [(0.0, replace(sample, value=first[0]))]

    return apply


def _first_shifted(offset: Callable[[float], float]) -> SampleFilter:
    """Return the filter that adds an offset of the sampling time to the first component."""

    def apply(sample: Measurement) -> Sequence[tuple[float, Measurement]]:
        first, *others = sample.value
        return [(0.0, replace(sample, value=(first + offset(sample.time_s), *others)))]

    return apply


def _stamped(stamp: Callable[[float], float]) -> SampleFilter:
    """Return the filter that replaces the sampling time [s] by a function of it."""
    return lambda sample: [(0.0, replace(sample, time_s=stamp(sample.time_s)))]
