"""Augmented state of the estimators: the vehicle's state and its persistent disturbances."""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from ..jit import cached_njit, local, record
from ..jit.rows import WIDTH, add_row, clear_row, scale_row, set_row
from ..layout import ESTIMATE
from ..types import Disturbance, FloatArray, Input, MapDisturbance, State
from ..vehicle import Vehicle


class AugmentedState(IntEnum):
    """Index of each entry of an augmented state: `State` with the rim speed, then disturbances.

    The hydrostat drives the wheels, not the vehicle: the rim speed follows the hydrostat with the
    lag tau on any ground, and wheel slip lowers the vehicle's speed without delay. Disturbances
    that turn with the vehicle and disturbances that are fixed in the map have entries of their
    own, because a slope acts on a turning vehicle from a direction that changes all the time.
    """

    X = 0  # [m] tractor point, map frame
    Y = 1  # [m]
    PSI_T = 2  # [rad] yaw of the tractor
    PSI_I = 3  # [rad] yaw of the trailer
    DELTA_T = 4  # [rad] steering angle of the front wheels
    DELTA_I = 5  # [rad] steering angle of the trailer at RJ2
    RIM = 6  # [m/s] speed of the rim of the driven wheels
    SLIP_T = 7  # [rad] side slip of the rear axle, the part that turns with the vehicle
    SLIP_I = 8  # [rad] side slip of the trailer axle, likewise
    STEERING = 9  # [rad] front steering beside the measured angle
    DRIVE = 10  # [m/s^2] acceleration of the rim beside the hydrostat's
    WHEEL = 11  # wheel slip, see `Disturbance`, the part that turns with the vehicle
    SIDE_X = 12  # [rad] side slip of both axles, a vector in the map frame: east
    SIDE_Y = 13  # [rad] north
    CLIMB_X = 14  # wheel slip on the way east
    CLIMB_Y = 15  # wheel slip on the way north
    GNSS_X = 16  # [m] half the slow error of the trailer's receiver less the tractor's: east
    GNSS_Y = 17  # [m] north
    # [rad] offset of the sensor of the trailer's steering angle; without any, what loads turn the
    # joint beside its set point. That is a tenth of an offset: one entry for both
    OFFSET_I = 18
    OFFSET_HITCH = 19  # [rad] of the hitch angle; `STEERING` takes up that of the front
    GYRO_T = 20  # [rad/s] bias of the tractor's gyro
    GYRO_I = 21  # [rad/s] bias of the trailer's
    PAST_T = 22  # [rad] yaw of the tractor at the last sample of its gyro
    PAST_I = 23  # [rad] the same of the trailer


STATES: Final = len(State)
SIZE: Final = len(AugmentedState)
MAPPED: Final = 3
"""Number of disturbances that a map of the field may have, the first ones here and of
`Disturbance`: both side slips and the front steering. The others act along the path."""
_DISTURBANCES: Final = SIZE - STATES
_OF_MAP: Final = len(MapDisturbance)

DISTURBANCE_BOUND: Final[FloatArray] = np.array(
    [0.3, 0.3, 0.15, 0.5, 0.5, 0.2, 0.2, 0.3, 0.3, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1, np.inf, np.inf]
)
"""Largest magnitude of each disturbance, (17,): twice that of a vehicle that can be steered; of
sensors, more than any sensor in order has; none of the past yaw."""

_V_DEPENDS_ON: Final = (
    int(AugmentedState.PSI_T),
    int(AugmentedState.RIM),
    int(AugmentedState.WHEEL),
    int(AugmentedState.CLIMB_X),
    int(AugmentedState.CLIMB_Y),
)

INITIAL_SD: Final[FloatArray] = np.array([0.02, 0.02, 0.01, 0.03, 0.02, 0.01, 0.01, 0.03, 0.03])
"""Standard deviation of each disturbance of the vehicle before the first sample, (9,); assumed."""


