"""Articulated model along a horizon with its derivatives, compiled."""

import math
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit
from ..models.augmented_state import VehicleParameter, vehicle_parameters
from ..mpc.condensing import StageBounds
from ..types import Disturbance, FloatArray, Input, State
from ..vehicle import Vehicle

_M: Final = len(Input)


class Task(NamedTuple):
    """Data of the problem of one tick."""

    state: FloatArray  # (7,) the estimate
    disturbance: FloatArray  # (Np, 5) predicted as by the linear MPC
    poses: FloatArray  # (Np, 6 or 7) targets at the ends of the periods, for the model
    feedforward: FloatArray  # (Np, 3) u_r
    previous: FloatArray  # (3,) u_e(k-1)
    bounds: StageBounds  # (3 Nc,) each


@cached_njit(error_model="numpy", boundscheck=False)
def planned_inputs(task: Task, steps: FloatArray, inputs: FloatArray) -> None:
    """Write u = u_r - u_e of all periods into `inputs` (Np, 3), for the `steps` (3 Nc,) of u_e."""
    for i in range(_M):
        u_e = task.previous[i]
        for j in range(len(inputs)):
            if j * _M < steps.size:
                u_e += steps[j * _M + i]
            inputs[j, i] = task.feedforward[j, i] - u_e


@cached_njit(error_model="numpy", boundscheck=False)
def propagate(
    by_state: FloatArray, by_input: FloatArray, period: int, before: FloatArray, after: FloatArray
) -> None:
    """Write d state / d steps at the end of a `period` into `after` (n, 3 Nc).

    `before` is the same at its start, `by_state` (n, n) and `by_input` (n, 3) are the derivatives
    of the period; d u / d step i = -1 from period i on.
    """
    filled = min((period + 1) * _M, after.shape[1])
    linear_map(by_state, before, filled, after)
    for row in range(len(after)):
        for i in range(filled):
            after[row, i] -= by_input[row, i % _M]


@cached_njit(error_model="numpy", boundscheck=False)
def linear_map(matrix: FloatArray, columns: FloatArray, filled: int, result: FloatArray) -> None:
    """Write `matrix` (r, n) times the first `filled` `columns` (n, c) into `result` (r, c)."""
    result[:, :] = 0.0
    for row in range(len(matrix)):
        for k in range(matrix.shape[1]):
            factor = matrix[row, k]
            if factor != 0.0:  # most are
                for i in range(filled):
                    result[row, i] += factor * columns[k, i]


@cached_njit(error_model="numpy", boundscheck=False)
def condense(
    errors: FloatArray,
    jacobian: FloatArray,
    weight: FloatArray,
    step_weight: FloatArray,
    steps: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
) -> float:
    """Return the cost at `steps` (q,), and write the QP of the linearised outputs.

    sum_j y_j' Q y_j + s' R s with y_j = errors_j + jacobian_j (s - steps) is, but for a constant,
    1/2 s'Hs + g's with `hessian` (q, q) and `gradient` (q,).
    """
    cost, q = 0.0, steps.size
    hessian[:, :] = 0.0
    gradient[:] = 0.0
    for j in range(len(errors)):
        for output in range(weight.size):
            row, error = jacobian[j, output], errors[j, output]
            cost += weight[output] * error * error
            rest = error
            for i in range(q):
                rest -= row[i] * steps[i]
            for i in range(q):
                factor = 2.0 * weight[output] * row[i]
                gradient[i] += factor * rest
                for k in range(i + 1):
                    hessian[i, k] += factor * row[k]
    for i in range(q):
        hessian[i, i] += 2.0 * step_weight[i]
        cost += step_weight[i] * steps[i] * steps[i]
        for k in range(i):
            hessian[k, i] = hessian[i, k]
    return cost


# Longest classical Runge-Kutta step over the shortest lag: over a horizon of four seconds both axle
# points then stay within a millimetre of much finer steps, which a test checks.
_STEP_PER_LAG: Final = 0.75
_N: Final = 7
# Columns of the derivatives of a period: psi_t to v at its start, then its inputs. Nothing depends
# on x and y but themselves.
_FIRST: Final = 2  # State.PSI_T
_GIVEN: Final = _N - _FIRST
_COLUMNS: Final = _GIVEN + _M


class ArticulatedModel:
    """`ttempc.models.kinematics.articulated` along a horizon.

    The outputs are reference less axle points in the frames of the reference, (4,) [m]; the targets
    are the reference's x, y, psi of the tractor, then of the trailer.
    """

    def __init__(self, vehicle: Vehicle, period_s: float) -> None:
        self._parameters, self._period_s = vehicle_parameters(vehicle), period_s
        shortest_lag = min(vehicle.steering_lag_t, vehicle.steering_lag_i)
        self._count = math.ceil(period_s / (_STEP_PER_LAG * shortest_lag))

    def evaluate(
        self, task: Task, steps: FloatArray, errors: FloatArray, jacobian: FloatArray
    ) -> None:
        """Run the model under `steps` (3 Nc,).

        Writes the outputs at the ends of the periods into `errors` (Np, 4) and their derivatives
        by the steps into `jacobian` (Np, 4, 3 Nc).
        """
        model = self._parameters, self._period_s, self._count
        articulated_horizon(*model, task, steps, errors, jacobian)


