"""`augmented_state.motion`, compiled, with its slopes; and what the sensors read of a belief.

Same equations; tests hold the two together.
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np

from ..types import FloatArray
from ..vehicle import Vehicle
from .augmented_state import SIZE, STATES

_N: Final = STATES
_ALL: Final = SIZE
_TERMS: Final = 4  # of the exponential's series: enough for a third of a lag


def vehicle_table(vehicle: Vehicle) -> FloatArray:
    """Return what the kernel reads of a vehicle, (10,)."""
    return np.array(
        [
            *(vehicle.wheelbase, vehicle.hitch_offset, vehicle.drawbar_length),
            *(vehicle.trailer_length, vehicle.speed_gain, vehicle.speed_time_constant),
            *(vehicle.steering_lag_t, vehicle.steering_lag_i),
            *(vehicle.steering_rate_t, vehicle.steering_rate_i),
        ]
    )


@numba.njit(cache=True)
def _steering(command: float, angle: float, lag: float, limit: float) -> tuple[float, float]:
    rate = (command - angle) / lag
    if abs(rate) >= limit:
        return math.copysign(limit, rate), 0.0
    return rate, 1.0 / lag


@numba.njit(cache=True)
def rate_of(belief: FloatArray, inputs: FloatArray, table: FloatArray, rate: FloatArray) -> None:
    """Write the rate of the first seven entries of `belief` (16,); the others stand still."""
    psi_t, psi_i, delta_i, rim = belief[2], belief[3], belief[5], belief[6]
    wheelbase, a, d, length_i = table[0], table[1], table[2], table[3]
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    gear = math.copysign(1.0, rim)
    gx, gy, cx, cy = gear * belief[12], gear * belief[13], gear * belief[14], gear * belief[15]
    slip_t = belief[7] - gx * sin_t + gy * cos_t
    slip_i = belief[8] - gx * math.sin(psi_i) + gy * math.cos(psi_i)
    v = rim * (1.0 - belief[11] - cx * cos_t - cy * sin_t)
    lam = psi_t - psi_i
    cos_l, cos_i = math.cos(lam), math.cos(delta_i)
    rate_t, _ = _steering(inputs[0], belief[4], table[6], table[8])
    rate_i, _ = _steering(inputs[1], delta_i, table[7], table[9])
    yaw_t = v * math.tan(belief[4] + belief[9]) / wheelbase
    across = v * (math.sin(lam) + slip_t * cos_l - slip_i) - a * yaw_t * cos_l
    rate[0] = v * (cos_t - slip_t * sin_t)
    rate[1] = v * (sin_t + slip_t * cos_t)
    rate[2] = yaw_t
    rate[3] = (across - d * rate_i * cos_i) / (length_i + d * cos_i)
    rate[4] = rate_t
    rate[5] = rate_i
    rate[6] = (table[4] * inputs[2] - rim) / table[5] + belief[10]


@numba.njit(cache=True)
def slope_of(belief: FloatArray, inputs: FloatArray, table: FloatArray, slope: FloatArray) -> None:
    """Write d `rate_of` / d belief into `slope` (7, 16)."""
    psi_t, psi_i, delta_i, rim = belief[2], belief[3], belief[5], belief[6]
    wheelbase, a, d, length_i = table[0], table[1], table[2], table[3]
    sin_t, cos_t = math.sin(psi_t), math.cos(psi_t)
    sin_p, cos_p = math.sin(psi_i), math.cos(psi_i)
    gear = math.copysign(1.0, rim)
    gx, gy, cx, cy = gear * belief[12], gear * belief[13], gear * belief[14], gear * belief[15]
    slip_t = belief[7] - gx * sin_t + gy * cos_t
    slip_i = belief[8] - gx * sin_p + gy * cos_p
    share = 1.0 - belief[11] - cx * cos_t - cy * sin_t
    v = rim * share
    lam = psi_t - psi_i
    sin_l, cos_l = math.sin(lam), math.cos(lam)
    sin_i, cos_i = math.sin(delta_i), math.cos(delta_i)
    _, gain_t = _steering(inputs[0], belief[4], table[6], table[8])
    rate_i, gain_i = _steering(inputs[1], delta_i, table[7], table[9])
    angle = belief[4] + belief[9]
    yaw_t_v = math.tan(angle) / wheelbase
    yaw_t_delta = v / (wheelbase * math.cos(angle) ** 2)
    arm = length_i + d * cos_i
    yaw_i_v = (sin_l + slip_t * cos_l - slip_i - a * yaw_t_v * cos_l) / arm
    yaw_i = v * yaw_i_v - d * rate_i * cos_i / arm
    yaw_i_lam = v * (cos_l - slip_t * sin_l + a * yaw_t_v * sin_l) / arm
    yaw_i_delta_t = -a * yaw_t_delta * cos_l / arm
    yaw_i_rate = -d * cos_i / arm

    slope[:, :] = 0.0
    slope[0, 2] = -v * (sin_t + slip_t * cos_t)
    slope[1, 2] = v * (cos_t - slip_t * sin_t)
    slope[2, 4] = slope[2, 9] = yaw_t_delta
    slope[3, 2] = yaw_i_lam
    slope[3, 3] = -yaw_i_lam
    slope[3, 4] = slope[3, 9] = yaw_i_delta_t
    slope[3, 5] = d * sin_i * (rate_i + yaw_i) / arm - yaw_i_rate * gain_i
    slope[4, 4] = -gain_t
    slope[5, 5] = -gain_i
    slope[6, 6] = -1.0 / table[5]
    slope[6, 10] = 1.0
    # Through the speed v = rim share, and through the side slips.
    by_v = (cos_t - slip_t * sin_t, sin_t + slip_t * cos_t, yaw_t_v, yaw_i_v)
    by_slip_t = (-v * sin_t, v * cos_t, 0.0, v * cos_l / arm)
    by_slip_i = -v / arm
    v_psi = rim * (cx * sin_t - cy * cos_t)
    for row in range(4):
        slope[row, 2] += by_v[row] * v_psi + by_slip_t[row] * (-gx * cos_t - gy * sin_t)
        slope[row, 6] = by_v[row] * share
        slope[row, 7] = by_slip_t[row]
        slope[row, 11] = -by_v[row] * rim
        slope[row, 12] = -gear * by_slip_t[row] * sin_t
        slope[row, 13] = gear * by_slip_t[row] * cos_t
        slope[row, 14] = -gear * by_v[row] * rim * cos_t
        slope[row, 15] = -gear * by_v[row] * rim * sin_t
    slope[3, 3] += by_slip_i * (-gx * cos_p - gy * sin_p)
    slope[3, 8] = by_slip_i
    slope[3, 12] -= gear * by_slip_i * sin_p
    slope[3, 13] += gear * by_slip_i * cos_p


@numba.njit(cache=True)
def advance_belief(
    belief: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    table: FloatArray,
    memory: FloatArray,
    step_s: float,
    transition: FloatArray,
) -> None:
    """Move `belief` (16,) and `valves` (2,) on by a step in place; write d after / d before.

    The valves run to the `command` (3,) as in `valves.slew`; then one Runge-Kutta step as
    in `kinematics.advance`. Disturbances fade by exp(-travel / memory), `memory` (9,) [m].
    `transition` (16, 16) is the exponential of the Jacobian in the middle of the step.
    """
    inputs = np.empty(3)
    inputs[2] = command[2]
    for i in range(2):
        reach = table[8 + i] * step_s
        after = min(max(command[i], valves[i] - reach), valves[i] + reach)
        inputs[i] = 0.5 * (valves[i] + after)
        valves[i] = after
    moved = belief.copy()
    rates = np.empty((4, _N))
    rate_of(belief, inputs, table, rates[0])
    for stage in range(3):
        share = step_s if stage == 2 else 0.5 * step_s
        for i in range(_N):
            moved[i] = belief[i] + share * rates[stage, i]
        rate_of(moved, inputs, table, rates[stage + 1])
    middle = belief.copy()
    for i in range(_N):
        change = step_s / 6.0 * (rates[0, i] + 2.0 * (rates[1, i] + rates[2, i]) + rates[3, i])
        middle[i] = belief[i] + 0.5 * change
        belief[i] += change
    fade = np.empty(_ALL - _N)
    for j in range(_ALL - _N):
        fade[j] = -abs(middle[6]) * step_s / memory[j]
    slope = np.empty((_N, _ALL))
    slope_of(middle, inputs, table, slope)

    # exp([[A, B], [0, F]]) by Horner's scheme, F diagonal: only the upper rows are full.
    transition[:, :] = 0.0
    for i in range(_ALL):
        transition[i, i] = 1.0
    held = np.empty((_N, _ALL))
    for term in range(_TERMS, 0, -1):
        held[:, :] = transition[:_N]
        share = step_s / term
        for i in range(_N):
            for j in range(_ALL):
                transition[i, j] = slope[i, j] * transition[j, j] if j >= _N else 0.0
            for k in range(_N):
                for j in range(_ALL):
                    transition[i, j] += slope[i, k] * held[k, j]
            for j in range(_ALL):
                transition[i, j] *= share
        for i in range(_N):
            transition[i, i] += 1.0
        for j in range(_N, _ALL):
            transition[j, j] = 1.0 + fade[j - _N] * transition[j, j] / term
    for j in range(_ALL - _N):
        belief[_N + j] *= math.exp(fade[j])


@numba.njit(cache=True)
def expect(
    sensor: int, belief: FloatArray, table: FloatArray, reading: FloatArray, by_belief: FloatArray
) -> int:
    """Write what a sensor should read, (2,), and its derivative, (2, 16); return its entries.

    `sensor` is the place of the sensor in `ttempc.estimation.measurement_model.LENGTH`.
    """
    by_belief[:, :] = 0.0
    if sensor == 0:
        reading[0], reading[1] = belief[0], belief[1]
        by_belief[0, 0] = by_belief[1, 1] = 1.0
        return 2
    if sensor == 1:
        psi_t, psi_i, psi_d = belief[2], belief[3], belief[3] + belief[5]
        a, d, length_i = table[1], table[2], table[3]
        drawbar_x, drawbar_y = d * math.sin(psi_d), -d * math.cos(psi_d)
        trailer_x, trailer_y = length_i * math.sin(psi_i), -length_i * math.cos(psi_i)
        tractor_x, tractor_y = a * math.sin(psi_t), -a * math.cos(psi_t)
        reading[0] = belief[0] + tractor_y + drawbar_y + trailer_y
        reading[1] = belief[1] - tractor_x - drawbar_x - trailer_x
        by_belief[0, 0] = by_belief[1, 1] = 1.0
        by_belief[0, 2], by_belief[1, 2] = tractor_x, tractor_y
        by_belief[0, 3], by_belief[1, 3] = drawbar_x + trailer_x, drawbar_y + trailer_y
        by_belief[0, 5], by_belief[1, 5] = drawbar_x, drawbar_y
        return 2
    if sensor == 4:
        reading[0] = belief[2] - belief[3] - belief[5]
        by_belief[0, 2], by_belief[0, 3], by_belief[0, 5] = 1.0, -1.0, -1.0
        return 1
    column = sensor + 2 if sensor < 4 else 6
    reading[0] = belief[column]
    by_belief[0, column] = 1.0
    return 1
