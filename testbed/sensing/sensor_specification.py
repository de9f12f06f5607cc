"""Specification of the sensors: rates, errors and delays, in the units of a scenario file."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import Sensor

from ..configuration.config_io import STRICT, DurationS, Fraction, NotNegative, RateHz
from .sensor_presets import SensorPreset

GnssError = Literal["white", "correlated", "non-gaussian"]
GnssAntenna = Literal["point", "raw", "corrected"]
EncoderOn = Literal["wheel", "ground"]

MAX_LATENCY_S: Final = 2.0  # ten control periods
Latency = Annotated[float, Field(ge=0, le=MAX_LATENCY_S)]


@dataclass(frozen=True, config=STRICT)
class ImuSpecification:
    """Inertial sensors that measure roll, pitch and yaw rate, one on tractor and trailer each.

    The yaw rate is that about the vertical. The filter uses all three, `gnss_antenna =
    "corrected"` roll and pitch. The default values are those of a small industrial sensor; assumed.
    A bias is drawn once a run.
    """

    on: bool = False
    """Whether the vehicle has these sensors."""
    rate_hz: RateHz = 25.0
    """Sampling rate."""
    angle_sd_deg: NotNegative = 0.2
    """Standard deviation of roll and pitch, each sample."""
    angle_bias_sd_deg: NotNegative = 0.3
    """Standard deviation over runs of the bias of roll and pitch."""
    angle_resolution_deg: NotNegative = 0.0
    """Resolution of roll and pitch; 0: not quantised."""
    yaw_rate_sd_degps: NotNegative = 0.1
    """Standard deviation of the yaw rate, each sample."""
    yaw_rate_bias_sd_degps: NotNegative = 0.05
    """Standard deviation over runs of the bias of the yaw rate."""
    yaw_rate_resolution_degps: NotNegative = 0.0
    """Resolution of the yaw rate; 0: not quantised."""
    latency_s: Latency = 0.0
    """Time from sampling to delivery."""

    @property
    def sd(self) -> tuple[float, float, float]:
        """Standard deviation of yaw rate [rad/s], roll and pitch [rad]."""
        return _yaw_rate_and_angles(self.yaw_rate_sd_degps, self.angle_sd_deg)

    @property
    def bias_sd(self) -> tuple[float, float, float]:
        """Standard deviation of the bias of yaw rate [rad/s], roll and pitch [rad]."""
        return _yaw_rate_and_angles(self.yaw_rate_bias_sd_degps, self.angle_bias_sd_deg)

    @property
    def resolution(self) -> tuple[float, float, float]:
        """Resolution of yaw rate [rad/s], roll and pitch [rad]."""
        return _yaw_rate_and_angles(self.yaw_rate_resolution_degps, self.angle_resolution_deg)


@dataclass(frozen=True, config=STRICT)
class SensorSpecification:
    """Sensors of the paper (sec. II) with white Gaussian noise, and optional further errors.

    The rates of the sensors other than GNSS are assumed: the paper states only that its
    controller runs at 5 Hz.
    """

    preset: SensorPreset = "paper"
    """Preset that gives the absent keys of a file: "paper", white noise at the axle points, or
    "field", GNSS with correlated errors, antennas on masts, an IMU and latency
    (`testbed/sensing/sensor_presets.py`). A change of preset drops the file's other keys."""
    gnss_rate_hz: RateHz = 5.0
    """Sampling rate of both RTK receivers."""
    gnss_sd_m: NotNegative = 0.03
    """Standard deviation of the whole error of an axis, for every kind of error."""
    gnss_error: GnssError = "white"
    """Kind of error, see `testbed.sensing.sensor_errors`."""
    # Between the 10 and 900 s by which carrier multipath is bounded (Joerger, Pervan 2020).
    gnss_correlation_time_s: DurationS = 60.0
    """Correlation time of the coloured part of a correlated error; assumed."""
    gnss_white_share: Fraction = 0.1
    """White share of the variance of a correlated error; assumed."""
    gnss_antenna: GnssAntenna = "point"
    """Point that is measured: axle point, antenna, or antenna corrected by the IMU's attitude."""
    gnss_latency_s: Latency = 0.0
    """Time from sampling to delivery."""
    gnss_resolution_m: NotNegative = 0.0
    """Resolution of a position; 0: not quantised."""
    angle_rate_hz: RateHz = 25.0
    """Sampling rate of both steering angles and of the hitch angle."""
    angle_sd_deg: NotNegative = 1.0
    """Standard deviation of these angles."""
    angle_latency_s: Latency = 0.0
    """Time from sampling to delivery."""
    angle_resolution_deg: NotNegative = 0.0
    """Resolution of these angles; 0: not quantised."""
    encoder_rate_hz: RateHz = 25.0
    """Sampling rate of the speed encoder."""
    encoder_sd_mps: NotNegative = 0.1
    """Standard deviation of the speed."""
    encoder_on: EncoderOn = "wheel"
    """Measured speed: that of the rear wheels, slip included (paper), or that over ground."""
    encoder_latency_s: Latency = 0.0
    """Time from sampling to delivery."""
    encoder_resolution_mps: NotNegative = 0.0
    """Resolution of the speed; 0: not quantised."""
    imu: ImuSpecification = ImuSpecification()
    """Inertial sensors."""

    def __post_init__(self) -> None:
        if self.gnss_antenna == "corrected" and not self.imu.on:
            raise ValueError(
                "gnss_antenna 'corrected' needs the attitude that an IMU measures "
                "(sensors.imu.on = true); without one it can be 'point' or 'raw'"
            )

    def period_s(self, sensor: Sensor) -> float:
        """Return the time from sample to sample of a sensor [s]."""
        if sensor.startswith("imu"):
            return 1.0 / self.imu.rate_hz
        rates = {"gnss": self.gnss_rate_hz, "encoder": self.encoder_rate_hz}
        return 1.0 / rates.get(sensor.split("_")[0], self.angle_rate_hz)

    @property
    def angle_sd(self) -> float:
        """Standard deviation of the steering angles and the hitch angle [rad]."""
        return math.radians(self.angle_sd_deg)

    @property
    def angle_resolution(self) -> float:
        """Resolution of the steering angles and the hitch angle [rad]."""
        return math.radians(self.angle_resolution_deg)

    def notes(self) -> list[str]:
        """Return one line for each error or sensor that the paper does not have.

        Rates and standard deviations are not listed.
        """
        notes = []
        if self.gnss_error == "correlated":
            notes.append(
                f"GNSS error correlated over {self.gnss_correlation_time_s:g} s, "
                f"{100.0 * self.gnss_white_share:g} % of its variance white"
            )
        elif self.gnss_error == "non-gaussian":
            notes.append("GNSS error heavy-tailed")
        if self.gnss_antenna == "raw":
            notes.append("GNSS of the antennas taken for the axle points")
        elif self.gnss_antenna == "corrected":
            notes.append("GNSS of the antennas, lever arms corrected with the IMU's attitude")
        if self.encoder_on == "ground":
            notes.append("encoder reads the speed over ground")
        if self.imu.on:
            notes.append("IMU on tractor and trailer")
            notes += [f"IMU latency {self.imu.latency_s:g} s"] if self.imu.latency_s else []
        for name, latency in (
            ("GNSS", self.gnss_latency_s),
            ("angle", self.angle_latency_s),
            ("encoder", self.encoder_latency_s),
        ):
            notes += [f"{name} latency {latency:g} s"] if latency else []
        for name, resolution, unit in (
            ("GNSS", self.gnss_resolution_m, "m"),
            ("angle", self.angle_resolution_deg, "deg"),
            ("encoder", self.encoder_resolution_mps, "m/s"),
        ):
            notes += [f"{name} resolution {resolution:g} {unit}"] if resolution else []
        return [f"sensors: {line}" for line in notes]


def _yaw_rate_and_angles(yaw_rate_degps: float, angle_deg: float) -> tuple[float, float, float]:
    angle = math.radians(angle_deg)
    return math.radians(yaw_rate_degps), angle, angle
