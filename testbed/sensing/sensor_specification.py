"""Specification of the sensors, in the units of a scenario file, and named sets of its values."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.sensors import ROW_OF, SensorKind
from ttempc.types import Sensor

from ..configuration.config_io import STRICT, DurationS, Fraction, NotNegative, RateHz
from .receivers import PLACES, Place

GnssError = Literal["white", "correlated", "non-gaussian", Place]
GnssAntenna = Literal["point", "raw", "corrected"]
GnssVelocity = Literal["none", "doppler", "carrier", "positions"]
EncoderOn = Literal["wheel", "ground"]

ANGLE_RANGE_DEG: Final = 90.0
MAX_LATENCY_S: Final = 2.0  # ten control periods
Latency = Annotated[float, Field(ge=0, le=MAX_LATENCY_S)]

SensorPreset = Literal["paper", "rtk", "field", "good"]

SENSOR_PRESETS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        # Kayacan, Ramon and Saeys (2016), sec. II: the defaults of `SensorSpecification`.
        "paper": {},
        # Equipment of today with the noise of the paper: velocity of the receivers, angle sensors
        # of 12 bits in a turn, an IMU on each body.
        "rtk": {
            "gnss_velocity": "doppler",
            "angle_resolution_deg": 0.088,
            "imu": {"on": True},
        },
        "field": {
            "gnss_error": "open-sky",
            "gnss_velocity": "doppler",
            # Antennas on masts, their lever arms corrected with the attitude that an IMU measures.
            "gnss_antenna": "corrected",
            "imu": {"on": True},
            # Assumed. Receivers state below 0.02 s where they extrapolate the base station's
            # phase, and 0.5 to 2 s where they wait for it (manuals of Trimble BD950 and 5700).
            "gnss_latency_s": 0.2,
            # Assumed: 12 bit over a turn, a linearity as in data sheets of potentiometers, and the
            # offset that is left where a driver finds the middle on a straight line.
            "angle_sd_deg": 0.2,
            "angle_resolution_deg": 0.1,
            "angle_offset_deg": 1.0,
            "angle_nonlinearity_pct": 0.5,
        },
        # RTK as data sheets state it (8 mm + 1 ppm, horizontal), white, at the axle points; angle
        # sensors of 0.3 deg, assumed; velocity of the receivers, IMU.
        "good": {
            "gnss_sd_m": 0.008,
            "gnss_velocity": "doppler",
            "angle_sd_deg": 0.3,
            "imu": {"on": True},
        },
    }
)
"""Settings that differ from the defaults of `SensorSpecification`, by the name of the preset."""


def with_preset(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table `[sensors]` with the values of its preset under the keys that it gives.

    A resolved table gives every key, so that its preset changes nothing. An unknown preset adds
    nothing; the validation of the table refuses it.
    """
    preset = SENSOR_PRESETS.get(str(table.get("preset")), {})
    return {**preset, **{key: _over(preset.get(key), value) for key, value in table.items()}}


def _over(below: object, value: object) -> object:
    """Return a value that a table gives; a table of its own lies over that of the preset."""
    if isinstance(below, Mapping) and isinstance(value, Mapping):
        return {**below, **value}
    return value


class PlainSensor(NamedTuple):
    """Settings of a sensor of one number with white noise, in SI units."""

    truth: str  # name in `testbed.truth.MOTION` of what it measures
    rate_hz: float
    sd: float
    latency_s: float
    resolution: float  # 0: not quantised


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


