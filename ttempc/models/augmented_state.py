"""Augmented state of the estimators: the vehicle's state and its persistent disturbances."""

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit, local, record
from ..jit.rows import WIDTH, add_row, clear_row, scale_row, set_row
from ..layout import ESTIMATE
from ..types import Disturbance, FloatArray, Input, MapDisturbance, State
from ..vehicle import Vehicle


class AugmentedState(IntEnum):
    """Index of each entry of an augmented state: `State` with the wheel speed, then disturbances.

    The hydrostat drives the wheels, not the vehicle: the wheel speed follows the hydrostat with the
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
    WHEEL_SPEED = 6  # [m/s] circumferential speed of the driven wheels
    SLIP_T = 7  # [rad] side slip of the rear axle, the part that turns with the vehicle
    SLIP_I = 8  # [rad] side slip of the trailer axle, the part that turns with the vehicle
    STEERING = 9  # [rad] added to the measured front steering angle
    DRIVE = 10  # [m/s^2] acceleration of the wheels, added to the hydrostat's
    WHEEL = 11  # wheel slip, see `Disturbance`, the part that turns with the vehicle
    SIDE_X = 12  # [rad] side slip of both axles, a vector in the map frame: east
    SIDE_Y = 13  # [rad] north
    CLIMB_X = 14  # wheel slip of a vehicle that drives east
    CLIMB_Y = 15  # wheel slip of a vehicle that drives north
    GNSS_X = 16  # [m] half the slow error of the trailer's receiver less the tractor's: east
    GNSS_Y = 17  # [m] north
    # [rad] offset of the sensor of the trailer's steering angle; where there is none, the angle by
    # which loads turn the joint off its set point. That is a tenth of an offset: one entry
    # serves both, see `VehicleParameter.JOINT`
    OFFSET_I = 18
    OFFSET_HITCH = 19  # [rad] offset of the hitch sensor; `STEERING` takes up the front sensor's
    GYRO_T = 20  # [rad/s] bias of the tractor's gyro
    GYRO_I = 21  # [rad/s] bias of the trailer's
    PAST_T = 22  # [rad] yaw of the tractor at the last sample of its gyro
    PAST_I = 23  # [rad] yaw of the trailer at the last sample of its gyro


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
    int(AugmentedState.WHEEL_SPEED),
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

    The signs change in reverse. With the wheel slip s = e(psi_t)'c and the wheel speed v_w the
    vehicle settles at v_w - v_w s and loses v_w s' as it turns, so that to first order in s the
    drive disturbance is -v (s / tau + s'). `yaw_rate` is that of the tractor [rad/s].
    """
    cos = math.cos(psi_t)
    sin = math.sin(psi_t)
    tau = vehicle.speed_time_constant
    side = [MapDisturbance.SIDE_X, MapDisturbance.SIDE_Y]
    climb = [MapDisturbance.CLIMB_X, MapDisturbance.CLIMB_Y]
    gain = np.zeros((len(Disturbance), len(MapDisturbance)))
    gain[Disturbance.SLIP_T, side] = -sin, cos
    gain[Disturbance.SLIP_I, side] = -math.sin(psi_i), math.cos(psi_i)
    gain[Disturbance.DRIVE, climb] = (
        -speed * (cos / tau - yaw_rate * sin),
        -speed * (sin / tau + yaw_rate * cos),
    )
    gain[Disturbance.WHEEL, climb] = cos, sin
    return math.copysign(1.0, speed) * gain