def map_disturbance_gain(
    psi_t: float, psi_i: float, speed: float, yaw_rate: float, vehicle: Vehicle
) -> FloatArray:
    """Return d `Disturbance` / d `MapDisturbance`, (5, 4), at headings [rad] and speed [m/s].

    The signs change in reverse. With the wheel slip s = e(psi_t)'c the vehicle settles at
    rim - rim s and loses rim s' as it turns, so that to first order in s the drive disturbance is
    -v (s / tau + s'). `yaw_rate` is that of the tractor [rad/s].
    """
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    tau = vehicle.speed_time_constant
    by_climb = -speed * (cos / tau - yaw_rate * sin), -speed * (sin / tau + yaw_rate * cos)
    gain = [  # rows in the order of `Disturbance`
        [-sin, cos, 0.0, 0.0],
        [-math.sin(psi_i), math.cos(psi_i), 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, *by_climb],
        [0.0, 0.0, cos, sin],
    ]
    return math.copysign(1.0, speed) * np.array(gain)


@cached_njit(error_model="numpy")
def write_estimate(
    x: FloatArray, covariance: FloatArray, parameters: FloatArray, estimate: FloatArray
) -> None:
    """Write what an `ESTIMATE` has of an augmented state `x` (24,) and its `covariance` P (24, 24).

    The covariance of the state is J P J'; J picks the state (`State`) out of the augmented state,
    but for the speed, which depends on five entries. The drive disturbance of the estimate moves v
    as the rim speed, its disturbance and the wheel slip do together. `parameters` are (16,).
    """
    e = record(estimate, ESTIMATE)
    psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
    delta_i, rim = x[AugmentedState.DELTA_I], x[AugmentedState.RIM]
    gx, gy = x[AugmentedState.SIDE_X], x[AugmentedState.SIDE_Y]
    cx, cy = x[AugmentedState.CLIMB_X], x[AugmentedState.CLIMB_Y]
    cos, sin, gear = math.cos(psi_t), math.sin(psi_t), math.copysign(1.0, rim)
    cos_i, sin_i, psi_d = math.cos(psi_i), math.sin(psi_i), psi_i + delta_i
    wheel = x[AugmentedState.WHEEL] + gear * (cx * cos + cy * sin)
    slip_by_heading = gear * (cy * cos - cx * sin)  # ds / d(psi_t)
    v = rim * (1.0 - wheel)
    bias = x[AugmentedState.STEERING]
    yaw_rate = v * math.tan(x[AugmentedState.DELTA_T] + bias)
    yaw_rate /= parameters[VehicleParameter.WHEELBASE]
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    for i in range(STATES):
        e.state[i] = x[i]
    e.state[State.V] = v
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    e.trailer_xy[0] = x[0] - a * cos - d * math.cos(psi_d) - length_i * cos_i
    e.trailer_xy[1] = x[1] - a * sin - d * math.sin(psi_d) - length_i * sin_i
    e.hitch_angle = psi_t - psi_i - delta_i
    e.disturbance[Disturbance.SLIP_T] = x[AugmentedState.SLIP_T] + gear * (gy * cos - gx * sin)
    e.disturbance[Disturbance.SLIP_I] = x[AugmentedState.SLIP_I] + gear * (gy * cos_i - gx * sin_i)
    e.disturbance[Disturbance.STEERING] = bias
    slip_rate = slip_by_heading * yaw_rate  # s' [1/s]
    e.disturbance[Disturbance.DRIVE] = x[AugmentedState.DRIVE] - rim * (wheel / tau + slip_rate)
    e.disturbance[Disturbance.WHEEL] = wheel
    for i in range(_OF_MAP):
        e.map_disturbance[i] = x[AugmentedState.SIDE_X + i]
    slopes = (  # d v / d augmented, at `_V_DEPENDS_ON`
        -rim * slip_by_heading,
        1.0 - wheel,
        -rim,
        -abs(rim) * cos,
        -abs(rim) * sin,
    )
    variance = 0.0
    for i in range(State.V):
        total = 0.0
        for n in range(len(slopes)):
            k = _V_DEPENDS_ON[n]
            total += slopes[n] * 0.5 * (covariance[k, i] + covariance[i, k])
        e.covariance[State.V, i] = e.covariance[i, State.V] = total
        for j in range(State.V):
            e.covariance[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
    for n in range(len(slopes)):
        for m in range(len(slopes)):
            by = covariance[_V_DEPENDS_ON[n], _V_DEPENDS_ON[m]]
            variance += slopes[n] * slopes[m] * by
    e.covariance[State.V, State.V] = variance


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
    TRAILER_TURNING_OFFSET = 10
    DEAD_TIME_T = 11
    DEAD_TIME_I = 12
    DEAD_TIME_HP = 13
    REVERSE = 14  # 1 or 0
    JOINT = 15  # of a filter, not of a vehicle: 1 where `OFFSET_I` is of the joint, see there


def vehicle_parameters(vehicle: Vehicle, joint: bool = False) -> FloatArray:
    """Return the parameters of a vehicle in the order of `VehicleParameter`, (16,), SI units."""
    return np.array([getattr(vehicle, name, joint) for name in _PARAMETERS], dtype=float)


_PARAMETERS: Final = tuple(parameter.name.lower() for parameter in VehicleParameter)


@cached_njit(error_model="numpy")
def _steering(
    x: FloatArray, inputs: FloatArray, parameters: FloatArray, joint: int
) -> tuple[float, float]:
    """Return the rate of a steering angle [rad/s] and its derivative by the command [1/s].

    `joint` is 0 for the front wheels and 1 for RJ2.
    """
    lag = parameters[VehicleParameter.STEERING_LAG_T + joint]
    limit = parameters[VehicleParameter.STEERING_RATE_T + joint]
    rate = (inputs[joint] - x[AugmentedState.DELTA_T + joint]) / lag
    rate += joint * parameters[VehicleParameter.JOINT] * x[AugmentedState.OFFSET_I] / lag
    if abs(rate) >= limit:
        return math.copysign(limit, rate), 0.0
    return rate, 1.0 / lag


@cached_njit(error_model="numpy")
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
    turning = parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH] + turning
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    gear = math.copysign(1.0, rim)
    gx, gy = gear * x[AugmentedState.SIDE_X], gear * x[AugmentedState.SIDE_Y]
    cx, cy = gear * x[AugmentedState.CLIMB_X], gear * x[AugmentedState.CLIMB_Y]
    slip_t = x[AugmentedState.SLIP_T] - gx * sin_t + gy * cos_t
    slip_i = x[AugmentedState.SLIP_I] - gx * math.sin(psi_i) + gy * math.cos(psi_i)
    v = rim * (1.0 - x[AugmentedState.WHEEL] - cx * cos_t - cy * sin_t)
    lam = psi_t - psi_i
    cos_l, cos_i = math.cos(lam), math.cos(delta_i)
    rate_t, _ = _steering(x, inputs, parameters, 0)
    rate_i, _ = _steering(x, inputs, parameters, 1)
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


