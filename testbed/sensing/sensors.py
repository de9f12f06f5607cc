"""Sensors of the vehicle: readings of the truth with errors, rates and latencies.

GNSS samples are taken at the axle point, as the paper's model takes them ("point"), or at the
antenna above it, which a rolling or pitching vehicle moves. "raw" samples are the position of the
antenna. "corrected" samples are that position less the lever arm, turned by the roll and pitch of
the newest sample of that body's IMU. The heading for that turn is the true one: an error of the
heading would move the corrected point by height x sin(roll) x error, 3 mm at 0.1 rad and 1 deg.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import add
from typing import Final

import numpy as np

from ttempc.types import FloatArray, Measurement, Sensor

from ..discretisation import delay_steps, quantised, whole_steps
from ..randomness import generator
from ..truth import Pose, Truth
from .sensor_errors import Correlated, ErrorSource, HeavyTailed, White
from .sensor_specification import GnssAntenna, ImuSpecification, SensorSpecification

_Read = Callable[[Truth], tuple[float, ...]]

_POSITION: Final = ("x_m", "y_m")
_ATTITUDE: Final = ("yaw_rate_radps", "roll_rad", "pitch_rad")

COMPONENTS: Final[dict[Sensor, tuple[str, ...]]] = {
    Sensor.GNSS_TRACTOR: _POSITION,
    Sensor.GNSS_TRAILER: _POSITION,
    Sensor.STEERING_TRACTOR: ("rad",),
    Sensor.STEERING_TRAILER: ("rad",),
    Sensor.HITCH: ("rad",),
    Sensor.ENCODER: ("mps",),
    Sensor.IMU_TRACTOR: _ATTITUDE,
    Sensor.IMU_TRAILER: _ATTITUDE,
}
"""Components of a sample of each sensor with their units, in the order of `Measurement.value`.

The log derives its columns from this table: their names, their number and their order.
"""

_GNSS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)  # in the order of `Truth.antennas`
_ANGLES: Final[tuple[tuple[Sensor, _Read], ...]] = (
    (Sensor.STEERING_TRACTOR, lambda truth: (truth.delta_t,)),
    (Sensor.STEERING_TRAILER, lambda truth: (truth.delta_i,)),
    (Sensor.HITCH, lambda truth: (truth.beta,)),
)
_ENCODER: Final[dict[str, tuple[Sensor, _Read]]] = {
    "wheel": (Sensor.ENCODER, lambda truth: (truth.rim_speed,)),
    "ground": (Sensor.ENCODER, lambda truth: (truth.speed,)),
}
_IMU: Final[dict[Sensor, _Read]] = {  # bodies in the order of `Truth.antennas`
    Sensor.IMU_TRACTOR: lambda truth: (truth.yaw_rate_t, truth.tractor.roll, truth.tractor.pitch),
    Sensor.IMU_TRAILER: lambda truth: (truth.yaw_rate_i, truth.trailer.roll, truth.trailer.pitch),
}


@dataclass(frozen=True, slots=True)
class _SampledSensor:
    sensor: Sensor
    read: _Read
    error: ErrorSource
    every: int  # physics steps from sample to sample
    delay: int  # physics steps from sample to delivery
    resolution: tuple[float, ...]  # of each component


class SensorSuite:
    """All sensors of the vehicle, sampled on a common count of physics steps.

    Args:
        specification: rates, errors and latencies.
        timestep: physics step [s]; every period and latency must be a whole number of them.
        seed: seed of the run.
        lever_arms: from tractor and trailer point to their antennas, (2, 3) [m], bodies' frames.

    Raises:
        InvalidPlant: a rate or a latency that no whole number of physics steps gives.
    """

    def __init__(
        self, specification: SensorSpecification, timestep: float, seed: int, lever_arms: FloatArray
    ) -> None:
        self.specification = specification
        self._timestep, self._seed, self._lever_arms = timestep, seed, lever_arms
        self._attitude = dict.fromkeys(_IMU, (0.0, 0.0))  # roll, pitch [rad] as last measured
        self._in_transit: list[tuple[int, Measurement]] = []  # physics step of delivery, sample
        self._sensors = tuple(self._entries())
        self._delays = any(sensor.delay for sensor in self._sensors)

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples or delivers."""
        # a delay of 0 leaves the greatest common divisor as it is
        return math.gcd(*(n for sensor in self._sensors for n in (sensor.every, sensor.delay)))

    def sample(self, truth: Truth, step: int) -> list[Measurement]:
        """Sample the sensors that are due at physics step `step`; return the samples delivered.

        A sample bears the time at which it was taken, whatever its latency.
        """
        prompt: list[Measurement] = []
        for entry in self._sensors:
            if step % entry.every == 0:
                value = tuple(map(add, entry.read(truth), entry.error.draw()))
                if any(entry.resolution):
                    value = tuple(map(quantised, value, entry.resolution))
                if entry.sensor in _IMU:
                    self._attitude[entry.sensor] = value[1], value[2]
                sample = Measurement(truth.time_s, entry.sensor, value)
                if self._delays:
                    self._in_transit.append((step + entry.delay, sample))
                else:
                    prompt.append(sample)
        if not self._delays:
            return prompt
        delivered = [sample for due, sample in self._in_transit if due <= step]
        self._in_transit = [item for item in self._in_transit if item[0] > step]
        return delivered

    def _entries(self) -> Iterator[_SampledSensor]:
        """Yield the sensors; IMUs first: corrected GNSS samples of the same moment need them."""
        of, imu = self.specification, self.specification.imu
        if imu.on:
            for sensor, read in _IMU.items():
                error = _imu_error(imu, self._seed, sensor)
                grid = _imu_units(imu.yaw_rate_resolution_degps, imu.angle_resolution_deg)
                yield self._entry(sensor, read, error, imu.latency_s, grid)
        for body, sensor in enumerate(_GNSS):
            error, resolution = _gnss_error(of, self._seed, sensor), 2 * (of.gnss_resolution_m,)
            read = self._gnss_reader(body)
            yield self._entry(sensor, read, error, of.gnss_latency_s, resolution)
        angle = (
            math.radians(of.angle_sd_deg),
            of.angle_latency_s,
            math.radians(of.angle_resolution_deg),
        )
        speed = (of.encoder_sd_mps, of.encoder_latency_s, of.encoder_resolution_mps)
        plain = [*((pair, angle) for pair in _ANGLES), (_ENCODER[of.encoder_on], speed)]
        for (sensor, read), (sd, latency_s, resolution) in plain:
            error = White(np.array([sd]), generator(self._seed, f"sensor/{sensor}"))
            yield self._entry(sensor, read, error, latency_s, (resolution,))

    def _entry(
        self,
        sensor: Sensor,
        read: _Read,
        error: ErrorSource,
        latency_s: float,
        resolution: tuple[float, ...],
    ) -> _SampledSensor:
        period_s, timestep = self.specification.period_s(sensor), self._timestep
        every = whole_steps(period_s, timestep, f"rate of sensor {sensor} ({1.0 / period_s:g} Hz)")
        delay = delay_steps(latency_s, timestep, f"latency of sensor {sensor}")
        return _SampledSensor(sensor, read, error, every, delay, resolution)

    def _gnss_reader(self, body: int) -> _Read:
        """Return the function that reads the position (x, y) [m] which a body's receiver reports.

        `body` is 0 for the tractor, 1 for the trailer.
        """
        lever, imu = self._lever_arms[body], tuple(_IMU)[body]

        def pose(truth: Truth) -> Pose:
            return (truth.tractor, truth.trailer)[body]

        def raw(truth: Truth) -> tuple[float, float]:
            x, y, _ = truth.antennas[body].tolist()
            return x, y

        def corrected(truth: Truth) -> tuple[float, float]:
            (x, y), (roll, pitch) = raw(truth), self._attitude[imu]
            east, north = lever_in_map(lever, pose(truth).yaw, pitch, roll)
            return x - east, y - north

        readers: dict[GnssAntenna, _Read] = {
            "point": lambda truth: (pose(truth).x, pose(truth).y),
            "raw": raw,
            "corrected": corrected,
        }
        return readers[self.specification.gnss_antenna]