@cached_njit(error_model="numpy")
def write_estimate(
    x: FloatArray, covariance: FloatArray, parameters: FloatArray, estimate: FloatArray
) -> None:
    """Write what an `ESTIMATE` has of an augmented state `x` (24,) and its `covariance` P (24, 24).

    The covariance of the state is J P J'; J picks the state (`State`) out of the augmented state,
    but for the speed, which depends on five entries. The drive disturbance of the estimate moves v
    as the wheel speed, its disturbance and the wheel slip do together. `parameters` are (16,).
    """
    e = record(estimate, ESTIMATE)
    psi_t = x[AugmentedState.PSI_T]
    psi_i = x[AugmentedState.PSI_I]
    delta_i = x[AugmentedState.DELTA_I]
    psi_d = psi_i + delta_i
    wheel_speed = x[AugmentedState.WHEEL_SPEED]
    steering = x[AugmentedState.STEERING]
    gear = math.copysign(1.0, wheel_speed)
    cos = math.cos(psi_t)
    sin = math.sin(psi_t)
    cos_i = math.cos(psi_i)
    sin_i = math.sin(psi_i)

    # The speed over ground by the total wheel slip s, and the slip's change s' as the vehicle turns
    climb_x = x[AugmentedState.CLIMB_X]
    climb_y = x[AugmentedState.CLIMB_Y]
    wheel = x[AugmentedState.WHEEL] + gear * (climb_x * cos + climb_y * sin)
    slip_by_heading = gear * (climb_y * cos - climb_x * sin)  # ds / d(psi_t)
    v = wheel_speed * (1.0 - wheel)
    yaw_rate = v * math.tan(x[AugmentedState.DELTA_T] + steering)
    yaw_rate /= parameters[VehicleParameter.WHEELBASE]
    slip_rate = slip_by_heading * yaw_rate  # s' [1/s]
    for i in range(STATES):
        e.state[i] = x[i]
    e.state[State.V] = v

    # The trailer point, and the hitch angle
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    e.trailer_xy[0] = x[AugmentedState.X] - a * cos - d * math.cos(psi_d) - length_i * cos_i
    e.trailer_xy[1] = x[AugmentedState.Y] - a * sin - d * math.sin(psi_d) - length_i * sin_i
    e.hitch_angle = psi_t - psi_i - delta_i

    # Disturbances: the part that turns with the vehicle and the part that is fixed in the map
    side_x = x[AugmentedState.SIDE_X]
    side_y = x[AugmentedState.SIDE_Y]
    on_slope_t = gear * (side_y * cos - side_x * sin)
    on_slope_i = gear * (side_y * cos_i - side_x * sin_i)
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    e.disturbance[Disturbance.SLIP_T] = x[AugmentedState.SLIP_T] + on_slope_t
    e.disturbance[Disturbance.SLIP_I] = x[AugmentedState.SLIP_I] + on_slope_i
    e.disturbance[Disturbance.STEERING] = steering
    e.disturbance[Disturbance.DRIVE] = x[AugmentedState.DRIVE] - wheel_speed * (
        wheel / tau + slip_rate
    )
    e.disturbance[Disturbance.WHEEL] = wheel
    for i in range(_OF_MAP):
        e.map_disturbance[i] = x[AugmentedState.SIDE_X + i]

    speed_slopes = (  # d v / d augmented, at `_V_DEPENDS_ON`
        -wheel_speed * slip_by_heading,
        1.0 - wheel,
        -wheel_speed,
        -abs(wheel_speed) * cos,
        -abs(wheel_speed) * sin,
    )
    _write_covariance(covariance, speed_slopes, estimate)