@cached_njit(error_model="numpy")
def state_rate_jacobian(
    x: FloatArray, inputs: FloatArray, parameters: FloatArray, jacobian: FloatArray
) -> None:
    """Write d `state_rate` / d x under `inputs` (3,) into `jacobian` (7, 24)."""
    psi_t, psi_i = x[AugmentedState.PSI_T], x[AugmentedState.PSI_I]
    delta_t, delta_i = x[AugmentedState.DELTA_T], x[AugmentedState.DELTA_I]
    rim = x[AugmentedState.RIM]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    turning = parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH] + turning
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
    _, gain_t = _steering(x, inputs, parameters, 0)
    rate_i, gain_i = _steering(x, inputs, parameters, 1)
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

    for i in range(STATES):
        for j in range(jacobian.shape[1]):
            jacobian[i, j] = 0.0
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
    beside = gain_i * parameters[VehicleParameter.JOINT]
    jacobian[AugmentedState.DELTA_I, AugmentedState.OFFSET_I] = beside
    jacobian[AugmentedState.PSI_I, AugmentedState.OFFSET_I] = yaw_i_rate * beside
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


@cached_njit(error_model="numpy")
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
    """Advance `x` (24,) and `valves` (2,) by `step_s` in place.

    The set points of the steering valves `valves` [rad] run to the `command` (3,) at their rate
    limit, and their mean over the step acts. The state takes one classical Runge-Kutta step.
    Disturbances fade by exp(-a step_s - b travel) with the halves a [1/s], b [1/m] of `fading`
    (34,). Written are the state in the `middle` of the step (24,), the `inputs` that act (3,) and
    the logarithm of the factor by which each disturbance fades, `faded` (17,).
    """
    inputs[Input.HP] = command[Input.HP]
    for i in range(2):
        reach = parameters[VehicleParameter.STEERING_RATE_T + i] * step_s
        after = min(max(command[i], valves[i] - reach), valves[i] + reach)
        inputs[i] = 0.5 * (valves[i] + after)
        valves[i] = after
    stage_x, rates = local((SIZE,)), local((4, STATES))
    for i in range(SIZE):
        stage_x[i] = middle[i] = x[i]
    state_rate(x, inputs, parameters, rates[0])
    for stage in range(3):
        duration = step_s if stage == 2 else 0.5 * step_s
        for i in range(STATES):
            stage_x[i] = x[i] + duration * rates[stage, i]
        state_rate(stage_x, inputs, parameters, rates[stage + 1])
    for i in range(STATES):
        change = step_s / 6.0 * (rates[0, i] + 2.0 * (rates[1, i] + rates[2, i]) + rates[3, i])
        middle[i] = x[i] + 0.5 * change
        x[i] += change
    travel = abs(middle[AugmentedState.RIM]) * step_s
    for j in range(SIZE - STATES):
        faded[j] = -fading[j] * step_s - fading[SIZE - STATES + j] * travel
        x[STATES + j] *= math.exp(faded[j])


