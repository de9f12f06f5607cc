"""Printed model of tractor and trailer with slip factors, compiled, with its derivatives.

With slip factors mu (driven wheels), kappa (front steering) and eta (trailer steering),

    x_t' = mu v cos(psi_t),   y_t' = mu v sin(psi_t),   psi_t' = mu v tan(kappa delta_t) / L_t
    x_i' = mu v cos(psi_i),   y_i' = mu v sin(psi_i)
    psi_i' = mu v (sin(l) + (L_d / L_t) tan(kappa delta_t) cos(l)) / L_i,   l = eta delta_i + beta
    v' = (K hp - v) / tau.

With factors of 1 this is eq. (kinematicmodel) of Kayacan, Ramon and Saeys (2016) as printed, with
lambda = beta + delta_i. That the NMPC of this vehicle has slip factors as parameters is in that
paper; their places are from memory of Kayacan, Kayacan, Ramon and Saeys (2015), "Learning in
centralized nonlinear model predictive control: application to an autonomous tractor-trailer
system", IEEE Transactions on Control Systems Technology 23(1).
"""

import math
from typing import Final

import numpy as np

from ttempc.baselines.nmpc_model import Task, linear_map, planned_inputs, propagate
from ttempc.jit import cached_njit
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

STATES: Final = 7  # x_t, y_t, psi_t, x_i, y_i, psi_i, v: v is the speed of the rims
FACTORS: Final = 3  # mu, kappa, eta
WINDOW_INPUTS: Final = 5  # delta_t, delta_i, hp, beta, length of the period [s]
_UNKNOWNS: Final = STATES + FACTORS
_COLUMNS: Final = _UNKNOWNS + 3  # of derivatives: by states, factors, inputs


def printed_parameters(vehicle: Vehicle) -> FloatArray:
    """Return L_t, L_d, L_i [m], K [m/s] and tau [s] of the model, (5,)."""
    lengths = vehicle.wheelbase, vehicle.drawbar_offset, vehicle.trailer_length
    return np.array([*lengths, vehicle.speed_gain, vehicle.speed_time_constant])


class PrintedModel:
    """The model as an NMPC takes it: inputs delta_t, lambda, hp; slip factors and beta are given.

    `Task.disturbance` holds mu, kappa, eta, beta and nothing. beta stays as it was measured. The
    targets are x, y, psi of tractor and trailer and the speed of the rims; the outputs, (5,), are
    target less position in the frames of the targets, then of the speed.

    Args:
        vehicle: its constants.
        period_s: control period [s].
    """

    def __init__(self, vehicle: Vehicle, period_s: float) -> None:
        self._parameters = printed_parameters(vehicle)
        self._period_s = period_s

    def evaluate(
        self, task: Task, steps: FloatArray, errors: FloatArray, jacobian: FloatArray
    ) -> None:
        """Write errors and derivatives, see `ArticulatedModel`."""
        printed_horizon(self._parameters, self._period_s, task, steps, errors, jacobian)


