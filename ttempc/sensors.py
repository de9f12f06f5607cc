"""Table of the sensors that a vehicle may have.

Layout, filter, detectors, noise and simulated sensors take their loops from `SENSORS`. A new sensor
needs a member and a row here, its settings in `testbed/sensing/sensor_specification.py` and, where
the filter uses it, its equation in `ttempc/models/measurement.py`.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag, StrEnum
from typing import Final


class Sensor(StrEnum):
    """Sensors of a vehicle, each with the components of a sample."""

    GNSS_TRACTOR = "gnss_tractor"  # (x, y) [m] of the tractor point, map frame
    GNSS_TRAILER = "gnss_trailer"  # (x, y) [m] of the trailer point, map frame
    STEERING_TRACTOR = "steering_tractor"  # (delta_t,) [rad]
    STEERING_TRAILER = "steering_trailer"  # (delta_i,) [rad]
    HITCH = "hitch"  # (beta,) [rad], angle between tractor and drawbar at RJ1
    ENCODER = "encoder"  # (v,) [m/s], circumferential speed of the rear wheels
    IMU_TRACTOR = "imu_tractor"  # (yaw rate [rad/s], roll, pitch [rad]): left up, nose down
    IMU_TRAILER = "imu_trailer"  # yaw rate, roll and pitch of the trailer
    VELOCITY_TRACTOR = "velocity_tractor"  # by GNSS: east, north, sd of an axis, 0: unknown [m/s]
    VELOCITY_TRAILER = "velocity_trailer"  # of the trailer's receiver
    RECEIVER_TRACTOR = "receiver_tractor"  # `ReceiverStatus.value`: flags, [s], [m]
    RECEIVER_TRAILER = "receiver_trailer"  # of the trailer's receiver


class SensorIndex(IntEnum):
    """Number of each sensor in rows of samples and in kernels; the names are those of `Sensor`."""

    GNSS_TRACTOR = 0
    GNSS_TRAILER = 1
    STEERING_TRACTOR = 2
    STEERING_TRAILER = 3
    HITCH = 4
    ENCODER = 5
    IMU_TRACTOR = 6
    IMU_TRAILER = 7
    VELOCITY_TRACTOR = 8
    VELOCITY_TRAILER = 9
    RECEIVER_TRACTOR = 10
    RECEIVER_TRAILER = 11


class SensorKind(IntEnum):
    """What a sensor measures; it decides how the filter treats a sample."""

    POSITION = 0  # two coordinates and the status of the solution
    ANGLE = 1  # of a joint: differences are wrapped to half a turn
    SPEED = 2
    INERTIAL = 3  # yaw rate, roll and pitch of a body
    VELOCITY = 4  # over ground, by Doppler or carrier phase; it checks the positions
    RECEIVER = 5  # what a receiver says of itself


class ReceiverFlag(IntFlag):
    """Warnings of a receiver, as bits of the first entry of its status."""

    DEAD_RECKONING = 1  # the position is computed, not measured
    SPOOFED = 2
    JAMMED = 4
    FEW_SATELLITES = 8


class Body(IntEnum):
    """Number of each body of the vehicle that carries a receiver and an IMU."""

    TRACTOR = 0
    TRAILER = 1


@dataclass(frozen=True, slots=True)
class SensorRow:
    """Properties of one sensor."""

    index: SensorIndex
    kind: SensorKind
    body: Body  # that carries the sensor; of a hitch angle the tractor
    components: tuple[str, ...]  # names of the entries of a sample, each with its unit
    noise: str  # field of `SensorNoise` with the standard deviation of an entry, or `OTHERS`
    needed_at_start: bool  # whether the filter needs a sample of it to start
    used_by_filter: bool = True  # whether the filter has a measurement equation for it

    @property
    def sensor(self) -> Sensor:
        """The sensor itself."""
        return Sensor[self.index.name]

    @property
    def length(self) -> int:
        """Number of entries of a sample."""
        return len(self.components)

    @property
    def innovation_size(self) -> int:
        """Number of entries of an innovation; an IMU is compared by its yaw rate only."""
        return 2 if self.kind is SensorKind.POSITION else 1


OTHERS: Final = "others"
"""`SensorRow.noise` of a sensor whose noise is an entry of `SensorNoise.others`."""

_POSITION: Final = ("x_m", "y_m")
_INERTIAL: Final = ("yaw_rate_radps", "roll_rad", "pitch_rad")
_VELOCITY: Final = ("east_mps", "north_mps", "sd_mps")
_RECEIVER: Final = ("flags", "correction_age_s", "protection_m")


def _unfiltered(
    index: SensorIndex, kind: SensorKind, body: Body, components: tuple[str, ...]
) -> SensorRow:
    """Return the row of a sensor that the detectors alone use."""
    return SensorRow(
        index,
        kind,
        body,
        components=components,
        noise=OTHERS,
        needed_at_start=False,
        used_by_filter=False,
    )


SENSORS: Final[tuple[SensorRow, ...]] = (
    SensorRow(
        SensorIndex.GNSS_TRACTOR,
        SensorKind.POSITION,
        Body.TRACTOR,
        components=_POSITION,
        noise="gnss",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.GNSS_TRAILER,
        SensorKind.POSITION,
        Body.TRAILER,
        components=_POSITION,
        noise="gnss",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.STEERING_TRACTOR,
        SensorKind.ANGLE,
        Body.TRACTOR,
        components=("rad",),
        noise="steering",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.STEERING_TRAILER,
        SensorKind.ANGLE,
        Body.TRAILER,
        components=("rad",),
        noise="steering",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.HITCH,
        SensorKind.ANGLE,
        Body.TRACTOR,
        components=("rad",),
        noise="hitch",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.ENCODER,
        SensorKind.SPEED,
        Body.TRACTOR,
        components=("mps",),
        noise="encoder",
        needed_at_start=True,
    ),
    SensorRow(
        SensorIndex.IMU_TRACTOR,
        SensorKind.INERTIAL,
        Body.TRACTOR,
        components=_INERTIAL,
        noise="yaw_rate",
        needed_at_start=False,
    ),
    SensorRow(
        SensorIndex.IMU_TRAILER,
        SensorKind.INERTIAL,
        Body.TRAILER,
        components=_INERTIAL,
        noise="yaw_rate",
        needed_at_start=False,
    ),
    _unfiltered(SensorIndex.VELOCITY_TRACTOR, SensorKind.VELOCITY, Body.TRACTOR, _VELOCITY),
    _unfiltered(SensorIndex.VELOCITY_TRAILER, SensorKind.VELOCITY, Body.TRAILER, _VELOCITY),
    _unfiltered(SensorIndex.RECEIVER_TRACTOR, SensorKind.RECEIVER, Body.TRACTOR, _RECEIVER),
    _unfiltered(SensorIndex.RECEIVER_TRAILER, SensorKind.RECEIVER, Body.TRAILER, _RECEIVER),
)
"""Every sensor, in the order of `SensorIndex`."""

ROW_OF: Final[dict[Sensor, SensorRow]] = {row.sensor: row for row in SENSORS}
"""Row of each sensor, in the order of `SensorIndex`."""

# Columns of the table as tuples of numbers, which compiled kernels can read
SENSOR_COUNT: Final = len(SENSORS)
SENSOR_LENGTHS: Final = tuple(row.length for row in SENSORS)
SENSOR_KINDS: Final = tuple(int(row.kind) for row in SENSORS)
SENSOR_BODIES: Final = tuple(int(row.body) for row in SENSORS)
INNOVATION_SIZES: Final = tuple(row.innovation_size for row in SENSORS)
NEEDED_AT_START: Final = tuple(row.needed_at_start for row in SENSORS)

STARTING_SENSORS: Final = tuple(row.sensor for row in SENSORS if row.needed_at_start)
"""Sensors without a sample of which the filter does not start."""


def sensors_of_kind(kind: SensorKind) -> tuple[Sensor, ...]:
    """Return the sensors of a kind, in the order of `SensorIndex`."""
    return tuple(row.sensor for row in SENSORS if row.kind is kind)


def _index_of(kind: SensorKind, body: Body) -> int:
    """Return the number of the one sensor of a kind on a body."""
    (index,) = [row.index for row in SENSORS if row.kind is kind and row.body is body]
    return int(index)


GNSS_OF_BODY: Final = tuple(_index_of(SensorKind.POSITION, body) for body in Body)
"""Number of the receiver of each `Body`."""
IMU_OF_BODY: Final = tuple(_index_of(SensorKind.INERTIAL, body) for body in Body)
"""Number of the IMU of each `Body`."""
VELOCITY_OF_BODY: Final = tuple(_index_of(SensorKind.VELOCITY, body) for body in Body)
"""Number of the velocity of each `Body`'s receiver."""
RECEIVER_OF_BODY: Final = tuple(_index_of(SensorKind.RECEIVER, body) for body in Body)
"""Number of the status of each `Body`'s receiver."""
