"""Records of the filter: its constants, and a snapshot of all that it carries on."""

from __future__ import annotations

import math
from enum import IntEnum
from statistics import NormalDist
from typing import Final

import numpy as np

from ...errors import InvalidTuning, UnknownSensor
from ...jit import cached_njit
from ...jit.rows import WIDTH
from ...models.augmented_state import SIZE, STATES, VehicleParameter, vehicle_parameters
from ...models.measurement import EQUATIONS
from ...sensors import INNOVATION_SIZES, SENSOR_COUNT, SENSORS, SensorKind
from ...types import FloatArray, State
from ...vehicle import Vehicle
from ..noise import SCALES, ProcessNoise, SensorNoise

LEVELS: Final = 1 + SCALES
"""A value and its derivatives by the factors of `NoiseScale`."""

DISTURBANCES: Final = SIZE - STATES

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: four times the resolution of a double at Unix time [s]."""

LEAST_VARIANCE: Final = 1e-12
"""Variance of an entry without uncertainty: covariances must be invertible."""

_PATIENCE_S: Final = 1.0  # for which the gate may reject a sensor
_LONGER_PATIENCE_S: Final = 5.0  # of a receiver that may find a wrong fix; assumed

FILTER: Final = np.dtype(
    [
        ("vehicle", "f8", len(VehicleParameter)),
        ("fading", "f8", 2 * DISTURBANCES),  # rates of each disturbance, see `ProcessNoise.fading`
        ("rates", "f8", (2, LEVELS, SIZE)),  # variances of the noise, see `ProcessNoise.rates`
        ("walk", "f8"),  # variance that a metre adds to the logarithms of the factors
        ("gyro_sampling", "f8"),  # variance of the yaw of a gyro that a metre adds [rad^2/m]
        ("variances", "f8", SENSOR_COUNT),  # of an entry of a sample of each sensor; 0: not used
        ("float_variance", "f8"),  # of an entry of a float solution
        ("patience", "f8", SENSOR_COUNT),  # for which the gate may reject a sensor [s]
        ("gates", "f8", SENSOR_COUNT),  # of the normalised squared innovation
        ("antenna_heights", "f8", 2),  # above the axle points [m]
        ("axle_height", "f8"),  # of the tractor's above the ground about which it rolls [m]
        ("axle_difference", "f8"),  # tractor's axle point above the trailer's [m]
        (
            "roll_levers",
            "f8",
            2,
        ),  # height of RJ1, with which roll of each body turns the trailer [m]
        ("roll_variance", "f8"),  # of a sample of roll [rad^2]
        ("memory_s", "f8"),
        ("unmodelled", "f8", STATES),  # variances of what no state follows, but of the speed's
        ("speed_unmodelled", "f8"),  # variance of the speed at 1 m/s and a factor of 1
        ("slope_per_slip", "f8"),  # slope that a side slip fixed in the map tells [rad/rad]
        ("line", "f8"),  # between both positions on a straight [m]
        ("side_per_slope", "f8"),  # side slip on a slope [rad/rad]
    ]
)
"""Record of a filter's constants: its vehicle and its noise."""


class GyroColumn(IntEnum):
    """Columns of the last sample of an IMU."""

    TIME_S = 0
    YAW_RATE = 1  # [rad/s]
    ROLL = 2  # [rad]
    PITCH = 3  # [rad]


GYRO: Final = len(GyroColumn)
"""Number of columns of the last sample of an IMU."""

SNAPSHOT: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("augmented", "f8", (LEVELS, WIDTH)),
        ("covariances", "f8", (LEVELS, SIZE, WIDTH)),
        ("scales", "f8", SCALES),  # learnt factors of the variances, see `NoiseScale`
        ("information", "f8", SCALES),  # on the logarithms of these factors
        ("valves", "f8", 2),  # set points of the steering valves [rad]
        ("rejected_since", "f8", SENSOR_COUNT),  # by the gate, without a break [s], or NaN
        ("gyros", "f8", (2, GYRO)),  # last sample of each IMU, see `GyroColumn`, or NaN
        ("slopes", "f8", (2, 2)),  # side slip on the slope that each IMU shows: east, north
    ]
)
"""Record of all that a filter carries from one time to the next."""

SNAPSHOT_SIZE: Final = SNAPSHOT.itemsize // 8