def along_window(
    parameters: FloatArray, first: FloatArray, inputs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns at the ends of a window's periods, (n, 10), and their derivatives.

    Args:
        parameters: of `printed_parameters`.
        first: state and slip factors at the start, (10,).
        inputs: (n, 5) delta_t, delta_i, hp, beta, length of the period [s].

    Returns:
        The unknowns, and their derivatives by the first, (n, 10, 10).
    """
    unknowns = np.empty((len(inputs), _UNKNOWNS))
    jacobian = np.empty((len(inputs), _UNKNOWNS, _UNKNOWNS))
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
    by_given, step = np.empty((STATES, _COLUMNS)), np.eye(_UNKNOWNS)
    before, now = np.eye(_UNKNOWNS), first.copy()
    for j in range(len(inputs)):
        advance_printed(
            now[:STATES], inputs[j, :4], first[STATES:], parameters, inputs[j, 4], by_given
        )
        step[:STATES, :] = by_given[:, :_UNKNOWNS]
        linear_map(step, before, _UNKNOWNS, jacobian[j])
        unknowns[j, :] = now
        before = jacobian[j]


@cached_njit(error_model="numpy", boundscheck=False)
def printed_horizon(
    parameters: FloatArray,
    period_s: float,
    task: Task,
    steps: FloatArray,
    errors: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write the outputs along the horizon and their derivatives, see `ArticulatedModel`."""
    now, by_given = task.state.copy(), np.empty((STATES, _COLUMNS))
    by_state, by_input = np.empty((STATES, STATES)), np.empty((STATES, 3))
    disturbance, poses = task.disturbance, task.poses
    before, after = np.zeros((STATES, steps.size)), np.zeros((STATES, steps.size))
    by_end, steering = np.zeros((5, STATES)), np.empty(4)
    inputs = np.empty_like(task.feedforward)
    planned_inputs(task, steps, inputs)
    for j in range(len(inputs)):
        beta = disturbance[j, FACTORS]
        steering[0], steering[1] = inputs[j, 0], inputs[j, 1] - beta  # delta_i = lambda - beta
        steering[2], steering[3] = inputs[j, 2], beta
        advance_printed(now, steering, disturbance[j, :FACTORS], parameters, period_s, by_given)
        by_state[:, :] = by_given[:, :STATES]
        by_input[:, :] = by_given[:, _UNKNOWNS:]
        propagate(by_state, by_input, j, before, after)
        for body in range(2):
            x, y = 3 * body, 3 * body + 1
            dx, dy = poses[j, x] - now[x], poses[j, y] - now[y]
            cos, sin = math.cos(poses[j, 3 * body + 2]), math.sin(poses[j, 3 * body + 2])
            row, across = 2 * body, 2 * body + 1
            errors[j, row], errors[j, across] = cos * dx + sin * dy, cos * dy - sin * dx
            by_end[row, x], by_end[row, y] = -cos, -sin
            by_end[across, x], by_end[across, y] = sin, -cos
        errors[j, 4], by_end[4, 6] = poses[j, 6] - now[6], -1.0
        linear_map(by_end, after, steps.size, jacobian[j])
        before, after = after, before


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

    `steering` is delta_t, delta_i, hp, beta. Writes the derivatives of the state at the end by the
    state at the start, the `factors` and delta_t, delta_i, hp into `by_given` (7, 13); they are
    those of the Runge-Kutta step.
    """
    stage, rate, total = state.copy(), np.empty(STATES), np.zeros(STATES)
    start, total_slope = np.zeros((STATES, _COLUMNS)), np.zeros((STATES, _COLUMNS))
    for i in range(STATES):
        start[i, i] = 1.0
    stage_slope, slope = start.copy(), np.empty((STATES, _COLUMNS))
    for k in range(4):
        _rate(stage, stage_slope, steering, factors, parameters, rate, slope)
        weight = period_s / 6.0 if k in (0, 3) else period_s / 3.0
        ahead = period_s if k == 2 else 0.5 * period_s
        total += weight * rate
        total_slope += weight * slope
        stage[:] = state + ahead * rate
        stage_slope[:, :] = start + ahead * slope
    state += total
    by_given[:, :] = start + total_slope


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
    psi_t, psi_i, v = state[2], state[5], state[6]
    mu, kappa, eta = factors[0], factors[1], factors[2]
    wheelbase, lever, length_i, gain, tau = parameters
    ground = mu * v
    tan = math.tan(kappa * steering[0])
    turn, turn_angle = tan / wheelbase, (1.0 + tan * tan) / wheelbase
    lam = eta * steering[1] + steering[3]
    sin_l, cos_l = math.sin(lam), math.cos(lam)
    sin_t, cos_t, sin_i, cos_i = math.sin(psi_t), math.cos(psi_t), math.sin(psi_i), math.cos(psi_i)
    turn_i = (sin_l + lever * turn * cos_l) / length_i
    by_ground = (cos_t, sin_t, turn, cos_i, sin_i, turn_i)
    for row in range(6):
        rate[row] = ground * by_ground[row]
        for c in range(_COLUMNS):
            slope[row, c] = mu * by_ground[row] * by_given[6, c]
        slope[row, STATES] += v * by_ground[row]
    rate[6] = (gain * steering[2] - v) / tau
    for c in range(_COLUMNS):
        slope[0, c] -= ground * sin_t * by_given[2, c]
        slope[1, c] += ground * cos_t * by_given[2, c]
        slope[3, c] -= ground * sin_i * by_given[5, c]
        slope[4, c] += ground * cos_i * by_given[5, c]
        slope[6, c] = -by_given[6, c] / tau
    by_angle_i = ground * lever * cos_l * turn_angle / length_i
    by_lam = ground * (cos_l - lever * turn * sin_l) / length_i
    for column, factor in ((STATES + 1, steering[0]), (_UNKNOWNS, kappa)):
        slope[2, column] += ground * turn_angle * factor
        slope[5, column] += by_angle_i * factor
    slope[5, STATES + 2] += by_lam * steering[1]
    slope[5, _UNKNOWNS + 1] += by_lam * eta
    slope[6, _UNKNOWNS + 2] += gain / tau
