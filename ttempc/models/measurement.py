"""Measurement equations of the augmented state: noise-free readings and their Jacobians.

An equation writes the reading h(x) and the entries of H = dh/dx that are not 0. Positions are in
the map frame [m], angles in [rad], speeds in [m/s]. `x` is an `AugmentedState`.
"""

import math
from typing import Final

from ..jit import cached_njit
from ..sensors import SENSOR_BODIES, SensorIndex
from ..types import FloatArray
from .augmented_state import AugmentedState, VehicleParameter

EQUATIONS: Final = frozenset(
    {
        SensorIndex.GNSS_TRACTOR,
        SensorIndex.GNSS_TRAILER,
        SensorIndex.STEERING_TRACTOR,
        SensorIndex.STEERING_TRAILER,
        SensorIndex.HITCH,
        SensorIndex.ENCODER,
        SensorIndex.IMU_TRACTOR,
        SensorIndex.IMU_TRAILER,
    }
)
"""Sensors for which `measure` has an equation."""


@cached_njit(error_model="numpy")
def measure(
    sensor: int,
    x: FloatArray,
    parameters: FloatArray,
    span_s: float,
    reading: FloatArray,
    jacobian: FloatArray,
) -> int:
    """Write the noise-free reading (2,) of a sensor and d reading / d x (2, 24).

    Returns the number of entries of the reading, 1 or 2, and 0 for a sensor without an equation.
    `sensor` is a `SensorIndex` as a number. The reading of an IMU is the integral of its yaw rate
    over the time `span_s` since its last sample; the other sensors do not need it.
    """
    for j in range(jacobian.shape[1]):
        jacobian[0, j] = 0.0
        jacobian[1, j] = 0.0
    if sensor == SensorIndex.GNSS_TRACTOR:
        _measure_tractor_point(x, reading, jacobian)
        return 2
    if sensor == SensorIndex.GNSS_TRAILER:
        _measure_trailer_point(x, parameters, reading, jacobian)
        return 2
    if sensor == SensorIndex.STEERING_TRACTOR:
        reading[0] = x[AugmentedState.DELTA_T]
        jacobian[0, AugmentedState.DELTA_T] = 1.0
        return 1
    if sensor == SensorIndex.STEERING_TRAILER:
        _measure_trailer_steering(x, parameters, reading, jacobian)
        return 1
    if sensor == SensorIndex.HITCH:
        _measure_hitch_angle(x, reading, jacobian)
        return 1
    if sensor == SensorIndex.ENCODER:
        reading[0] = x[AugmentedState.WHEEL_SPEED]
        jacobian[0, AugmentedState.WHEEL_SPEED] = 1.0
        return 1
    if sensor == SensorIndex.IMU_TRACTOR or sensor == SensorIndex.IMU_TRAILER:
        _measure_turned_angle(SENSOR_BODIES[sensor], x, span_s, reading, jacobian)
        return 1
    return 0


@cached_njit(error_model="numpy")
def _measure_tractor_point(x: FloatArray, reading: FloatArray, jacobian: FloatArray) -> None:
    """Write the position of the tractor point less half the slow difference of the receivers."""
    reading[0] = x[AugmentedState.X] - x[AugmentedState.GNSS_X]
    reading[1] = x[AugmentedState.Y] - x[AugmentedState.GNSS_Y]
    jacobian[0, AugmentedState.X] = 1.0
    jacobian[1, AugmentedState.Y] = 1.0
    jacobian[0, AugmentedState.GNSS_X] = -1.0
    jacobian[1, AugmentedState.GNSS_Y] = -1.0


