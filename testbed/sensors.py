"""The sensors of the paper: each with its own rate, noise and random generator."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from testbed.randomness import generator
from testbed.steps import whole_steps
from testbed.truth import Truth
from ttempc.types import Measurement, Sensor

_READ: Final[dict[Sensor, Callable[[Truth], tuple[float, ...]]]] = {
    Sensor.GNSS_TRACTOR: lambda truth: (truth.tractor.x, truth.tractor.y),
    Sensor.GNSS_TRAILER: lambda truth: (truth.trailer.x, truth.trailer.y),
    Sensor.STEERING_TRACTOR: lambda truth: (truth.delta_t,),
    Sensor.STEERING_TRAILER: lambda truth: (truth.delta_i,),
    Sensor.HITCH: lambda truth: (truth.beta,),
    # On the rear wheels, as in the paper: slip is in it.
    Sensor.ENCODER: lambda truth: (truth.rim_speed,),
}


@dataclass(frozen=True, slots=True)
class SensorSpecification:
    """Rate and white Gaussian noise of the paper's sensors (paper, sec. II); angles in radians.

    The rates of the sensors other than GNSS are assumed: the paper's computer reads all of them
    but says only that its controller runs at 5 Hz.
    """

    gnss_rate: float = 5.0  # [Hz] two RTK antennas
    gnss_sd: float = 0.03  # [m] each axis
    angle_rate: float = 25.0  # [Hz] both steering angles and the hitch angle
    angle_sd: float = math.radians(1.0)  # [rad]
    encoder_rate: float = 25.0  # [Hz]
    encoder_sd: float = 0.1  # [m/s]


@dataclass(frozen=True, slots=True)
class _Channel:
    sensor: Sensor
    every: int  # physics steps from sample to sample
    sd: float
    rng: np.random.Generator


class SensorSuite:
    """All sensors of the vehicle, sampled on a common count of physics steps.

    Args:
        specification: rates and standard deviations.
        timestep: physics step [s]; every rate must be a whole number of them.
        seed: seed of the run.

    Raises:
        InvalidPlant: a rate that no whole number of physics steps gives.
    """

    def __init__(self, specification: SensorSpecification, timestep: float, seed: int) -> None:
        def channel(sensor: Sensor, rate: float, sd: float) -> _Channel:
            every = whole_steps(1.0 / rate, timestep, f"rate of sensor {sensor} ({rate} Hz)")
            return _Channel(sensor, every, sd, generator(seed, f"sensor/{sensor}"))

        angles = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
        self._channels = (
            channel(Sensor.GNSS_TRACTOR, specification.gnss_rate, specification.gnss_sd),
            channel(Sensor.GNSS_TRAILER, specification.gnss_rate, specification.gnss_sd),
            *(
                channel(sensor, specification.angle_rate, specification.angle_sd)
                for sensor in angles
            ),
            channel(Sensor.ENCODER, specification.encoder_rate, specification.encoder_sd),
        )

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples."""
        return math.gcd(*(channel.every for channel in self._channels))

    def sample(self, truth: Truth, step: int) -> list[Measurement]:
        """Return the samples of the sensors that are due at physics step `step`."""
        return [
            Measurement(
                truth.time_s,
                channel.sensor,
                tuple(
                    float(value + channel.sd * channel.rng.standard_normal())
                    for value in _READ[channel.sensor](truth)
                ),
            )
            for channel in self._channels
            if step % channel.every == 0
        ]
