"""The sensors of a vehicle: each with its own rate, error, delay and random generator.

GNSS samples are taken at the axle point, as the paper's model takes them ("point"), or at the
antenna above it, which a rolling or pitching vehicle moves: "raw" samples are the antenna's place
itself, "corrected" ones are less the lever arm, turned by roll and pitch as the newest sample of
that body's IMU has them. The heading for that turn is the true one: a wrong one would move the
corrected point by height x sin(roll) x error of the heading, 3 mm at 0.1 rad and 1 deg.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray, Measurement, Sensor

from ..actuation.quantisation import quantised
from ..randomness import generator
from ..step_counts import delay_steps, whole_steps
from ..truth import Pose, Truth
from .antennas import lever_in_map
from .sensor_errors import Correlated, ErrorSource, HeavyTailed, White
from .sensor_specification import GnssAntenna, ImuSpecification, SensorSpecification

_Read = Callable[[Truth], tuple[float, ...]]

_GNSS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)  # in the order of `Truth.antennas`
_ANGLES: Final[dict[Sensor, _Read]] = {
    Sensor.STEERING_TRACTOR: lambda truth: (truth.delta_t,),
    Sensor.STEERING_TRAILER: lambda truth: (truth.delta_i,),
    Sensor.HITCH: lambda truth: (truth.beta,),
}
_ENCODER: Final[dict[str, _Read]] = {
    "wheel": lambda truth: (truth.rim_speed,),
    "ground": lambda truth: (truth.speed,),
}
_IMU: Final[dict[Sensor, _Read]] = {  # bodies in the order of `Truth.antennas`
    Sensor.IMU_TRACTOR: lambda truth: (truth.yaw_rate_t, truth.tractor.roll, truth.tractor.pitch),
    Sensor.IMU_TRAILER: lambda truth: (truth.yaw_rate_i, truth.trailer.roll, truth.trailer.pitch),
}


@dataclass(frozen=True, slots=True)
class _Channel:
    sensor: Sensor
    read: _Read
    error: ErrorSource
    every: int  # physics steps from sample to sample
    delay: int  # physics steps from sample to delivery
    resolution: tuple[float, ...]  # of each entry


class SensorSuite:
    """All sensors of the vehicle, sampled on a common count of physics steps.

    Args:
        specification: what they are like.
        timestep: physics step [s]; every period and latency must be a whole number of them.
        seed: seed of the run.
        lever_arms: from tractor and trailer point to their antennas, (2, 3) [m], bodies' frames.

    Raises:
        InvalidPlant: a rate or a latency that no whole number of physics steps gives.
    """

    def __init__(
        self,
        specification: SensorSpecification,
        timestep: float,
        seed: int,
        lever_arms: FloatArray,
    ) -> None:
        self.specification = s = specification
        self._lever_arms = lever_arms
        self._attitude = dict.fromkeys(_IMU, (0.0, 0.0))  # roll, pitch [rad] as last measured
        self._under_way: list[tuple[int, Measurement]] = []  # physics step of delivery, sample

        def channel(
            sensor: Sensor,
            read: _Read,
            rate: float,
            latency: float,
            resolution: tuple[float, ...],
            error: ErrorSource,
        ) -> _Channel:
            what = f"rate of sensor {sensor} ({rate} Hz)"
            every = whole_steps(1.0 / rate if rate else math.inf, timestep, what)
            delay = delay_steps(latency, timestep, f"latency of sensor {sensor}")
            return _Channel(sensor, read, error, every, delay, resolution)

        def white(sensor: Sensor, sd: float) -> White:
            return White(np.array([sd]), generator(seed, f"sensor/{sensor}"))

        imu = s.imu
        self._channels = (
            # First: corrected GNSS samples of the same moment need them.
            *(
                channel(
                    *(sensor, read, imu.rate_hz, imu.latency_s),
                    imu.resolution,
                    _imu_error(imu, seed, sensor),
                )
                for sensor, read in (_IMU.items() if imu.on else ())
            ),
            *(
                channel(
                    *(sensor, self._gnss_reader(body), s.gnss_rate_hz, s.gnss_latency_s),
                    (s.gnss_resolution_m, s.gnss_resolution_m),
                    _gnss_error(s, seed, sensor),
                )
                for body, sensor in enumerate(_GNSS)
            ),
            *(
                channel(
                    *(sensor, read, s.angle_rate_hz, s.angle_latency_s),
                    (s.angle_resolution,),
                    white(sensor, s.angle_sd),
                )
                for sensor, read in _ANGLES.items()
            ),
            channel(
                *(Sensor.ENCODER, _ENCODER[s.encoder_on], s.encoder_rate_hz, s.encoder_latency_s),
                (s.encoder_resolution_mps,),
                white(Sensor.ENCODER, s.encoder_sd_mps),
            ),
        )

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples or delivers."""
        # A delay of 0 leaves the greatest common divisor as it is.
        return math.gcd(*(n for channel in self._channels for n in (channel.every, channel.delay)))

    def sample(self, truth: Truth, step: int) -> list[Measurement]:
        """Sample what is due at physics step `step` and return what is delivered at it.

        A sample bears the time at which it was taken, however late it comes.
        """
        for channel in self._channels:
            if step % channel.every == 0:
                reading = zip(
                    *(channel.read(truth), channel.error.draw(), channel.resolution), strict=True
                )
                value = tuple(quantised(true + error, to) for true, error, to in reading)
                if channel.sensor in _IMU:
                    self._attitude[channel.sensor] = value[1], value[2]
                sample = Measurement(truth.time_s, channel.sensor, value)
                self._under_way.append((step + channel.delay, sample))
        delivered = [sample for due, sample in self._under_way if due <= step]
        self._under_way = [item for item in self._under_way if item[0] > step]
        return delivered

    def _gnss_reader(self, body: int) -> _Read:
        """Return what gives the place (x, y) [m] that the receiver of a body reports."""
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


def _imu_error(imu: ImuSpecification, seed: int, sensor: Sensor) -> ErrorSource:
    sd = np.array(imu.sd)
    bias = np.array(imu.bias_sd) * generator(seed, f"sensor/{sensor}/bias").standard_normal(3)
    return White(sd, generator(seed, f"sensor/{sensor}"), bias)