def lever_in_map(lever: FloatArray, yaw: float, pitch: float, roll: float) -> tuple[float, float]:
    """Return the horizontal part (x, y) [m] of a lever arm in the map frame.

    It is R_z(yaw) R_y(pitch) R_x(roll) lever: an antenna at height h above its point moves
    h sin(roll) to the right of it and h cos(roll) sin(pitch) ahead.

    Args:
        lever: from point to antenna in the body's frame, (3,) [m].
        yaw: heading of the body [rad].
        pitch: positive nose down [rad].
        roll: positive left side up [rad].
    """
    x, y, z = lever.tolist()
    aside = y * math.cos(roll) - z * math.sin(roll)
    up = y * math.sin(roll) + z * math.cos(roll)
    ahead = x * math.cos(pitch) + up * math.sin(pitch)
    return (
        ahead * math.cos(yaw) - aside * math.sin(yaw),
        ahead * math.sin(yaw) + aside * math.cos(yaw),
    )


def _gnss_error(specification: SensorSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    sd, rng = np.full(2, specification.gnss_sd_m), generator(seed, f"sensor/{sensor}")
    match specification.gnss_error:
        case "white":
            return White(sd, rng)
        case "correlated":
            return Correlated(
                sd,
                specification.gnss_white_share,
                specification.gnss_correlation_time_s,
                1.0 / specification.gnss_rate_hz,
                rng,
                generator(seed, f"sensor/{sensor}/slow"),
            )
        case "non-gaussian":
            return HeavyTailed(sd, rng)


def _imu_units(yaw_rate_degps: float, angle_deg: float) -> tuple[float, float, float]:
    """Return values of the components of an IMU in their units."""
    return math.radians(yaw_rate_degps), math.radians(angle_deg), math.radians(angle_deg)


def _imu_error(imu: ImuSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    sd = np.array(_imu_units(imu.yaw_rate_sd_degps, imu.angle_sd_deg))
    bias_sd = np.array(_imu_units(imu.yaw_rate_bias_sd_degps, imu.angle_bias_sd_deg))
    bias = bias_sd * generator(seed, f"sensor/{sensor}/bias").standard_normal(3)
    return White(sd, generator(seed, f"sensor/{sensor}"), bias)