@cached_njit(error_model="numpy")
def _write_covariance(
    covariance: FloatArray, speed_slopes: tuple[float, ...], estimate: FloatArray
) -> None:
    """Write J P J', see `write_estimate`; `speed_slopes` is the row of J of the speed."""
    e = record(estimate, ESTIMATE)
    for i in range(State.V):
        with_speed = 0.0
        for n in range(len(speed_slopes)):
            k = _V_DEPENDS_ON[n]
            with_speed += speed_slopes[n] * 0.5 * (covariance[k, i] + covariance[i, k])
        e.covariance[State.V, i] = with_speed
        e.covariance[i, State.V] = with_speed
        for j in range(State.V):
            e.covariance[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
    variance = 0.0
    for n in range(len(speed_slopes)):
        for m in range(len(speed_slopes)):
            by = covariance[_V_DEPENDS_ON[n], _V_DEPENDS_ON[m]]
            variance += speed_slopes[n] * speed_slopes[m] * by
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


class _Slip(NamedTuple):
    """Total slips at present headings, and the parts of them that a slope causes."""

    gear: float  # sign of the wheel speed
    side_x: float  # [rad] side slip that is fixed in the map, with the sign of the gear
    side_y: float
    climb_x: float  # wheel slip that is fixed in the map, with the sign of the gear
    climb_y: float
    slip_t: float  # [rad] side slip of the rear axle
    slip_i: float  # [rad] side slip of the trailer axle
    speed_ratio: float  # speed over ground by the wheel speed


@cached_njit(error_model="numpy")
def _slip(x: FloatArray, cos_t: float, sin_t: float, cos_i: float, sin_i: float) -> _Slip:
    """Return the slips of an augmented state, whose headings have these cosines and sines."""
    gear = math.copysign(1.0, x[AugmentedState.WHEEL_SPEED])
    side_x = gear * x[AugmentedState.SIDE_X]
    side_y = gear * x[AugmentedState.SIDE_Y]
    climb_x = gear * x[AugmentedState.CLIMB_X]
    climb_y = gear * x[AugmentedState.CLIMB_Y]
    slip_t = x[AugmentedState.SLIP_T] - side_x * sin_t + side_y * cos_t
    slip_i = x[AugmentedState.SLIP_I] - side_x * sin_i + side_y * cos_i
    speed_ratio = 1.0 - x[AugmentedState.WHEEL] - climb_x * cos_t - climb_y * sin_t
    return _Slip(gear, side_x, side_y, climb_x, climb_y, slip_t, slip_i, speed_ratio)


@cached_njit(error_model="numpy")
def state_rate(x: FloatArray, inputs: FloatArray, parameters: FloatArray, rate: FloatArray) -> None:
    """Write dx/dt of the first seven entries under `inputs` (3,) into `rate` (7,).

    The model is `articulated` with the total slips and, with the wheel speed v_w, v = v_w (1 - s)
    and v_w' = (K hp - v_w) / tau + w. The disturbances are constant.
    """
    psi_t = x[AugmentedState.PSI_T]
    psi_i = x[AugmentedState.PSI_I]
    delta_t = x[AugmentedState.DELTA_T]
    delta_i = x[AugmentedState.DELTA_I]
    wheel_speed = x[AugmentedState.WHEEL_SPEED]
    cos_t = math.cos(psi_t)
    sin_t = math.sin(psi_t)
    slip = _slip(x, cos_t, sin_t, math.cos(psi_i), math.sin(psi_i))
    v = wheel_speed * slip.speed_ratio
    rate_t, _ = _steering(x, inputs, parameters, 0)
    rate_i, _ = _steering(x, inputs, parameters, 1)

    # Yaw rates: of the tractor by its front wheels, of the trailer by what RJ2 moves across it
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    length_i = length_i + parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    lam = psi_t - psi_i
    cos_l = math.cos(lam)
    cos_delta_i = math.cos(delta_i)
    yaw_t = v * math.tan(delta_t + x[AugmentedState.STEERING])
    yaw_t = yaw_t / parameters[VehicleParameter.WHEELBASE]
    across = v * (math.sin(lam) + slip.slip_t * cos_l - slip.slip_i) - a * yaw_t * cos_l
    yaw_i = (across - d * rate_i * cos_delta_i) / (length_i + d * cos_delta_i)

    steady_speed = parameters[VehicleParameter.SPEED_GAIN] * inputs[Input.HP]
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    rate[AugmentedState.X] = v * (cos_t - slip.slip_t * sin_t)
    rate[AugmentedState.Y] = v * (sin_t + slip.slip_t * cos_t)
    rate[AugmentedState.PSI_T] = yaw_t
    rate[AugmentedState.PSI_I] = yaw_i
    rate[AugmentedState.DELTA_T] = rate_t
    rate[AugmentedState.DELTA_I] = rate_i
    rate[AugmentedState.WHEEL_SPEED] = (steady_speed - wheel_speed) / tau + x[AugmentedState.DRIVE]


@cached_njit(error_model="numpy")
def state_rate_jacobian(
    x: FloatArray, inputs: FloatArray, parameters: FloatArray, jacobian: FloatArray
) -> None:
    """Write d `state_rate` / d x under `inputs` (3,) into `jacobian` (7, 24)."""
    for i in range(STATES):
        for j in range(jacobian.shape[1]):
            jacobian[i, j] = 0.0
    psi_t = x[AugmentedState.PSI_T]
    psi_i = x[AugmentedState.PSI_I]
    cos_t = math.cos(psi_t)
    sin_t = math.sin(psi_t)
    cos_i = math.cos(psi_i)
    sin_i = math.sin(psi_i)
    slip = _slip(x, cos_t, sin_t, cos_i, sin_i)
    yaw = _write_yaw_derivatives(x, inputs, parameters, slip, jacobian)

    v = x[AugmentedState.WHEEL_SPEED] * slip.speed_ratio
    jacobian[AugmentedState.X, AugmentedState.PSI_T] = -v * (sin_t + slip.slip_t * cos_t)
    jacobian[AugmentedState.Y, AugmentedState.PSI_T] = v * (cos_t - slip.slip_t * sin_t)
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    jacobian[AugmentedState.WHEEL_SPEED, AugmentedState.WHEEL_SPEED] = -1.0 / tau
    jacobian[AugmentedState.WHEEL_SPEED, AugmentedState.DRIVE] = 1.0
    _add_slip_derivatives(x, cos_t, sin_t, slip, yaw, jacobian)

    # The side slip of the trailer's axle turns the trailer only
    by_slip_i = -v / yaw.arm
    by_heading = by_slip_i * (-slip.side_x * cos_i - slip.side_y * sin_i)
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_I] += by_heading
    jacobian[AugmentedState.PSI_I, AugmentedState.SLIP_I] = by_slip_i
    jacobian[AugmentedState.PSI_I, AugmentedState.SIDE_X] -= slip.gear * by_slip_i * sin_i
    jacobian[AugmentedState.PSI_I, AugmentedState.SIDE_Y] += slip.gear * by_slip_i * cos_i


