"""Measurement noise that an estimator assumes."""

from __future__ import annotations

from typing import Final

from proving_ground.testbed.sensing.sensor_specification import SensorSpecification
from ttempc.estimation.noise import SensorNoise

# Without measurement noise the covariance of the innovation would be singular.
_MIN_SD: Final = 1e-3  # [m], [rad], [m/s]


def assumed_noise(sensors: SensorSpecification) -> SensorNoise:
    """Return the standard deviations of the sensors, each at least 0.001 in its SI unit.

    The estimator assumes that every error is white and that every GNSS sample is one of the axle
    point, also where the sensors differ from that.
    """
    return SensorNoise(
        gnss=max(sensors.gnss_sd_m, _MIN_SD),
        steering=max(sensors.angle_sd, _MIN_SD),
        hitch=max(sensors.angle_sd, _MIN_SD),
        encoder=max(sensors.encoder_sd_mps, _MIN_SD),
    )
