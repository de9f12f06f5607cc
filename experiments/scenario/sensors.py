"""`[sensors]`: rates and errors of what the controller can measure."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, NotNegative, Positive
from proving_ground.testbed.sensing.sensor_specification import (
    LONGEST_LATENCY_S,
    EncoderOn,
    GnssAntenna,
    GnssError,
    ImuSpecification,
    SensorSpecification,
)
from ttempc.estimation.noise import SensorNoise

Latency = Annotated[float, Field(ge=0, le=LONGEST_LATENCY_S)]

# A sensor without noise would leave the filter nothing to weigh it by.
_LEAST_BELIEVED = SensorNoise(gnss=1e-3, steering=1e-3, hitch=1e-3, encoder=1e-3)


@dataclass(frozen=True, config=STRICT)
class ImuSettings:
    """An inertial sensor on tractor and trailer; no estimator uses it, `gnss_antenna` may."""

    on: bool = False
    rate_hz: Positive = 25.0
    angle_sd_deg: NotNegative = 0.2
    angle_bias_sd_deg: NotNegative = 0.3  # over runs
    angle_resolution_deg: NotNegative = 0.0
    yaw_rate_sd_degps: NotNegative = 0.1
    yaw_rate_bias_sd_degps: NotNegative = 0.05  # over runs
    yaw_rate_resolution_degps: NotNegative = 0.0
    latency_s: Latency = 0.0

    def specification(self) -> ImuSpecification | None:
        """Return the IMU as it is; None where it is off."""
        if not self.on:
            return None
        return ImuSpecification(
            rate=self.rate_hz,
            angle_sd=math.radians(self.angle_sd_deg),
            angle_bias_sd=math.radians(self.angle_bias_sd_deg),
            angle_resolution=math.radians(self.angle_resolution_deg),
            yaw_rate_sd=math.radians(self.yaw_rate_sd_degps),
            yaw_rate_bias_sd=math.radians(self.yaw_rate_bias_sd_degps),
            yaw_rate_resolution=math.radians(self.yaw_rate_resolution_degps),
            latency=self.latency_s,
        )


@dataclass(frozen=True, config=STRICT)
class SensorSettings:
    """Rates and noise of the paper's sensors, and what may be wrong with them."""

    gnss_rate_hz: Positive = 5.0
    gnss_sd_m: NotNegative = 0.03  # of the whole error of an axis, whatever its kind
    gnss_error: GnssError = "white"
    gnss_correlation_time_s: Positive = 60.0  # where correlated
    gnss_white_share: Annotated[float, Field(ge=0, le=1)] = 0.1  # of the variance, where correlated
    gnss_antenna: GnssAntenna = "point"
    gnss_latency_s: Latency = 0.0
    gnss_resolution_m: NotNegative = 0.0
    angle_rate_hz: Positive = 25.0
    angle_sd_deg: NotNegative = 1.0
    angle_latency_s: Latency = 0.0
    angle_resolution_deg: NotNegative = 0.0
    encoder_rate_hz: Positive = 25.0
    encoder_sd_mps: NotNegative = 0.1
    encoder_on: EncoderOn = "wheel"
    encoder_latency_s: Latency = 0.0
    encoder_resolution_mps: NotNegative = 0.0
    imu: ImuSettings = ImuSettings()

    def specification(self) -> SensorSpecification:
        """Return the sensors as they are.

        Raises:
            InvalidPlant: a lever arm is to be corrected without an IMU.
        """
        return SensorSpecification(
            gnss_rate=self.gnss_rate_hz,
            gnss_sd=self.gnss_sd_m,
            gnss_error=self.gnss_error,
            gnss_correlation_time=self.gnss_correlation_time_s,
            gnss_white_share=self.gnss_white_share,
            gnss_antenna=self.gnss_antenna,
            gnss_latency=self.gnss_latency_s,
            gnss_resolution=self.gnss_resolution_m,
            angle_rate=self.angle_rate_hz,
            angle_sd=math.radians(self.angle_sd_deg),
            angle_latency=self.angle_latency_s,
            angle_resolution=math.radians(self.angle_resolution_deg),
            encoder_rate=self.encoder_rate_hz,
            encoder_sd=self.encoder_sd_mps,
            encoder_on=self.encoder_on,
            encoder_latency=self.encoder_latency_s,
            encoder_resolution=self.encoder_resolution_mps,
            imu=self.imu.specification(),
        )

    def believed_noise(self) -> SensorNoise:
        """Return the noise that the filter assumes: the true one, but never none at all.

        The filter takes every error for white and every sample for one of the axle point.
        """
        true, least = self.specification(), _LEAST_BELIEVED
        return SensorNoise(
            gnss=max(true.gnss_sd, least.gnss),
            steering=max(true.angle_sd, least.steering),
            hitch=max(true.angle_sd, least.hitch),
            encoder=max(true.encoder_sd, least.encoder),
        )