class _Yaw(NamedTuple):
    """Derivatives of the yaw rates that the other terms of the Jacobian need."""

    t_by_v: float  # of the tractor's, by the speed v [1/m]
    i_by_v: float  # of the trailer's, by the speed v [1/m]
    cos_lambda: float  # of psi_t - psi_i
    arm: float  # [m] from the trailer's axle to RJ2 and, turned by delta_i, to RJ1


@cached_njit(error_model="numpy")
def _write_yaw_derivatives(
    x: FloatArray,
    inputs: FloatArray,
    parameters: FloatArray,
    slip: _Slip,
    jacobian: FloatArray,
) -> _Yaw:
    """Write the derivatives of both yaw rates and steering rates by angles, at constant v."""
    delta_i = x[AugmentedState.DELTA_I]
    v = x[AugmentedState.WHEEL_SPEED] * slip.speed_ratio
    lam = x[AugmentedState.PSI_T] - x[AugmentedState.PSI_I]
    sin_l = math.sin(lam)
    cos_l = math.cos(lam)
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a = parameters[VehicleParameter.HITCH_OFFSET]
    d = parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    length_i = length_i + parameters[VehicleParameter.TRAILER_TURNING_OFFSET]
    arm = length_i + d * math.cos(delta_i)
    _, gain_t = _steering(x, inputs, parameters, 0)
    rate_i, gain_i = _steering(x, inputs, parameters, 1)

    # Yaw rate of the tractor and rate of its front wheels
    angle = x[AugmentedState.DELTA_T] + x[AugmentedState.STEERING]
    t_by_v = math.tan(angle) / wheelbase
    t_by_delta = v / (wheelbase * math.cos(angle) ** 2)
    jacobian[AugmentedState.PSI_T, AugmentedState.DELTA_T] = t_by_delta
    jacobian[AugmentedState.PSI_T, AugmentedState.STEERING] = t_by_delta
    jacobian[AugmentedState.DELTA_T, AugmentedState.DELTA_T] = -gain_t

    # Yaw rate of the trailer and rate of its joint
    i_by_v = (sin_l + slip.slip_t * cos_l - slip.slip_i - a * t_by_v * cos_l) / arm
    yaw_i = v * i_by_v - d * rate_i * math.cos(delta_i) / arm
    i_by_lambda = v * (cos_l - slip.slip_t * sin_l + a * t_by_v * sin_l) / arm
    i_by_delta_t = -a * t_by_delta * cos_l / arm
    i_by_rate = -d * math.cos(delta_i) / arm
    i_by_delta_i = d * math.sin(delta_i) * (rate_i + yaw_i) / arm - i_by_rate * gain_i
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_T] = i_by_lambda
    jacobian[AugmentedState.PSI_I, AugmentedState.PSI_I] = -i_by_lambda
    jacobian[AugmentedState.PSI_I, AugmentedState.DELTA_T] = i_by_delta_t
    jacobian[AugmentedState.PSI_I, AugmentedState.STEERING] = i_by_delta_t
    jacobian[AugmentedState.PSI_I, AugmentedState.DELTA_I] = i_by_delta_i
    jacobian[AugmentedState.DELTA_I, AugmentedState.DELTA_I] = -gain_i
    by_joint = gain_i * parameters[VehicleParameter.JOINT]
    jacobian[AugmentedState.DELTA_I, AugmentedState.OFFSET_I] = by_joint
    jacobian[AugmentedState.PSI_I, AugmentedState.OFFSET_I] = i_by_rate * by_joint
    return _Yaw(t_by_v, i_by_v, cos_l, arm)


