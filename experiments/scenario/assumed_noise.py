"""`[controller.noise]`: measurement noise that the estimator assumes.

An estimator assumes that errors are white but for the slow part of GNSS and the bias of a gyro, and
that a GNSS sample is one of the axle point unless the height of the antenna is given, also where
the sensors differ.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Final, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.estimation.noise import SensorNoise

from ...testbed.configuration.config_io import STRICT, DurationS, NotNegative, Positive
from ...testbed.sensing.sensor_specification import SensorSpecification
from .vehicle import ParameterMismatch

# Without measurement noise the covariance of the innovation would be singular.
_MIN_SD: Final = 1e-3  # [m], [rad], [m/s]
_MIN_SHARE: Final = 1e-2
_MIN_YAW_RATE_DEGPS: Final = 1e-3

AssumedSd = Annotated[float, Field(ge=_MIN_SD, le=1e6)]


@dataclass(frozen=True, config=STRICT)
class NoiseSettings:
    """Standard deviations that the estimator assumes; absent: those of `assumed`."""

    assumed: Literal["sensors", "paper"] = "sensors"
    """Origin of the absent keys: the table `[sensors]`, as from a data sheet, or the paper's
    sensors. A change drops the file's other keys."""
    gnss_sd_m: AssumedSd | None = None
    """Position of both receivers, each axis."""
    angle_sd_deg: AssumedSd | None = None
    """Both steering angles and the hitch angle."""
    encoder_sd_mps: AssumedSd | None = None
    """Speed of the encoder."""
    gnss_white_share: Annotated[float, Field(gt=0, le=1)] | None = None
    """White share of the variance of a position; the rest is correlated over time."""
    gnss_correlation_time_s: DurationS | None = None
    """Correlation time of that rest."""
    yaw_rate_sd_degps: NotNegative | None = None
    """Yaw rate of both IMUs, where there are any; 0: the estimator does not use it."""
    yaw_rate_bias_sd_degps: Positive | None = None
    """Bias of this yaw rate at the start."""
    antenna_height_t_m: NotNegative = 0.0
    """Antenna of the tractor above the axle point: raw positions are corrected with the attitude
    that the IMU measures; 0: they are taken for the axle point."""
    antenna_height_i_m: NotNegative = 0.0
    """The same of the trailer."""

    def filled(self, sensors: SensorSpecification) -> NoiseSettings:
        """Return the table with the absent keys filled in, each at least 0.001 in its SI unit.

        Args:
            sensors: of the vehicle.
        """
        return replace(self, **self._values(sensors))

    def sensor_noise(self, sensors: SensorSpecification) -> SensorNoise:
        """Return the noise that the estimator assumes.

        Args:
            sensors: of the vehicle; they give the absent keys.
        """
        values = self._values(sensors)
        angle = math.radians(values["angle_sd_deg"])
        return SensorNoise(
            gnss=values["gnss_sd_m"],
            steering=angle,
            hitch=angle,
            encoder=values["encoder_sd_mps"],
            gnss_white_share=values["gnss_white_share"],
            gnss_correlation_s=values["gnss_correlation_time_s"],
            yaw_rate=math.radians(values["yaw_rate_sd_degps"]),
            yaw_rate_bias=math.radians(values["yaw_rate_bias_sd_degps"]),
            antenna_height_t=self.antenna_height_t_m,
            antenna_height_i=self.antenna_height_i_m,
            attitude=max(math.radians(sensors.imu.angle_sd_deg), _MIN_SD),
            attitude_bias=max(math.radians(sensors.imu.angle_bias_sd_deg), _MIN_SD),
        )

    def mismatch(self, sensors: SensorSpecification) -> tuple[ParameterMismatch, ...]:
        """Return the values that differ from those that the sensors' specification gives."""
        assumed = self._values(sensors)
        return tuple(
            ParameterMismatch(f"controller.noise.{key}", true, assumed[key])
            for key, true in _of_sensors(sensors).items()
            if assumed[key] != true
        )

    def _values(self, sensors: SensorSpecification) -> dict[str, float]:
        values = _of_sensors(sensors if self.assumed == "sensors" else SensorSpecification())
        given = {key: getattr(self, key) for key in values}
        return values | {key: value for key, value in given.items() if value is not None}


def _of_sensors(sensors: SensorSpecification) -> dict[str, float]:
    correlated = sensors.gnss_error == "correlated"
    return {
        "gnss_sd_m": max(sensors.gnss_sd_m, _MIN_SD),
        "angle_sd_deg": max(sensors.angle_sd_deg, math.degrees(_MIN_SD)),
        "encoder_sd_mps": max(sensors.encoder_sd_mps, _MIN_SD),
        "gnss_white_share": max(sensors.gnss_white_share, _MIN_SHARE) if correlated else 1.0,
        "gnss_correlation_time_s": sensors.gnss_correlation_time_s,
        "yaw_rate_sd_degps": max(sensors.imu.yaw_rate_sd_degps, _MIN_YAW_RATE_DEGPS),
        "yaw_rate_bias_sd_degps": max(sensors.imu.yaw_rate_bias_sd_degps, _MIN_YAW_RATE_DEGPS),
    }
