"""What the sensors of a vehicle are like: rates, errors, delays; SI units, angles in radians."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final, Literal

from ..errors import InvalidPlant

GnssError = Literal["white", "correlated", "non-gaussian"]
GnssAntenna = Literal["point", "raw", "corrected"]
EncoderOn = Literal["wheel", "ground"]

LONGEST_LATENCY_S: Final = 2.0  # ten control periods


@dataclass(frozen=True, slots=True)
class ImuSpecification:
    """An inertial sensor with roll, pitch and yaw rate, one on the tractor, one on the trailer.

    The values are those of a small industrial one; assumed. Its bias is drawn once a run.

    Raises:
        InvalidPlant: a value is out of its range.
    """

    rate: float = 25.0  # [Hz]
    angle_sd: float = math.radians(0.2)  # [rad] of roll and pitch, each sample
    angle_bias_sd: float = math.radians(0.3)  # [rad] over runs
    angle_resolution: float = 0.0  # [rad]
    yaw_rate_sd: float = math.radians(0.1)  # [rad/s] each sample
    yaw_rate_bias_sd: float = math.radians(0.05)  # [rad/s] over runs
    yaw_rate_resolution: float = 0.0  # [rad/s]
    latency: float = 0.0  # [s]

    def __post_init__(self) -> None:
        _require_in_range(self, "sensors.imu")


@dataclass(frozen=True, slots=True)
class SensorSpecification:
    """The paper's sensors (sec. II) with white Gaussian noise, and what may be wrong with them.

    The rates of the sensors other than GNSS are assumed: the paper's computer reads all of them
    but says only that its controller runs at 5 Hz. `gnss_sd` is the standard deviation of the
    whole error of an axis, whatever its kind.

    Raises:
        InvalidPlant: a value is out of its range, or a lever arm is to be corrected without
            anything that measures the attitude.
    """

    gnss_rate: float = 5.0  # [Hz] two RTK antennas
    gnss_sd: float = 0.03  # [m] each axis
    gnss_error: GnssError = "white"
    # Between the 10 and 900 s by which carrier multipath is bounded (Joerger, Pervan 2020).
    gnss_correlation_time: float = 60.0  # [s] of the slow part where "correlated"; assumed
    gnss_white_share: float = 0.1  # of the variance where "correlated"; assumed
    gnss_antenna: GnssAntenna = "point"  # where the sample is taken, see `testbed.sensing.sensors`
    gnss_latency: float = 0.0  # [s] from the moment a sample is true to its delivery
    gnss_resolution: float = 0.0  # [m] 0 for none
    angle_rate: float = 25.0  # [Hz] both steering angles and the hitch angle
    angle_sd: float = math.radians(1.0)  # [rad]
    angle_latency: float = 0.0  # [s]
    angle_resolution: float = 0.0  # [rad]
    encoder_rate: float = 25.0  # [Hz]
    encoder_sd: float = 0.1  # [m/s]
    encoder_on: EncoderOn = "wheel"  # on the rear wheels, as in the paper: slip is in it
    encoder_latency: float = 0.0  # [s]
    encoder_resolution: float = 0.0  # [m/s]
    imu: ImuSpecification | None = None

    def __post_init__(self) -> None:
        _require_in_range(self, "sensors")
        if not self.gnss_correlation_time > 0.0:
            raise InvalidPlant(
                f"sensors.gnss_correlation_time: got {self.gnss_correlation_time} s, "
                "must be above 0; an error without memory is gnss_error = 'white'"
            )
        if self.gnss_white_share > 1.0:
            raise InvalidPlant(
                f"sensors.gnss_white_share: got {self.gnss_white_share}, must be in [0, 1]"
            )
        if self.gnss_antenna == "corrected" and self.imu is None:
            raise InvalidPlant(
                "sensors.gnss_antenna: 'corrected' needs the attitude that an IMU measures "
                "(sensors.imu.on = true); without one it can be 'point' or 'raw'"
            )

    def notes(self) -> list[str]:
        """Return a line for each flaw or addition; other rates and deviations go unsaid."""
        said = []
        if self.gnss_error == "correlated":
            said.append(
                f"GNSS error correlated over {self.gnss_correlation_time:g} s, "
                f"{100.0 * self.gnss_white_share:g} % of its variance white"
            )
        elif self.gnss_error == "non-gaussian":
            said.append("GNSS error heavy-tailed")
        if self.gnss_antenna == "raw":
            said.append("GNSS of the antennas taken for the axle points")
        elif self.gnss_antenna == "corrected":
            said.append("GNSS of the antennas, lever arms corrected with the IMU's attitude")
        if self.encoder_on == "ground":
            said.append("encoder reads the speed over ground")
        if self.imu:
            said.append("IMU on tractor and trailer")
            said += [f"IMU latency {self.imu.latency:g} s"] if self.imu.latency else []
        for name, latency in (
            ("GNSS", self.gnss_latency),
            ("angle", self.angle_latency),
            ("encoder", self.encoder_latency),
        ):
            said += [f"{name} latency {latency:g} s"] if latency else []
        for name, resolution, unit in (
            ("GNSS", self.gnss_resolution, "m"),
            ("angle", math.degrees(self.angle_resolution), "deg"),
            ("encoder", self.encoder_resolution, "m/s"),
        ):
            said += [f"{name} resolution {resolution:g} {unit}"] if resolution else []
        return [f"sensors: {line}" for line in said]


def _require_in_range(owner: ImuSpecification | SensorSpecification, where: str) -> None:
    for item in fields(owner):
        value = getattr(owner, item.name)
        if not isinstance(value, (int, float)):
            continue
        high = LONGEST_LATENCY_S if item.name.endswith("latency") else math.inf
        if not (math.isfinite(value) and 0.0 <= value <= high):
            allowed = f"in [0, {high:g}]" if high < math.inf else "finite and not negative"
            raise InvalidPlant(f"{where}.{item.name}: got {value}, must be {allowed}")