@cached_njit(error_model="numpy")
def _add_slip_derivatives(
    x: FloatArray, cos_t: float, sin_t: float, slip: _Slip, yaw: _Yaw, jacobian: FloatArray
) -> None:
    """Write the derivatives through the speed over ground and the tractor's side slip.

    Both act on the rates of x, y, psi_t and psi_i. What a slope adds to them turns with psi_t.
    """
    wheel_speed = x[AugmentedState.WHEEL_SPEED]
    v = wheel_speed * slip.speed_ratio
    by_v = (
        cos_t - slip.slip_t * sin_t,
        sin_t + slip.slip_t * cos_t,
        yaw.t_by_v,
        yaw.i_by_v,
    )
    by_slip = (-v * sin_t, v * cos_t, 0.0, v * yaw.cos_lambda / yaw.arm)
    v_by_psi = wheel_speed * (slip.climb_x * sin_t - slip.climb_y * cos_t)
    slip_by_psi = -slip.side_x * cos_t - slip.side_y * sin_t
    for row in range(len(by_v)):
        by_psi = by_v[row] * v_by_psi + by_slip[row] * slip_by_psi
        jacobian[row, AugmentedState.PSI_T] += by_psi
        jacobian[row, AugmentedState.WHEEL_SPEED] = by_v[row] * slip.speed_ratio
        jacobian[row, AugmentedState.SLIP_T] = by_slip[row]
        jacobian[row, AugmentedState.WHEEL] = -by_v[row] * wheel_speed
        jacobian[row, AugmentedState.SIDE_X] = -slip.gear * by_slip[row] * sin_t
        jacobian[row, AugmentedState.SIDE_Y] = slip.gear * by_slip[row] * cos_t
        jacobian[row, AugmentedState.CLIMB_X] = -slip.gear * by_v[row] * wheel_speed * cos_t
        jacobian[row, AugmentedState.CLIMB_Y] = -slip.gear * by_v[row] * wheel_speed * sin_t


