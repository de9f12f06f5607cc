"""Start of the filter: the first snapshot, from one reading of every sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...models.augmented_state import INITIAL_SD, SIZE, STATES, AugmentedState
from ...models.kinematics import wrap_angle
from ...sensors import ROW_OF, STARTING_SENSORS, Sensor, SensorKind
from ...types import FloatArray, Measurement, State
from ...vehicle import Vehicle
from ..noise import SCALES, ProcessNoise, SensorNoise
from .records import LEAST_VARIANCE, SNAPSHOT, SNAPSHOT_SIZE


class _Line(NamedTuple):
    """Line from the trailer point to the tractor point, as the angles at the joints bend it.

    In the tractor's frame it is

        b = (a + d cos(beta) + L_i cos(beta + delta_i), -d sin(beta) - L_i sin(beta + delta_i)).
    """

    x: float  # [m] b
    y: float
    trailer_x: float  # [m] share of the trailer behind RJ2 in b
    trailer_y: float
    hitch_x: float  # [m] share of the hitch offset a

    @classmethod
    def of(cls, beta: float, delta_i: float, vehicle: Vehicle) -> _Line:
        """Return the line at a hitch angle and a steering angle of the trailer [rad]."""
        a = vehicle.hitch_offset
        d = vehicle.drawbar_length
        trailer_x = vehicle.trailer_length * math.cos(beta + delta_i)
        trailer_y = -vehicle.trailer_length * math.sin(beta + delta_i)
        x = a + d * math.cos(beta) + trailer_x
        y = trailer_y - d * math.sin(beta)
        return cls(x, y, trailer_x, trailer_y, a)


def first_state(
    readings: Mapping[Sensor, Measurement], vehicle: Vehicle, noise: SensorNoise
) -> tuple[FloatArray, FloatArray]:
    """Return state (7,) and covariance (7, 7) from one reading of every sensor.

    The yaw of the tractor is the direction of the line between both GNSS points, less its direction
    b in the tractor's frame (`_Line`). The covariance is that of the readings, carried through this
    map to first order. The standard deviation of a position that is older than the newest reading
    grows by the distance travelled since.
    """
    value = {sensor: reading.value for sensor, reading in readings.items()}
    x, y = value[Sensor.GNSS_TRACTOR]
    x_i, y_i = value[Sensor.GNSS_TRAILER]
    (delta_t,) = value[Sensor.STEERING_TRACTOR]
    (delta_i,) = value[Sensor.STEERING_TRAILER]
    (beta,) = value[Sensor.HITCH]
    (v,) = value[Sensor.ENCODER]
    line = _Line.of(beta, delta_i, vehicle)
    dx = x - x_i
    dy = y - y_i
    psi_t = wrap_angle(math.atan2(dy, dx) - math.atan2(line.y, line.x))
    psi_i = psi_t - beta - delta_i
    state = np.array([x, y, psi_t, psi_i, delta_t, delta_i, v])
    jacobian = _first_state_jacobian(dx, dy, line)
    return state, (jacobian * _reading_variances(readings, v, noise)) @ jacobian.T


def _first_state_jacobian(dx: float, dy: float, line: _Line) -> FloatArray:
    """Return the derivatives of the first state by the readings, (7, 8).

    Columns: x, y, x_i, y_i, delta_t, delta_i, beta, v.
    """
    x, y, x_i, y_i, delta_t, delta_i, beta, v = range(8)
    distance_squared = dx**2 + dy**2
    by_x = -dy / distance_squared  # of the line's direction in the map
    by_y = dx / distance_squared
    # Of the direction of b in the tractor's frame, with the other sign
    b_squared = line.x**2 + line.y**2
    by_beta = (line.x * (line.x - line.hitch_x) + line.y * line.y) / b_squared
    by_delta_i = (line.x * line.trailer_x + line.y * line.trailer_y) / b_squared

    jacobian = np.zeros((7, 8))
    jacobian[State.X, x] = 1.0
    jacobian[State.Y, y] = 1.0
    jacobian[State.PSI_T, [x, y]] = by_x, by_y
    jacobian[State.PSI_T, [x_i, y_i]] = -by_x, -by_y
    jacobian[State.PSI_T, [delta_i, beta]] = by_delta_i, by_beta
    jacobian[State.PSI_I] = jacobian[State.PSI_T]
    jacobian[State.PSI_I, [delta_i, beta]] -= 1.0
    jacobian[State.DELTA_T, delta_t] = 1.0
    jacobian[State.DELTA_I, delta_i] = 1.0
    jacobian[State.V, v] = 1.0
    return jacobian


def _reading_variances(
    readings: Mapping[Sensor, Measurement], v: float, noise: SensorNoise
) -> list[float]:
    """Return the variances of the readings of all starting sensors, entry by entry, (8,)."""
    newest = max(reading.time_s for reading in readings.values())
    variances: list[float] = []
    for sensor in STARTING_SENSORS:
        row = ROW_OF[sensor]
        travel = 0.0
        if row.kind is SensorKind.POSITION:
            travel = v * (newest - readings[sensor].time_s)
        offset = 0.0
        if sensor in (Sensor.STEERING_TRAILER, Sensor.HITCH):
            offset = noise.angle_offset
        variances += [noise.of(sensor) ** 2 + travel**2 + offset**2] * row.length
    return variances


def initial_snapshot(
    readings: Mapping[Sensor, Measurement],
    vehicle: Vehicle,
    sensors: SensorNoise,
    process: ProcessNoise,
) -> FloatArray:
    """Return the `SNAPSHOT` that follows from one reading of every sensor, flat.

    It is at the time of the newest of them.
    """
    state, covariance = first_state(readings, vehicle, replace(sensors, gnss_white_share=1.0))
    variances = np.empty(SIZE)
    variances[STATES : STATES + len(INITIAL_SD)] = INITIAL_SD**2
    slow_difference = max(sensors.difference_variance, LEAST_VARIANCE)
    variances[[AugmentedState.GNSS_X, AugmentedState.GNSS_Y]] = slow_difference
    variances[AugmentedState.OFFSET_I] = sensors.angle_offset**2 or process.joint**2
    variances[AugmentedState.OFFSET_HITCH] = max(sensors.angle_offset**2, LEAST_VARIANCE)
    gyro_bias = max(sensors.yaw_rate_bias**2, LEAST_VARIANCE)
    variances[[AugmentedState.GYRO_T, AugmentedState.GYRO_I]] = gyro_bias
    variances[[AugmentedState.PAST_T, AugmentedState.PAST_I]] = LEAST_VARIANCE

    flat = np.zeros(SNAPSHOT_SIZE)
    start = flat.view(SNAPSHOT)[0]
    start["time_s"] = max(reading.time_s for reading in readings.values())
    start["augmented"][0, :STATES] = state
    disturbances = range(STATES, SIZE)
    start["covariances"][0, disturbances, disturbances] = variances[STATES:]
    start["covariances"][0, :STATES, :STATES] = covariance
    start["scales"] = process.scales
    start["information"] = np.full(SCALES, process.scale_sd**-2)
    start["valves"] = state[AugmentedState.DELTA_T : AugmentedState.WHEEL_SPEED]
    start["rejected_since"] = math.nan
    start["gyros"] = math.nan
    return flat