@dataclass(frozen=True, config=STRICT)
class SensorSpecification:
    """Sensors of the paper (sec. II) with white Gaussian noise, and optional further errors.

    The rates of the sensors other than GNSS are assumed: the paper states only that its
    controller runs at 5 Hz.
    """

    preset: SensorPreset = "paper"
    """Preset that gives the absent keys of a file: "paper", white noise at the axle points;
    "rtk", the same noise with velocities, angle sensors of 12 bits and an IMU on each body;
    "field", receivers under an open sky, late, antennas on masts, an IMU, and angle sensors
    with an offset; or "good", RTK of 8 mm, velocities, angle sensors of 0.3 deg, an IMU
    (`SENSOR_PRESETS`). A change of preset drops the file's other keys."""
    gnss_rate_hz: RateHz = 5.0
    """Sampling rate of both RTK receivers."""
    gnss_sd_m: NotNegative = 0.03
    """Standard deviation of the whole error of an axis, for every kind of error but a place."""
    gnss_error: GnssError = "white"
    """Kind of error, see `testbed.sensing.sensor_errors`, or the place of receivers with errors as
    recorded there, see `testbed.sensing.receivers`."""
    # Between the 10 and 900 s by which carrier multipath is bounded (Joerger, Pervan 2020).
    gnss_correlation_time_s: DurationS = 60.0
    """Correlation time of the coloured part of a correlated error; assumed."""
    gnss_white_share: Fraction = 0.1
    """White share of the variance of a correlated error; assumed."""
    gnss_antenna: GnssAntenna = "point"
    """Point that is measured: axle point, antenna, or antenna corrected by the IMU's attitude."""
    gnss_latency_s: Latency = 0.0
    """Time from sampling to delivery."""
    gnss_velocity: GnssVelocity = "none"
    """Velocity that the receivers deliver: none, that of a moment by Doppler, the mean since the
    last sample by carrier phase, or the derivative of their own positions, which checks nothing."""
    gnss_velocity_sd_mps: NotNegative = 0.03
    """Standard deviation of the white part of a velocity's axis by Doppler or carrier; assumed."""
    gnss_velocity_wander_mps: NotNegative = 0.002
    """Standard deviation of the slow part of that error, which both receivers share; assumed."""
    gnss_velocity_wander_s: DurationS = 60.0
    """Correlation time of the slow part; assumed."""
    gnss_status: bool = False
    """Whether the receivers tell their status: warnings, age of corrections, protection level."""
    gnss_resolution_m: NotNegative = 0.0
    """Resolution of a position; 0: not quantised."""
    angle_rate_hz: RateHz = 25.0
    """Sampling rate of both steering angles and of the hitch angle."""
    angle_sd_deg: NotNegative = 1.0
    """Standard deviation of these angles."""
    angle_offset_deg: NotNegative = 0.0
    """Largest offset of each of these sensors; drawn once a run, uniform."""
    angle_nonlinearity_pct: NotNegative = 0.0
    """Largest deviation from a straight line in per cent of a range of 90 deg: a sine of the angle,
    as long as the range, whose phase is drawn once a run."""
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

    @property
    def place(self) -> Place | None:
        """Place whose receivers give the errors of GNSS."""
        return next((place for place in PLACES if place == self.gnss_error), None)

    @property
    def angle_offset_sd_deg(self) -> float:
        """Standard deviation of offset and nonlinearity of an angle sensor over runs."""
        offset = self.angle_offset_deg / math.sqrt(3.0)
        return math.hypot(offset, self.nonlinearity_deg / math.sqrt(2.0))

    @property
    def nonlinearity_deg(self) -> float:
        """Largest deviation of an angle sensor from a straight line."""
        return 0.01 * self.angle_nonlinearity_pct * ANGLE_RANGE_DEG

    @property
    def plain_sensors(self) -> dict[Sensor, PlainSensor]:
        """Settings of every sensor of one number that the vehicle has."""
        sensors = {
            Sensor.STEERING_TRACTOR: self._angle_sensor("delta_t"),
            Sensor.STEERING_TRAILER: self._angle_sensor("delta_i"),
            Sensor.HITCH: self._angle_sensor("beta"),
        }
        sensors[Sensor.ENCODER] = PlainSensor(
            truth={"wheel": "wheel_speed", "ground": "speed"}[self.encoder_on],
            rate_hz=self.encoder_rate_hz,
            sd=self.encoder_sd_mps,
            latency_s=self.encoder_latency_s,
            resolution=self.encoder_resolution_mps,
        )
        return sensors

    def _angle_sensor(self, truth: str) -> PlainSensor:
        return PlainSensor(
            truth,
            rate_hz=self.angle_rate_hz,
            sd=math.radians(self.angle_sd_deg),
            latency_s=self.angle_latency_s,
            resolution=math.radians(self.angle_resolution_deg),
        )

    def period_s(self, sensor: Sensor) -> float:
        """Return the time from sample to sample of a sensor [s].

        Raises:
            KeyError: the vehicle does not have the sensor.
        """
        match ROW_OF[sensor].kind:
            case SensorKind.POSITION | SensorKind.VELOCITY | SensorKind.RECEIVER:
                return 1.0 / self.gnss_rate_hz
            case SensorKind.INERTIAL:
                return 1.0 / self.imu.rate_hz
            case _:
                return 1.0 / self.plain_sensors[sensor].rate_hz