class Step(NamedTuple):
    """Results of an integration step other than the new state."""

    middle: FloatArray  # (24,) state in the middle of the step
    inputs: FloatArray  # (3,) that act
    fading: FloatArray  # (17,) logarithm of the factor by which each disturbance fades


@cached_njit(error_model="numpy")
def move_augmented_state(
    x: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    parameters: FloatArray,
    fading: FloatArray,
    step_s: float,
    step: Step,
) -> None:
    """Advance `x` (24,) and `valves` (2,) by `step_s` in place, and write the `Step`.

    The set points of the steering valves `valves` [rad] run to the `command` (3,) at their rate
    limit, and their mean over the step acts. The state takes one classical Runge-Kutta step.
    Disturbances fade by exp(-a step_s - b travel) with the halves a [1/s], b [1/m] of `fading`
    (34,).
    """
    step.inputs[Input.HP] = command[Input.HP]
    for i in range(Input.HP):
        reach = parameters[VehicleParameter.STEERING_RATE_T + i] * step_s
        after = min(max(command[i], valves[i] - reach), valves[i] + reach)
        step.inputs[i] = 0.5 * (valves[i] + after)
        valves[i] = after

    # Runge-Kutta: rates at the begin, twice in the middle, at the end
    stage_x = local((SIZE,))
    rates = local((4, STATES))
    for i in range(SIZE):
        stage_x[i] = x[i]
        step.middle[i] = x[i]
    state_rate(x, step.inputs, parameters, rates[0])
    for stage in range(3):
        duration = step_s if stage == 2 else 0.5 * step_s
        for i in range(STATES):
            stage_x[i] = x[i] + duration * rates[stage, i]
        state_rate(stage_x, step.inputs, parameters, rates[stage + 1])
    end = len(rates) - 1
    for i in range(STATES):
        change = step_s / 6.0 * (rates[0, i] + 2.0 * (rates[1, i] + rates[2, i]) + rates[end, i])
        step.middle[i] = x[i] + 0.5 * change
        x[i] += change

    travel = abs(step.middle[AugmentedState.WHEEL_SPEED]) * step_s
    for j in range(_DISTURBANCES):
        step.fading[j] = -fading[j] * step_s - fading[_DISTURBANCES + j] * travel
        x[STATES + j] *= math.exp(step.fading[j])


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
    `x` may be longer than 24.
    """
    middle = local((SIZE,))
    inputs = local((3,))
    faded = local((_DISTURBANCES,))
    step = Step(middle, inputs, faded)
    move_augmented_state(x, valves, command, parameters, fading, step_s, step)
    jacobian = local((STATES, WIDTH))
    state_rate_jacobian(middle, inputs, parameters, jacobian)
    _write_exponential(jacobian, faded, step_s, transition)


@cached_njit(error_model="numpy")
def _write_exponential(
    jacobian: FloatArray, fading: FloatArray, step_s: float, transition: FloatArray
) -> None:
    """Write exp([[A, B], [0, F]]) by Horner's scheme: E <- 1 + M E / n, from the last term n on.

    [A, B] is the `jacobian` (7, 24) times `step_s`, F the diagonal matrix of `fading` (17,). Below
    the upper seven rows only the diagonal is not 0.
    """
    previous = local((STATES, WIDTH))  # upper rows of E before
    diagonal = local((WIDTH,))  # lower diagonal of E before; 0 for the states
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
        # Upper right block: B times the lower diagonal, and A times the upper rows
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
            transition[j, j] = 1.0 + fading[j - STATES] * transition[j, j] / term