@cached_njit()
def matrix_row(matrix: int, rows: int, row: int) -> int:
    """Return where a row begins in a flat stack of matrices with `rows` rows of `WIDTH` entries."""
    return (matrix * rows + row) * WIDTH


def chi_square_limit(size: int, probability: float) -> float:
    """Return what the sum of the squares of one or two standard normal numbers exceeds so often.

    `scipy.special` has it for any size, and takes a seventh of the time to refuse a wrong path.
    """
    if size == 1:
        return NormalDist().inv_cdf(0.5 * probability) ** 2
    return -2.0 * math.log(probability)


def filter_parameters(
    vehicle: Vehicle,
    sensors: SensorNoise,
    process: ProcessNoise,
    gate_probability: float = 1e-4,
    memory_s: float = 2.5,
) -> FloatArray:
    """Return the record `FILTER` of a filter as a flat array.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.
        UnknownSensor: a sensor that the filter is to use has no measurement equation.
    """
    if not 0.0 < memory_s < math.inf:
        raise InvalidTuning(f"memory_s: got {memory_s}, must be finite and above 0")
    if not 0.0 < gate_probability < 1.0:
        raise InvalidTuning(f"gate_probability: got {gate_probability}, must be in (0, 1)")
    flat = np.zeros(FILTER.itemsize // 8)
    f = flat.view(FILTER)[0]
    f["vehicle"] = vehicle_parameters(vehicle, joint=not sensors.angle_offset)
    f["fading"] = process.fading(sensors).ravel()
    f["rates"] = process.rates(sensors)
    f["walk"] = process.scale_walk**2
    f["gyro_sampling"] = process.gyro_sampling**2
    f["memory_s"] = memory_s
    f["side_per_slope"] = process.side_per_slope

    # Sensors: their noise, the gate, and for how long it may reject
    f["variances"] = _variances(sensors)
    f["float_variance"] = sensors.gnss_float**2
    f["gates"] = [chi_square_limit(size, gate_probability) for size in INNOVATION_SIZES]
    f["patience"] = _PATIENCE_S
    if sensors.gnss_float > 0.0:
        receivers = [row.index for row in SENSORS if row.kind is SensorKind.POSITION]
        f["patience"][receivers] = _LONGER_PATIENCE_S
    f["antenna_heights"] = sensors.antenna_height_t, sensors.antenna_height_i

    # Roll moves the axle points sideways; a tool in the soil holds the trailer. RJ1 is taken to be
    # halfway between the heights of the axle points.
    joint_height = 0.5 * (vehicle.axle_height_t + vehicle.axle_height_i)
    f["axle_height"] = vehicle.axle_height_t
    f["axle_difference"] = vehicle.axle_height_t - vehicle.axle_height_i
    f["roll_levers"] = joint_height, 0.0 if vehicle.tool_behind else joint_height
    f["roll_variance"] = sensors.attitude**2

    # What no state follows. A bias of roll turns the line between both antennas for good.
    f["line"] = vehicle.hitch_offset + vehicle.drawbar_length + vehicle.trailer_length
    f["slope_per_slip"] = 1.0 / process.slip_per_slope
    f["unmodelled"][[State.X, State.Y]] = sensors.position_variance
    f["unmodelled"][State.PSI_I] = (sensors.lever_arm_bias / f["line"]) ** 2
    f["unmodelled"][State.DELTA_T] = sensors.angle_offset**2  # `STEERING` takes it up
    if sensors.angle_offset:
        f["unmodelled"][State.DELTA_I] = process.joint**2
    # The slip behind `slip_forward` is white in the model, and correlated over `bump_m` in truth.
    # Of variance s^2 and autocorrelation exp(-|x| / l) it has the density 2 l s^2 (Gelb 1974, 3.6).
    f["speed_unmodelled"] = process.slip_forward**2 / (2.0 * process.bump_m)
    return flat


def _variances(sensors: SensorNoise) -> list[float]:
    """Return the variance of each entry of a sample, of every sensor; 0 where it is not used.

    Raises:
        UnknownSensor: a sensor that the filter is to use has no measurement equation.
    """
    variances = []
    for row in SENSORS:
        if row.used_by_filter and row.index not in EQUATIONS:
            raise UnknownSensor(
                f"{row.sensor}: ttempc/sensors.py says that the filter uses it, but "
                "ttempc/models/measurement.py has no equation for it"
            )
        sd = sensors.of(row.sensor) if row.used_by_filter else 0.0
        variances.append(sd**2)
    return variances