@cached_njit(error_model="numpy")
def _measure_trailer_point(
    x: FloatArray, parameters: FloatArray, reading: FloatArray, jacobian: FloatArray
) -> None:
    """Write the position of the trailer point plus half the slow difference of the receivers.

    It is p_i = p_t - a e(psi_t) - d e(psi_d) - L_i e(psi_i) with psi_d = psi_i + delta_i and the
    unit vector e(psi) along a heading. Each body turns its part: d e(psi) / d psi = n(psi), the
    unit vector to the left.
    """
    psi_t = x[AugmentedState.PSI_T]
    psi_i = x[AugmentedState.PSI_I]
    psi_d = psi_i + x[AugmentedState.DELTA_I]
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]

    # -a n(psi_t), -d n(psi_d), -L_i n(psi_i): how the trailer point moves as each body turns
    tractor_x = a * math.sin(psi_t)
    tractor_y = -a * math.cos(psi_t)
    drawbar_x = d * math.sin(psi_d)
    drawbar_y = -d * math.cos(psi_d)
    trailer_x = length_i * math.sin(psi_i)
    trailer_y = -length_i * math.cos(psi_i)

    reading[0] = x[AugmentedState.X] + tractor_y + drawbar_y + trailer_y + x[AugmentedState.GNSS_X]
    reading[1] = x[AugmentedState.Y] - tractor_x - drawbar_x - trailer_x + x[AugmentedState.GNSS_Y]
    jacobian[0, AugmentedState.X] = 1.0
    jacobian[1, AugmentedState.Y] = 1.0
    jacobian[0, AugmentedState.GNSS_X] = 1.0
    jacobian[1, AugmentedState.GNSS_Y] = 1.0
    jacobian[0, AugmentedState.PSI_T] = tractor_x
    jacobian[1, AugmentedState.PSI_T] = tractor_y
    jacobian[0, AugmentedState.PSI_I] = drawbar_x + trailer_x
    jacobian[1, AugmentedState.PSI_I] = drawbar_y + trailer_y
    jacobian[0, AugmentedState.DELTA_I] = drawbar_x
    jacobian[1, AugmentedState.DELTA_I] = drawbar_y


@cached_njit(error_model="numpy")
def _measure_trailer_steering(
    x: FloatArray, parameters: FloatArray, reading: FloatArray, jacobian: FloatArray
) -> None:
    """Write the trailer's steering angle with the offset of its sensor.

    Where `VehicleParameter.JOINT` is 1, `OFFSET_I` is an angle of the joint, not of the sensor.
    """
    offset_share = 1.0 - parameters[VehicleParameter.JOINT]
    reading[0] = x[AugmentedState.DELTA_I]
    reading[0] += offset_share * x[AugmentedState.OFFSET_I]
    jacobian[0, AugmentedState.DELTA_I] = 1.0
    jacobian[0, AugmentedState.OFFSET_I] = offset_share


@cached_njit(error_model="numpy")
def _measure_hitch_angle(x: FloatArray, reading: FloatArray, jacobian: FloatArray) -> None:
    """Write the hitch angle beta = psi_t - psi_i - delta_i with the offset of its sensor."""
    beta = x[AugmentedState.PSI_T] - x[AugmentedState.PSI_I] - x[AugmentedState.DELTA_I]
    reading[0] = beta + x[AugmentedState.OFFSET_HITCH]
    jacobian[0, AugmentedState.PSI_T] = 1.0
    jacobian[0, AugmentedState.PSI_I] = -1.0
    jacobian[0, AugmentedState.DELTA_I] = -1.0
    jacobian[0, AugmentedState.OFFSET_HITCH] = 1.0


@cached_njit(error_model="numpy")
def _measure_turned_angle(
    body: int, x: FloatArray, span_s: float, reading: FloatArray, jacobian: FloatArray
) -> None:
    """Write the angle that a gyro integrates over `span_s`: the turn of its body and its bias."""
    psi = AugmentedState.PSI_T + body
    past = AugmentedState.PAST_T + body
    bias = AugmentedState.GYRO_T + body
    reading[0] = x[psi] - x[past] + span_s * x[bias]
    jacobian[0, psi] = 1.0
    jacobian[0, past] = -1.0
    jacobian[0, bias] = span_s
