"""Printed model of tractor and trailer with slip factors, compiled, with its derivatives.

With slip factors mu (driven wheels), kappa (front steering) and eta (trailer steering),

    x_t' = mu v cos(psi_t),   y_t' = mu v sin(psi_t),   psi_t' = mu v tan(kappa delta_t) / L_t
    x_i' = mu v cos(psi_i),   y_i' = mu v sin(psi_i)
    psi_i' = mu v (sin(l) + (c / L_t) tan(kappa delta_t) cos(l)) / D,   l = eta delta_i + beta
    v' = (K hp - v) / tau.

With factors of 1, c = L_d and D = L_i this is eq. (kinematicmodel) of Kayacan, Ramon and Saeys
(2016) as printed, with lambda = beta + delta_i. With c = -a and D = L_i + d it is the exact yaw
equation at small and slow trailer steering (erratum 1). That the NMPC of this vehicle has slip
factors as parameters is in that paper; their places are from memory of Kayacan, Kayacan, Ramon and
Saeys (2015), "Learning in centralized nonlinear model predictive control: application to an
autonomous tractor-trailer system", IEEE Transactions on Control Systems Technology 23(1).
"""

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray
from ..vehicle import Vehicle

STATES: Final = 7  # x_t, y_t, psi_t, x_i, y_i, psi_i, v: v is the speed of the rims
FACTORS: Final = 3  # mu, kappa, eta
WINDOW_INPUTS: Final = 5  # delta_t, delta_i, hp, beta, length of the period [s]
UNKNOWNS: Final = STATES + FACTORS
COLUMNS: Final = UNKNOWNS + 3  # of derivatives: by states, factors, inputs

_PSI_T: Final = 2
_PSI_I: Final = 5
_V: Final = 6
_KAPPA: Final = STATES + 1  # columns of derivatives
_ETA: Final = STATES + 2
_BY_DELTA_T: Final = UNKNOWNS
_BY_LAMBDA: Final = UNKNOWNS + 1
_BY_HP: Final = UNKNOWNS + 2
_HP: Final = 2  # places in the steering of `advance_printed`
_BETA: Final = 3
_PERIOD: Final = 4  # place in the inputs of a window


def printed_parameters(vehicle: Vehicle) -> FloatArray:
    """Return L_t, c, D [m], K [m/s] and tau [s] of the model as printed, (5,)."""
    lengths = vehicle.wheelbase, vehicle.drawbar_offset, vehicle.trailer_length
    return np.array([*lengths, vehicle.speed_gain, vehicle.speed_time_constant])


def geometric_parameters(vehicle: Vehicle) -> FloatArray:
    """Return the same with the yaw equation of the trailer by geometry, (5,)."""
    behind = vehicle.drawbar_length + vehicle.trailer_length + vehicle.trailer_turning_offset
    lengths = vehicle.wheelbase, -vehicle.hitch_offset, behind
    return np.array([*lengths, vehicle.speed_gain, vehicle.speed_time_constant])


