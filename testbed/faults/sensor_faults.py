"""Faults of sensors: between the samples that a sensor takes and those that the estimator gets."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import Measurement, Sensor

from ..configuration.config_io import STRICT, Fraction, Positive
from ..sensing.sensor_errors import Correlated
from ..sensing.sensor_specification import SensorSpecification
from .fault import FaultContext, LastingFault, Window

SampleFilter = Callable[[Measurement], Sequence[tuple[float, Measurement]]]
"""Turns a sample into the samples that arrive in its place, each with its further delay [s]."""

_RECEIVERS: Final = {
    "both": (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER),
    "tractor": (Sensor.GNSS_TRACTOR,),
    "trailer": (Sensor.GNSS_TRAILER,),
}
_ANGLES: Final = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
_GROUPS: Final = {
    "gnss": _RECEIVERS["both"],
    "angles": _ANGLES,
    "encoder": (Sensor.ENCODER,),
    "all": (*_RECEIVERS["both"], *_ANGLES, Sensor.ENCODER),
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
class _GnssFault(SensorFault):
    receiver: Literal["both", "tractor", "trailer"] = "both"
    """Receiver that is concerned."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The receivers."""
        return _RECEIVERS[self.receiver]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssLoss(_GnssFault):
    """`gnss_out`: no samples. `gnss_frozen`: the first position is repeated under new stamps."""

    kind: Literal["gnss_out", "gnss_frozen"] = "gnss_out"

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        return (lambda sample: ()) if self.kind == "gnss_out" else _frozen()


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GnssJump(_GnssFault):
    """All positions are off by a constant vector."""

    kind: Literal["gnss_jump"] = "gnss_jump"
    offset_m: Positive
    """Length of the offset."""
    direction_deg: float = 0.0
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
    rate_mps: Positive
    """Rate at which the offset grows."""
    direction_deg: float = 0.0
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

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """Both receivers."""
        return _RECEIVERS["both"]

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one receiver."""
        tractor, trailer = self.sensors
        other = {tractor: trailer, trailer: tractor}
        return lambda sample: [(0.0, replace(sample, sensor=other[sample.sensor]))]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _AngleFault(SensorFault):
    sensor: Literal["steering_tractor", "steering_trailer", "hitch"]
    """Sensor that is concerned."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensor."""
        return (Sensor(self.sensor),)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleStuck(_AngleFault):
    """An angle sensor repeats its first reading."""

    kind: Literal["angle_stuck"] = "angle_stuck"

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of the sensor."""
        return _frozen()


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AngleBias(_AngleFault):
    """An angle sensor reads too much by a constant."""

    kind: Literal["angle_bias"] = "angle_bias"
    bias_deg: float
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
    rate_degps: float
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
    body: Literal["tractor", "trailer"]
    """Body on which the IMU is."""
    bias_degps: float
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
    factor: float
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
    group: Literal["all", "gnss", "angles", "encoder"] = "all"
    """Sensors that are concerned."""

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors of the group."""
        return _GROUPS[self.group]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SamplesDuplicated(_StampFault):
    """`samples_duplicated`: each sample arrives twice. `stamps_backward`: stamps run backward."""

    kind: Literal["samples_duplicated", "stamps_backward"] = "samples_duplicated"

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
    offset_s: float = Field(json_schema_extra={"not": {"const": 0}})
    """What is added to a stamp, not 0."""

    def filter(
        self, window: Window, specification: SensorSpecification, rng: np.random.Generator
    ) -> SampleFilter:
        """Return the filter of one sensor."""
        return _stamped(lambda time_s: time_s + self.offset_s)

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        return super().refusal(window, context) if self.offset_s else "offset_s is 0"


def _vector(length: float, direction_deg: float) -> tuple[float, float]:
    direction = math.radians(direction_deg)
    return length * math.cos(direction), length * math.sin(direction)


def _frozen() -> SampleFilter:
    """Return the filter that repeats the value of its first sample."""
    first: list[tuple[float, ...]] = []

    def apply(sample: Measurement) -> Sequence[tuple[float, Measurement]]:
        if not first:
            first.append(sample.value)
        return [(0.0, replace(sample, value=first[0]))]

    return apply


def _shifted(offset: Callable[[float], tuple[float, float]]) -> SampleFilter:
    """Return the filter that adds an offset of the sampling time [s] to positions [m]."""

    def apply(sample: Measurement) -> Sequence[tuple[float, Measurement]]:
        east, north = offset(sample.time_s)
        x, y = sample.value
        return [(0.0, replace(sample, value=(x + east, y + north)))]

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