@cached_njit(error_model="numpy", boundscheck=False)
def articulated_horizon(
    parameters: FloatArray,
    period_s: float,
    count: int,
    task: Task,
    steps: FloatArray,
    errors: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write the outputs along the horizon and their derivatives, see `ArticulatedModel`.

    `count` Runge-Kutta steps a period.
    """
    now, by_given = task.state.copy(), np.empty((_N, _COLUMNS))
    by_state, by_input = np.zeros((_N, _N)), np.empty((_N, _M))
    by_state[State.X, State.X] = by_state[State.Y, State.Y] = 1.0
    before, after = np.zeros((_N, steps.size)), np.zeros((_N, steps.size))
    by_end, inputs = np.zeros((4, _N)), np.empty_like(task.feedforward)
    planned_inputs(task, steps, inputs)
    for j in range(len(inputs)):
        advance_period(now, inputs[j], task.disturbance[j], parameters, period_s, count, by_given)
        by_state[:, _FIRST:] = by_given[:, :_GIVEN]
        by_input[:, :] = by_given[:, _GIVEN:]
        propagate(by_state, by_input, j, before, after)
        position_errors(now, task.poses[j], parameters, errors[j], by_end)
        linear_map(by_end, after, steps.size, jacobian[j])
        before, after = after, before


@cached_njit(error_model="numpy", boundscheck=False)
def advance_period(
    state: FloatArray,
    inputs: FloatArray,
    disturbance: FloatArray,
    parameters: FloatArray,
    period_s: float,
    count: int,
    by_given: FloatArray,
) -> None:
    """Advance `state` (7,) by a period of constant inputs, in `count` Runge-Kutta steps.

    Writes the derivatives of the state at the end into `by_given` (7, 8), by psi_t, psi_i, delta_t,
    delta_i and v at the start, then by the inputs. They are the exact ones of the Runge-Kutta
    steps: the same steps of the variational equation.
    """
    step_s = period_s / count
    rate, stage = np.empty(_N), np.empty(_N)
    slope, stage_slope = np.empty((_N, _COLUMNS)), np.empty((_N, _COLUMNS))
    total, total_slope = np.empty(_N), np.empty((_N, _COLUMNS))
    by_given[:, :] = 0.0
    for i in range(_GIVEN):
        by_given[_FIRST + i, i] = 1.0
    for _ in range(count):
        stage[:] = state
        stage_slope[:, :] = by_given
        total[:] = 0.0
        total_slope[:, :] = 0.0
        for k in range(4):
            _rate(stage, stage_slope, inputs, disturbance, parameters, rate, slope)
            weight = step_s / 6.0 if k in (0, 3) else step_s / 3.0
            ahead = step_s if k == 2 else 0.5 * step_s
            for i in range(_N):
                total[i] += weight * rate[i]
                stage[i] = state[i] + ahead * rate[i]
                for c in range(_COLUMNS):
                    total_slope[i, c] += weight * slope[i, c]
                    stage_slope[i, c] = by_given[i, c] + ahead * slope[i, c]
        state += total
        by_given += total_slope


@cached_njit(error_model="numpy", boundscheck=False)
def _rate(
    state: FloatArray,
    by_given: FloatArray,
    inputs: FloatArray,
    disturbance: FloatArray,
    parameters: FloatArray,
    rate: FloatArray,
    slope: FloatArray,
) -> None:
    """Write `articulated` into `rate` (7,) and its derivative along `by_given` into `slope`."""
    psi_t, delta_t, delta_i = state[State.PSI_T], state[State.DELTA_T], state[State.DELTA_I]
    v, slip_t = state[State.V], disturbance[Disturbance.SLIP_T]
    wheelbase = parameters[VehicleParameter.WHEELBASE]
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    gain_v = parameters[VehicleParameter.SPEED_GAIN]
    tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    lam = psi_t - state[State.PSI_I]
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    sin_l, cos_l = math.sin(lam), math.cos(lam)
    sin_i, cos_i = math.sin(delta_i), math.cos(delta_i)
    angle = delta_t + disturbance[Disturbance.STEERING]
    cos_a = math.cos(angle)
    rate_t, gain_t = _steering(
        (inputs[Input.DELTA_T] - delta_t) / parameters[VehicleParameter.STEERING_LAG_T],
        1.0 / parameters[VehicleParameter.STEERING_LAG_T],
        parameters[VehicleParameter.STEERING_RATE_T],
    )
    rate_i, gain_i = _steering(
        (inputs[Input.DELTA_I] - delta_i) / parameters[VehicleParameter.STEERING_LAG_I],
        1.0 / parameters[VehicleParameter.STEERING_LAG_I],
        parameters[VehicleParameter.STEERING_RATE_I],
    )
    # As in `state_rate_jacobian`.
    along_v, across_v = cos_t - slip_t * sin_t, sin_t + slip_t * cos_t
    yaw_t_v = math.sin(angle) / (cos_a * wheelbase)
    yaw_t_delta = v / (wheelbase * cos_a * cos_a)
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    arm = length_i + parameters[VehicleParameter.TRAILER_TURNING_OFFSET] + d * cos_i
    slips = sin_l + slip_t * cos_l - disturbance[Disturbance.SLIP_I]
    yaw_i_v = (slips - a * yaw_t_v * cos_l) / arm
    yaw_i_rate = -d * cos_i / arm
    yaw_i = v * yaw_i_v + yaw_i_rate * rate_i
    yaw_i_lam = v * (cos_l - slip_t * sin_l + a * yaw_t_v * sin_l) / arm
    yaw_i_delta_t = -a * yaw_t_delta * cos_l / arm
    yaw_i_delta_i = d * sin_i * (rate_i + yaw_i) / arm - yaw_i_rate * gain_i

    rate[State.X], rate[State.Y] = v * along_v, v * across_v
    rate[State.PSI_T], rate[State.PSI_I] = v * yaw_t_v, yaw_i
    rate[State.DELTA_T], rate[State.DELTA_I] = rate_t, rate_i
    rate[State.V] = (gain_v * inputs[Input.HP] - v) / tau + disturbance[Disturbance.DRIVE]

    of_psi_t, of_psi_i, of_v = by_given[State.PSI_T], by_given[State.PSI_I], by_given[State.V]
    of_delta_t, of_delta_i = by_given[State.DELTA_T], by_given[State.DELTA_I]
    for c in range(_COLUMNS):
        slope[State.X, c] = -v * across_v * of_psi_t[c] + along_v * of_v[c]
        slope[State.Y, c] = v * along_v * of_psi_t[c] + across_v * of_v[c]
        slope[State.PSI_T, c] = yaw_t_delta * of_delta_t[c] + yaw_t_v * of_v[c]
        slope[State.PSI_I, c] = (
            yaw_i_lam * (of_psi_t[c] - of_psi_i[c])
            + yaw_i_delta_t * of_delta_t[c]
            + yaw_i_delta_i * of_delta_i[c]
            + yaw_i_v * of_v[c]
        )
        slope[State.DELTA_T, c] = -gain_t * of_delta_t[c]
        slope[State.DELTA_I, c] = -gain_i * of_delta_i[c]
        slope[State.V, c] = -of_v[c] / tau
    slope[State.DELTA_T, _GIVEN + Input.DELTA_T] += gain_t
    slope[State.DELTA_I, _GIVEN + Input.DELTA_I] += gain_i
    slope[State.PSI_I, _GIVEN + Input.DELTA_I] += yaw_i_rate * gain_i
    slope[State.V, _GIVEN + Input.HP] += gain_v / tau


@cached_njit(error_model="numpy", boundscheck=False)
def _steering(rate: float, gain: float, limit: float) -> tuple[float, float]:
    """Return the limited rate of a steering angle [rad/s] and its derivative by the command."""
    if abs(rate) >= limit:
        return math.copysign(limit, rate), 0.0
    return rate, gain


@cached_njit(error_model="numpy", boundscheck=False)
def position_errors(
    state: FloatArray,
    poses: FloatArray,
    parameters: FloatArray,
    errors: FloatArray,
    by_state: FloatArray,
) -> None:
    """Write reference less axle points in the frames of the reference, and d / d state (4, 7)."""
    psi_t, psi_i, delta_i = state[State.PSI_T], state[State.PSI_I], state[State.DELTA_I]
    a, d = parameters[VehicleParameter.HITCH_OFFSET], parameters[VehicleParameter.DRAWBAR_LENGTH]
    length_i = parameters[VehicleParameter.TRAILER_LENGTH]
    a_x, a_y = a * math.cos(psi_t), a * math.sin(psi_t)
    d_x, d_y = d * math.cos(psi_i + delta_i), d * math.sin(psi_i + delta_i)
    i_x, i_y = d_x + length_i * math.cos(psi_i), d_y + length_i * math.sin(psi_i)
    for body in range(2):
        dx = poses[3 * body] - state[State.X] + body * (a_x + i_x)
        dy = poses[3 * body + 1] - state[State.Y] + body * (a_y + i_y)
        cos, sin = math.cos(poses[3 * body + 2]), math.sin(poses[3 * body + 2])
        row, across = 2 * body, 2 * body + 1
        errors[row], errors[across] = cos * dx + sin * dy, cos * dy - sin * dx
        by_state[row, State.X], by_state[row, State.Y] = -cos, -sin
        by_state[across, State.X], by_state[across, State.Y] = sin, -cos
        if body == 1:  # the trailer point also turns about the hitches
            by_state[row, State.PSI_T] = sin * a_x - cos * a_y
            by_state[row, State.PSI_I] = sin * i_x - cos * i_y
            by_state[row, State.DELTA_I] = sin * d_x - cos * d_y
            by_state[across, State.PSI_T] = cos * a_x + sin * a_y
            by_state[across, State.PSI_I] = cos * i_x + sin * i_y
            by_state[across, State.DELTA_I] = cos * d_x + sin * d_y