def along_window(
    parameters: FloatArray, first: FloatArray, inputs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns at the ends of a window's periods, (n, 10), and their derivatives.

    Args:
        parameters: of `printed_parameters` or `geometric_parameters`.
        first: state and slip factors at the start, (10,).
        inputs: (n, 5) delta_t, delta_i, hp, beta, length of the period [s].

    Returns:
        The unknowns, and their derivatives by the first, (n, 10, 10).
    """
    unknowns = np.empty((len(inputs), UNKNOWNS))
    jacobian = np.empty((len(inputs), UNKNOWNS, UNKNOWNS))
    _printed_window(parameters, first, inputs, unknowns, jacobian)
    return unknowns, jacobian


@cached_njit(error_model="numpy", boundscheck=False)
def _printed_window(
    parameters: FloatArray,
    first: FloatArray,
    inputs: FloatArray,
    unknowns: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write what `along_window` returns."""
    by_given = np.empty((STATES, COLUMNS))
    now = first.copy()
    factors = first[STATES:]
    before = np.eye(UNKNOWNS)
    for j in range(len(inputs)):
        period_s = inputs[j, _PERIOD]
        advance_printed(now[:STATES], inputs[j], factors, parameters, period_s, by_given)
        for row in range(UNKNOWNS):
            unknowns[j, row] = now[row]
            for c in range(UNKNOWNS):
                total = before[row, c] if row >= STATES else 0.0
                for i in range(UNKNOWNS if row < STATES else 0):
                    total += by_given[row, i] * before[i, c]
                jacobian[j, row, c] = total
        before = jacobian[j]


@cached_njit(error_model="numpy", boundscheck=False)
def advance_printed(
    state: FloatArray,
    steering: FloatArray,
    factors: FloatArray,
    parameters: FloatArray,
    period_s: float,
    by_given: FloatArray,
) -> None:
    """Advance `state` (7,) by `period_s`, by one classical Runge-Kutta step.

    `steering` begins with delta_t, delta_i, hp, beta. Writes the derivatives of the state at the
    end by the state at the start, the `factors` and delta_t, delta_i, hp into `by_given` (7, 13);
    they are those of the Runge-Kutta step.
    """
    stage = state.copy()
    rate = np.empty(STATES)
    total = np.zeros(STATES)
    stage_slope = np.zeros((STATES, COLUMNS))
    for i in range(STATES):
        stage_slope[i, i] = 1.0
    slope = np.empty((STATES, COLUMNS))
    total_slope = np.zeros((STATES, COLUMNS))
    for k in range(4):
        _rate(stage, stage_slope, steering, factors, parameters, rate, slope)
        weight = period_s / 6.0 if k in (0, 3) else period_s / 3.0
        ahead = period_s if k == 2 else 0.5 * period_s
        for i in range(STATES):
            total[i] += weight * rate[i]
            stage[i] = state[i] + ahead * rate[i]
            for c in range(COLUMNS):
                total_slope[i, c] += weight * slope[i, c]
                stage_slope[i, c] = ahead * slope[i, c] + (1.0 if i == c else 0.0)
    for i in range(STATES):
        state[i] += total[i]
        for c in range(COLUMNS):
            by_given[i, c] = total_slope[i, c] + (1.0 if i == c else 0.0)


@cached_njit(error_model="numpy", boundscheck=False)
def _rate(
    state: FloatArray,
    by_given: FloatArray,
    steering: FloatArray,
    factors: FloatArray,
    parameters: FloatArray,
    rate: FloatArray,
    slope: FloatArray,
) -> None:
    """Write the derivative of the state (7,), and its derivative along `by_given` (7, 13)."""
    v = state[_V]
    mu, kappa, eta = factors
    wheelbase, lever, length_i, gain, tau = parameters
    ground = mu * v
    tan = math.tan(kappa * steering[0])
    turn = tan / wheelbase
    by_angle = (1.0 + tan * tan) / wheelbase
    lam = eta * steering[1] + steering[_BETA]
    sin_l = math.sin(lam)
    cos_l = math.cos(lam)
    sin_t = math.sin(state[_PSI_T])
    cos_t = math.cos(state[_PSI_T])
    sin_i = math.sin(state[_PSI_I])
    cos_i = math.cos(state[_PSI_I])
    turn_i = (sin_l + lever * turn * cos_l) / length_i

    # The first six rows are proportional to the speed over ground.
    by_ground = (cos_t, sin_t, turn, cos_i, sin_i, turn_i)
    for row in range(_V):
        rate[row] = ground * by_ground[row]
        for c in range(COLUMNS):
            slope[row, c] = mu * by_ground[row] * by_given[_V, c]
        slope[row, STATES] += v * by_ground[row]
    rate[_V] = (gain * steering[_HP] - v) / tau
    for c in range(COLUMNS):
        slope[0, c] -= ground * sin_t * by_given[_PSI_T, c]
        slope[1, c] += ground * cos_t * by_given[_PSI_T, c]
        slope[_PSI_I - 2, c] -= ground * sin_i * by_given[_PSI_I, c]
        slope[_PSI_I - 1, c] += ground * cos_i * by_given[_PSI_I, c]
        slope[_V, c] = -by_given[_V, c] / tau

    # Both yaw rates turn with the steering angles, which their slip factors scale.
    by_angle_i = ground * lever * cos_l * by_angle / length_i
    by_lam = ground * (cos_l - lever * turn * sin_l) / length_i
    slope[_PSI_T, _KAPPA] += ground * by_angle * steering[0]
    slope[_PSI_I, _KAPPA] += by_angle_i * steering[0]
    slope[_PSI_T, _BY_DELTA_T] += ground * by_angle * kappa
    slope[_PSI_I, _BY_DELTA_T] += by_angle_i * kappa
    slope[_PSI_I, _ETA] += by_lam * steering[1]
    slope[_PSI_I, _BY_LAMBDA] += by_lam * eta
    slope[_V, _BY_HP] += gain / tau