@cached_njit(error_model="numpy")
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

    `transition` (24, 24), contiguous, is the exponential of the Jacobian in the middle of the step.
    `x` may have entries beside.
    """
    middle, inputs, faded = local((SIZE,)), local((3,)), local((_DISTURBANCES,))
    move_augmented_state(x, valves, command, parameters, fading, step_s, middle, inputs, faded)
    jacobian = local((STATES, WIDTH))
    state_rate_jacobian(middle, inputs, parameters, jacobian)

    # exp([[A, B], [0, F]]) by Horner's scheme, F diagonal: only the upper rows are full.
    previous, diagonal = local((STATES, WIDTH)), local((WIDTH,))
    clear_row(diagonal, 0)
    for i in range(SIZE):
        clear_row(transition, i * WIDTH)
        transition[i, i] = 1.0
    for term in range(_TERMS, 0, -1):
        for i in range(STATES):
            set_row(previous, i * WIDTH, 1.0, transition, i * WIDTH)
        for j in range(STATES, SIZE):
            diagonal[j] = transition[j, j]
        duration = step_s / term
        for i in range(STATES):
            set_row(transition, i * WIDTH, duration, jacobian, i * WIDTH)
            scale_row(transition, i * WIDTH, 1.0, diagonal, 0)
        for k in range(STATES):
            for i in range(STATES):
                if jacobian[i, k] != 0.0:
                    by = duration * jacobian[i, k]
                    add_row(transition, i * WIDTH, by, previous, k * WIDTH)
        for i in range(STATES):
            transition[i, i] += 1.0
        for j in range(STATES, SIZE):
            transition[j, j] = 1.0 + faded[j - STATES] * transition[j, j] / term
