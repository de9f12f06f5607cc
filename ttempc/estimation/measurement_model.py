"""Measurement models: the readings at a state, and the state from a set of readings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ..errors import UnknownSensor
from ..models.kinematics import wrap_angle
from ..types import FloatArray, Measurement, Sensor, State
from ..vehicle import Vehicle
from .augmented_state import SIZE
from .augmented_state_kernel import SensorIndex, measure, vehicle_parameters
from .noise import SensorNoise

LENGTH: Final = {
    Sensor.GNSS_TRACTOR: 2,
    Sensor.GNSS_TRAILER: 2,
    Sensor.STEERING_TRACTOR: 1,
    Sensor.STEERING_TRAILER: 1,
    Sensor.HITCH: 1,
    Sensor.ENCODER: 1,
}
"""Entries of a sample of each sensor with a model; estimators ignore the samples of all others."""

KERNEL_INDEX: Final = {sensor: int(SensorIndex[sensor.name]) for sensor in LENGTH}
"""`SensorIndex` of each of these sensors as a plain number, which numba compiles once."""

GYROS: Final = {s: int(SensorIndex[s.name]) for s in (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER)}
"""`SensorIndex` of the sensors whose yaw rate the filter uses where they are there."""

ANGLES: Final = frozenset({Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH})
"""Sensors whose readings are angles, equal modulo a turn."""


def predicted_measurement(
    sensor: Sensor, augmented: FloatArray, vehicle: Vehicle
) -> tuple[FloatArray, FloatArray]:
    """Return the noise-free reading h (m,) of `sensor` and its Jacobian (m, 22).

    Both at an augmented state (22,). The encoder reads the rim speed, the others geometry.

    Raises:
        UnknownSensor: the sensor has no model.
    """
    if sensor not in LENGTH:
        raise UnknownSensor(f"{sensor}: no model, there are those of {', '.join(LENGTH)}")
    reading, jacobian = np.zeros(2), np.zeros((2, SIZE))
    m = measure(
        KERNEL_INDEX[sensor], augmented, vehicle_parameters(vehicle), 0.0, reading, jacobian
    )
    return reading[:m], jacobian[:m]


def first_state(
    readings: Mapping[Sensor, Measurement], vehicle: Vehicle, noise: SensorNoise
) -> tuple[FloatArray, FloatArray]:
    """Return state (7,) and covariance (7, 7) from one reading of every sensor.

    The heading follows from the line between the two GNSS points: in the tractor's frame it is

        b = (a + d cos(beta) + L_i cos(beta + delta_i), -d sin(beta) - L_i sin(beta + delta_i)),

    so psi_t is the direction of the line less the direction of b. The covariance is that of the
    readings, carried through this map to first order. The standard deviation of a position that is
    older than the newest reading grows by the distance travelled since.
    """
    value = {sensor: reading.value for sensor, reading in readings.items()}
    (x, y), (x_i, y_i) = value[Sensor.GNSS_TRACTOR], value[Sensor.GNSS_TRAILER]
    (delta_t,), (delta_i,) = value[Sensor.STEERING_TRACTOR], value[Sensor.STEERING_TRAILER]
    (beta,), (v,) = value[Sensor.HITCH], value[Sensor.ENCODER]
    a, d, length_i = vehicle.hitch_offset, vehicle.drawbar_length, vehicle.trailer_length
    dx, dy = x - x_i, y - y_i
    trailer_x, trailer_y = length_i * math.cos(beta + delta_i), -length_i * math.sin(beta + delta_i)
    b_x, b_y = a + d * math.cos(beta) + trailer_x, trailer_y - d * math.sin(beta)
    psi_t = wrap_angle(math.atan2(dy, dx) - math.atan2(b_y, b_x))
    psi_i = psi_t - beta - delta_i
    state = np.array([x, y, psi_t, psi_i, delta_t, delta_i, v])

    line_squared, b_squared = dx**2 + dy**2, b_x**2 + b_y**2
    by_x, by_y = -dy / line_squared, dx / line_squared
    by_beta = (b_x * (b_x - a) + b_y * b_y) / b_squared  # minus d(direction of b) / d(beta)
    by_delta_i = (b_x * trailer_x + b_y * trailer_y) / b_squared
    # Columns: x, y, x_i, y_i, delta_t, delta_i, beta, v.
    jacobian = np.zeros((7, 8))
    jacobian[State.X, 0] = jacobian[State.Y, 1] = 1.0
    jacobian[State.PSI_T] = by_x, by_y, -by_x, -by_y, 0.0, by_delta_i, by_beta, 0.0
    jacobian[State.PSI_I] = jacobian[State.PSI_T]
    jacobian[State.PSI_I, 5:7] -= 1.0
    jacobian[State.DELTA_T, 4] = jacobian[State.DELTA_I, 5] = jacobian[State.V, 7] = 1.0

    newest = max(reading.time_s for reading in readings.values())
    variances: list[float] = []
    for sensor, length in LENGTH.items():
        travel = v * (newest - readings[sensor].time_s) if length == 2 else 0.0
        variances += [noise.of(sensor) ** 2 + travel**2] * length
    return state, (jacobian * variances) @ jacobian.T
