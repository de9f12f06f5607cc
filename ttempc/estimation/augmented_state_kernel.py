"""Model and measurements of the augmented state, compiled, with their Jacobians.

Arrays named `x` are augmented states (22,) in the order of `AugmentedState`, those named
`parameters` are (10,) in the order of `VehicleParameter`.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray, Input
from ..vehicle import Vehicle
from .augmented_state import SIZE, STATES, AugmentedState

_TERMS: Final = 4  # of the exponential's series: enough for a third of a lag


class VehicleParameter(IntEnum):
    """Index of each vehicle parameter that the kernels read; the names are fields of `Vehicle`."""

    WHEELBASE = 0
    HITCH_OFFSET = 1
    DRAWBAR_LENGTH = 2
    TRAILER_LENGTH = 3
    SPEED_GAIN = 4
    SPEED_TIME_CONSTANT = 5
    STEERING_LAG_T = 6
    STEERING_LAG_I = 7
    STEERING_RATE_T = 8
    STEERING_RATE_I = 9


class SensorIndex(IntEnum):
    """Number of each sensor in the kernels; the names are those of `Sensor`."""

    GNSS_TRACTOR = 0
    GNSS_TRAILER = 1
    STEERING_TRACTOR = 2
    STEERING_TRAILER = 3
    HITCH = 4
    ENCODER = 5
    IMU_TRACTOR = 6
    IMU_TRAILER = 7


def vehicle_parameters(vehicle: Vehicle) -> FloatArray:
    """Return the parameters of a vehicle in the order of `VehicleParameter`, (10,), SI units."""
    return np.array([getattr(vehicle, parameter.name.lower()) for parameter in VehicleParameter])


@cached_njit()
def _steering(command: float, angle: float, lag: float, limit: float) -> tuple[float, float]:
    """Return the rate of a steering angle [rad/s] and its derivative by the command [1/s]."""
    rate = (command - angle) / lag
    if abs(rate) >= limit:
        return math.copysign(limit, rate), 0.0
    return rate, 1.0 / lag


@cached_njit()
def state_rate(x: FloatArray, inputs: FloatArray, parameters: FloatArray, rate: FloatArray) -> None:
    """Write dx/dt of the first seven entries under `inputs` (3,) into `rate` (7,).

    The model is `articulated` with the total slips, v = rim (1 - s) and
    rim' = (K hp - rim) / tau + w. The disturbances are constant.
    """
    psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
    delta_t, delta_i = x[AugmentedState.DELTA_T], x[AugmentedState.DELTA_I]
    rim = x[AugmentedState.RIM]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    gear = math.copysign(1.0, rim)
    gx, gy = gear * x[AugmentedState.SIDE_X], gear * x[AugmentedState.SIDE_Y]
    cx, cy = gear * x[AugmentedState.CLIMB_X], gear * x[AugmentedState.CLIMB_Y]
    slip_t = x[AugmentedState.SLIP_T] - gx * sin_t + gy * cos_t
    slip_i = x[AugmentedState.SLIP_I] - gx * math.sin(psi_i) + gy * math.cos(psi_i)
    v = rim * (1.0 - x[AugmentedState.WHEEL] - cx * cos_t - cy * sin_t)
    lam = psi_t - psi_i
    cos_l, cos_i = math.cos(lam), math.cos(delta_i)
    rate_t, _ = _steering(
        inputs[Input.DELTA_T],
        delta_t,
        parameters[VehicleParameter.STEERING_LAG_T],
        parameters[VehicleParameter.STEERING_RATE_T],
    )
    rate_i, _ = _steering(
        inputs[Input.DELTA_I],
        delta_i,
        parameters[VehicleParameter.STEERING_LAG_I],
        parameters[VehicleParameter.STEERING_RATE_I],
    )
    yaw_t = v * math.tan(delta_t + x[AugmentedState.STEERING]) / wheelbase
    across = v * (math.sin(lam) + slip_t * cos_l - slip_i) - a * yaw_t * cos_l
    steady_rim = parameters[VehicleParameter.SPEED_GAIN] * inputs[Input.HP]
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    rate[AugmentedState.X] = v * (cos_t - slip_t * sin_t)
    rate[AugmentedState.Y] = v * (sin_t + slip_t * cos_t)
    rate[AugmentedState.PSI_T] = yaw_t
    rate[AugmentedState.PSI_I] = (across - d * rate_i * cos_i) / (length_i + d * cos_i)
    rate[AugmentedState.DELTA_T] = rate_t
    rate[AugmentedState.DELTA_I] = rate_i
    rate[AugmentedState.RIM] = (steady_rim - rim) / tau + x[AugmentedState.DRIVE]


@cached_njit()
def state_rate_jacobian(
    x: FloatArray, inputs: FloatArray, parameters: FloatArray, jacobian: FloatArray
) -> None:
    """Write d `state_rate` / d x under `inputs` (3,) into `jacobian` (7, 22)."""
    psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
    delta_t, delta_i = x[AugmentedState.DELTA_T], x[AugmentedState.DELTA_I]
    rim = x[AugmentedState.RIM]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    sin_p, cos_p = math.sin(psi_i), math.cos(psi_i)
    gear = math.copysign(1.0, rim)
    gx, gy = gear * x[AugmentedState.SIDE_X], gear * x[AugmentedState.SIDE_Y]
    cx, cy = gear * x[AugmentedState.CLIMB_X], gear * x[AugmentedState.CLIMB_Y]
    slip_t = x[AugmentedState.SLIP_T] - gx * sin_t + gy * cos_t
    slip_i = x[AugmentedState.SLIP_I] - gx * sin_p + gy * cos_p
    speed_ratio = 1.0 - x[AugmentedState.WHEEL] - cx * cos_t - cy * sin_t  # v / rim
    v = rim * speed_ratio
    lam = psi_t - psi_i
    sin_l, cos_l = math.sin(lam), math.cos(lam)
    sin_i, cos_i = math.sin(delta_i), math.cos(delta_i)
    _, gain_t = _steering(
        inputs[Input.DELTA_T],
        delta_t,
        parameters[VehicleParameter.STEERING_LAG_T],
        parameters[VehicleParameter.STEERING_RATE_T],
    )
    rate_i, gain_i = _steering(
        inputs[Input.DELTA_I],
        delta_i,
        parameters[VehicleParameter.STEERING_LAG_I],
        parameters[VehicleParameter.STEERING_RATE_I],
    )
    angle = delta_t + x[AugmentedState.STEERING]
    yaw_t_v = math.tan(angle) / wheelbase
    yaw_t_delta = v / (wheelbase * math.cos(angle) ** 2)
    arm = length_i + d * cos_i
    yaw_i_v = (sin_l + slip_t * cos_l - slip_i - a * yaw_t_v * cos_l) / arm
    yaw_i = v * yaw_i_v - d * rate_i * cos_i / arm
    yaw_i_lam = v * (cos_l - slip_t * sin_l + a * yaw_t_v * sin_l) / arm
    yaw_i_delta_t = -a * yaw_t_delta * cos_l / arm
    yaw_i_rate = -d * cos_i / arm
    yaw_i_delta_i = d * sin_i * (rate_i + yaw_i) / arm - yaw_i_rate * gain_i

    jacobian[:, :] = 0.0
    jacobian[AugmentedState.X, AugmentedState.PSI_T] = -v * (sin_t + slip_t * cos_t)
    jacobian[AugmentedState.Y, AugmentedState.PSI_T] = v * (cos_t - slip_t * sin_t)
    jacobian[AugmentedState.PSI_T, AugmentedState.DELTA_T] = yaw_t_delta
    jacobian[AugmentedState.PSI_T, AugmentedState.STEERING] = yaw_t_delta
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_T] = yaw_i_lam
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_I] = -yaw_i_lam
    jacobian[AugmentedState.PSI_I, AugmentedState.DELTA_T] = yaw_i_delta_t
    jacobian[AugmentedState.PSI_I, AugmentedState.STEERING] = yaw_i_delta_t
    jacobian[AugmentedState.PSI_I, AugmentedState.DELTA_I] = yaw_i_delta_i
    jacobian[AugmentedState.DELTA_T, AugmentedState.DELTA_T] = -gain_t
    jacobian[AugmentedState.DELTA_I, AugmentedState.DELTA_I] = -gain_i
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    jacobian[AugmentedState.RIM, AugmentedState.RIM] = -1.0 / tau
    jacobian[AugmentedState.RIM, AugmentedState.DRIVE] = 1.0
    # Through the speed v = rim * speed_ratio, and through the side slips.
    by_v = (cos_t - slip_t * sin_t, sin_t + slip_t * cos_t, yaw_t_v, yaw_i_v)
    by_slip_t = (-v * sin_t, v * cos_t, 0.0, v * cos_l / arm)
    by_slip_i = -v / arm
    v_psi = rim * (cx * sin_t - cy * cos_t)
    slip_t_psi = -gx * cos_t - gy * sin_t
    for row in range(4):  # x, y, psi_t, psi_i
        jacobian[row, AugmentedState.PSI_T] += by_v[row] * v_psi + by_slip_t[row] * slip_t_psi
        jacobian[row, AugmentedState.RIM] = by_v[row] * speed_ratio
        jacobian[row, AugmentedState.SLIP_T] = by_slip_t[row]
        jacobian[row, AugmentedState.WHEEL] = -by_v[row] * rim
        jacobian[row, AugmentedState.SIDE_X] = -gear * by_slip_t[row] * sin_t
        jacobian[row, AugmentedState.SIDE_Y] = gear * by_slip_t[row] * cos_t
        jacobian[row, AugmentedState.CLIMB_X] = -gear * by_v[row] * rim * cos_t
        jacobian[row, AugmentedState.CLIMB_Y] = -gear * by_v[row] * rim * sin_t
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_I] += by_slip_i * (-gx * cos_p - gy * sin_p)
    jacobian[AugmentedState.PSI_I, AugmentedState.SLIP_I] = by_slip_i
    jacobian[AugmentedState.PSI_I, AugmentedState.SIDE_X] -= gear * by_slip_i * sin_p
    jacobian[AugmentedState.PSI_I, AugmentedState.SIDE_Y] += gear * by_slip_i * cos_p


@cached_njit()
def move_augmented_state(
    x: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    parameters: FloatArray,
    fading: FloatArray,
    step_s: float,
    middle: FloatArray,
    inputs: FloatArray,
    faded: FloatArray,
) -> None:
    """Advance `x` (22,) and `valves` (2,) by `step_s` in place.

    The set points of the steering valves `valves` [rad] run to the `command` (3,) at their rate
    limit, and their mean over the step acts. The state takes one classical Runge-Kutta step.
    Disturbances fade by exp(-a step_s - b travel) with the rows a [1/s], b [1/m] of `fading`
    (2, 15). Written are the state in the `middle` of the step (22,), the `inputs` that act (3,) and
    the logarithm of the factor by which each disturbance fades, `faded` (15,).
    """
    inputs[Input.HP] = command[Input.HP]
    for i in range(2):
        reach = parameters[VehicleParameter.STEERING_RATE_T + i] * step_s
        after = min(max(command[i], valves[i] - reach), valves[i] + reach)
        inputs[i] = 0.5 * (valves[i] + after)
        valves[i] = after
    stage_x = x.copy()
    rates = np.empty((4, STATES))
    state_rate(x, inputs, parameters, rates[0])
    for stage in range(3):
        duration = step_s if stage == 2 else 0.5 * step_s
        for i in range(STATES):
            stage_x[i] = x[i] + duration * rates[stage, i]
        state_rate(stage_x, inputs, parameters, rates[stage + 1])
    middle[:] = x
    for i in range(STATES):
        change = step_s / 6.0 * (rates[0, i] + 2.0 * (rates[1, i] + rates[2, i]) + rates[3, i])
        middle[i] = x[i] + 0.5 * change
        x[i] += change
    travel = abs(middle[AugmentedState.RIM]) * step_s
    for j in range(SIZE - STATES):
        faded[j] = -fading[0, j] * step_s - fading[1, j] * travel
        x[STATES + j] *= math.exp(faded[j])


@cached_njit()
def advance_augmented_state(
    x: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    parameters: FloatArray,
    fading: FloatArray,
    step_s: float,
    transition: FloatArray,
) -> None:
    """Advance `x` and `valves` as `move_augmented_state`; write d after / d before.

    `transition` (22, 22) is the exponential of the Jacobian in the middle of the step.
    """
    middle, inputs, faded = np.empty(SIZE), np.empty(3), np.empty(SIZE - STATES)
    move_augmented_state(x, valves, command, parameters, fading, step_s, middle, inputs, faded)
    jacobian = np.empty((STATES, SIZE))
    state_rate_jacobian(middle, inputs, parameters, jacobian)

    size = len(transition)  # no constant, see `correct`
    # exp([[A, B], [0, F]]) by Horner's scheme, F diagonal: only the upper rows are full.
    transition[:, :] = 0.0
    for i in range(size):
        transition[i, i] = 1.0
    previous = np.empty((STATES, SIZE))
    for term in range(_TERMS, 0, -1):
        previous[:, :] = transition[:STATES]
        duration = step_s / term
        for i in range(STATES):
            for j in range(size):
                transition[i, j] = jacobian[i, j] * transition[j, j] if j >= STATES else 0.0
            for k in range(STATES):
                if jacobian[i, k] != 0.0:
                    for j in range(size):
                        transition[i, j] += jacobian[i, k] * previous[k, j]
            for j in range(size):
                transition[i, j] *= duration
        for i in range(STATES):
            transition[i, i] += 1.0
        for j in range(STATES, size):
            transition[j, j] = 1.0 + faded[j - STATES] * transition[j, j] / term


@cached_njit()
def measure(
    sensor: int,
    x: FloatArray,
    parameters: FloatArray,
    span_s: float,
    reading: FloatArray,
    jacobian: FloatArray,
) -> int:
    """Write the noise-free reading (2,) of a sensor and d reading / d x (2, 22).

    Returns the number of entries of the reading, 1 or 2. `sensor` is a `SensorIndex` as a number.
    The reading of a gyro is the integral of its yaw rate over the time `span_s` since its last
    sample; the other sensors do not need it.
    """
    jacobian[:, :] = 0.0
    error_x, error_y = x[AugmentedState.GNSS_X], x[AugmentedState.GNSS_Y]
    if sensor == SensorIndex.GNSS_TRACTOR:
        reading[0], reading[1] = x[AugmentedState.X] - error_x, x[AugmentedState.Y] - error_y
        jacobian[0, AugmentedState.X] = jacobian[1, AugmentedState.Y] = 1.0
        jacobian[0, AugmentedState.GNSS_X] = jacobian[1, AugmentedState.GNSS_Y] = -1.0
        return 2
    if sensor == SensorIndex.GNSS_TRAILER:
        psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
        psi_d = psi_i + x[AugmentedState.DELTA_I]
        a = parameters[VehicleParameter.HITCH_OFFSET]
        d = parameters[VehicleParameter.DRAWBAR_LENGTH]
        length_i = parameters[VehicleParameter.TRAILER_LENGTH]
        drawbar_x, drawbar_y = d * math.sin(psi_d), -d * math.cos(psi_d)
        trailer_x, trailer_y = length_i * math.sin(psi_i), -length_i * math.cos(psi_i)
        tractor_x, tractor_y = a * math.sin(psi_t), -a * math.cos(psi_t)
        reading[0] = x[AugmentedState.X] + tractor_y + drawbar_y + trailer_y + error_x
        reading[1] = x[AugmentedState.Y] - tractor_x - drawbar_x - trailer_x + error_y
        jacobian[0, AugmentedState.GNSS_X] = jacobian[1, AugmentedState.GNSS_Y] = 1.0
        jacobian[0, AugmentedState.X] = jacobian[1, AugmentedState.Y] = 1.0
        jacobian[0, AugmentedState.PSI_T] = tractor_x
        jacobian[1, AugmentedState.PSI_T] = tractor_y
        jacobian[0, AugmentedState.PSI_I] = drawbar_x + trailer_x
        jacobian[1, AugmentedState.PSI_I] = drawbar_y + trailer_y
        jacobian[0, AugmentedState.DELTA_I] = drawbar_x
        jacobian[1, AugmentedState.DELTA_I] = drawbar_y
        return 2
    if sensor == SensorIndex.HITCH:
        psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
        reading[0] = psi_t - psi_i - x[AugmentedState.DELTA_I]
        jacobian[0, AugmentedState.PSI_T] = 1.0
        jacobian[0, AugmentedState.PSI_I] = -1.0
        jacobian[0, AugmentedState.DELTA_I] = -1.0
        return 1
    if sensor == SensorIndex.IMU_TRACTOR or sensor == SensorIndex.IMU_TRAILER:
        body = sensor - SensorIndex.IMU_TRACTOR
        psi, past = AugmentedState.PSI_T + body, AugmentedState.PAST_T + body
        bias = AugmentedState.GYRO_T + body
        reading[0] = x[psi] - x[past] + span_s * x[bias]
        jacobian[0, psi], jacobian[0, past], jacobian[0, bias] = 1.0, -1.0, span_s
        return 1
    if sensor == SensorIndex.STEERING_TRACTOR:
        entry = AugmentedState.DELTA_T
    elif sensor == SensorIndex.STEERING_TRAILER:
        entry = AugmentedState.DELTA_I
    else:
        entry = AugmentedState.RIM
    reading[0] = x[entry]
    jacobian[0, entry] = 1.0
    return 1
