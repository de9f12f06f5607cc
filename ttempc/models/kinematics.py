"""Articulated kinematics of tractor and trailer by exact geometry, in continuous time.

Vehicle frame x forward, y left; angles counter-clockwise. Side slip enters as a disturbance.
"""

import math
from enum import IntEnum

import numpy as np

from ..reference.reference import ReferenceSample
from ..types import Disturbance, Estimate, FloatArray, State
from ..vehicle import Vehicle


def wrap_angle(angle: float) -> float:
    """Return `angle` [rad] modulo a turn, in [-pi, pi]."""
    return math.remainder(angle, math.tau)


def hitch_angle(state: FloatArray) -> float:
    """Return beta = psi_t - psi_d = psi_t - psi_i - delta_i [rad] of a minimal state (7,)."""
    return float(state[State.PSI_T] - state[State.PSI_I] - state[State.DELTA_I])


def trailer_point(state: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return the trailer point p_i = p_t - a e(psi_t) - d e(psi_d) - L_i e(psi_i), (2,) [m]."""
    x, y, psi_t, psi_i, _, delta_i, _ = state.tolist()
    psi_d = psi_i + delta_i
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    length_i = vehicle.trailer_length
    return np.array(
        [
            x - a * math.cos(psi_t) - d * math.cos(psi_d) - length_i * math.cos(psi_i),
            y - a * math.sin(psi_t) - d * math.sin(psi_d) - length_i * math.sin(psi_i),
        ]
    )


def trailer_point_jacobian(state: FloatArray, vehicle: Vehicle) -> FloatArray:
    """Return d `trailer_point` / d state, (2, 7)."""
    _, _, psi_t, psi_i, _, delta_i, _ = state.tolist()
    psi_d = psi_i + delta_i
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    length_i = vehicle.trailer_length
    drawbar_x = d * math.sin(psi_d)
    drawbar_y = -d * math.cos(psi_d)
    jacobian = np.zeros((2, 7))
    jacobian[0, State.X] = jacobian[1, State.Y] = 1.0
    jacobian[:, State.PSI_T] = a * math.sin(psi_t), -a * math.cos(psi_t)
    jacobian[:, State.PSI_I] = (
        drawbar_x + length_i * math.sin(psi_i),
        drawbar_y - length_i * math.cos(psi_i),
    )
    jacobian[:, State.DELTA_I] = drawbar_x, drawbar_y
    return jacobian


NO_DISTURBANCE = np.zeros(len(Disturbance))
NO_DISTURBANCE.setflags(write=False)


def articulated(
    state: FloatArray,
    inputs: FloatArray,
    vehicle: Vehicle,
    disturbance: FloatArray = NO_DISTURBANCE,
) -> FloatArray:
    """Return the time derivative (7,) of the minimal state (7,) by exact geometry.

    With lambda = psi_t - psi_i, RJ1 a behind the rear axle, side slips s_t and s_i of rear and
    trailer axle, a steering bias b and a drive disturbance w (`Disturbance`, small angles),

        x'     = v (cos(psi_t) - s_t sin(psi_t)),   y' = v (sin(psi_t) + s_t cos(psi_t))
        psi_t' = v tan(delta_t + b) / L_t
        psi_i' = (v (sin(lambda) + s_t cos(lambda) - s_i) - a psi_t' cos(lambda)
                  - d delta_i' cos(delta_i)) / (L_i + c + d cos(delta_i))
        v'     = (K hp - v) / tau + w,

    and the steering angles follow their commands `inputs` (3,) with a first-order lag of limited
    rate. The wheel slip of `disturbance` (5,) has no effect, since v is the speed over ground.
    Derived from the velocities of RJ1 and RJ2; the paper's eq. (kinematicmodel) has another sign at
    the hitch and takes lambda as an input.
    """
    _, _, psi_t, psi_i, delta_t, delta_i, v = state.tolist()
    u_t, u_i, hp = inputs.tolist()
    slip_t, slip_i, bias, drive, _ = disturbance.tolist()
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    lam = psi_t - psi_i
    cos_t = math.cos(psi_t)
    sin_t = math.sin(psi_t)
    cos_l = math.cos(lam)

    # Steering angles: a first-order lag of limited rate
    fastest_t = vehicle.steering_rate_t
    fastest_i = vehicle.steering_rate_i
    rate_t = min(max((u_t - delta_t) / vehicle.steering_lag_t, -fastest_t), fastest_t)
    rate_i = min(max((u_i - delta_i) / vehicle.steering_lag_i, -fastest_i), fastest_i)

    # Yaw rates: `across` is the velocity of RJ1 across the trailer, less the trailer's side slip
    yaw_t = v * math.tan(delta_t + bias) / vehicle.wheelbase
    across = v * (math.sin(lam) + slip_t * cos_l - slip_i) - a * yaw_t * cos_l
    cos_i = math.cos(delta_i)
    length_i = vehicle.trailer_length + vehicle.trailer_turning_offset
    yaw_i = (across - d * rate_i * cos_i) / (length_i + d * cos_i)
    acceleration = (vehicle.speed_gain * hp - v) / vehicle.speed_time_constant + drive
    v_x = v * (cos_t - slip_t * sin_t)
    v_y = v * (sin_t + slip_t * cos_t)
    return np.array([v_x, v_y, yaw_t, yaw_i, rate_t, rate_i, acceleration])


class Error(IntEnum):
    """Index of each entry of the tracking error z_e: reference less actual value.

    Positions are in the frame of the body itself [m], x forward, y left; yaw [rad]; speed [m/s].
    """

    X_T = 0
    Y_T = 1
    PSI_T = 2
    X_I = 3
    Y_I = 4
    PSI_I = 5
    V = 6


POSITIONS = (Error.X_T, Error.Y_T, Error.X_I, Error.Y_I)


def tracking_error(
    state: FloatArray,
    trailer_xy: FloatArray,
    reference_state: FloatArray,
    reference_trailer_xy: FloatArray,
) -> FloatArray:
    """Return z_e = T (z_r - z), eq. (errorstate), (7,) in the order of `Error`.

    Both states (7,) are minimal ones (`State`), both trailer points (2,) [m]. T rotates positions
    into the frames of the actual bodies. Yaw errors lie in [-pi, pi].
    """
    x, y, psi_t, psi_i, _, _, v = state.tolist()
    x_r, y_r, psi_t_r, psi_i_r, _, _, v_r = reference_state.tolist()
    x_i, y_i = trailer_xy.tolist()
    x_i_r, y_i_r = reference_trailer_xy.tolist()
    dx = x_r - x
    dy = y_r - y
    cos = math.cos(psi_t)
    sin = math.sin(psi_t)
    dx_i = x_i_r - x_i
    dy_i = y_i_r - y_i
    cos_i = math.cos(psi_i)
    sin_i = math.sin(psi_i)
    return np.array(
        [
            cos * dx + sin * dy,
            cos * dy - sin * dx,
            wrap_angle(psi_t_r - psi_t),
            cos_i * dx_i + sin_i * dy_i,
            cos_i * dy_i - sin_i * dx_i,
            wrap_angle(psi_i_r - psi_i),
            v_r - v,
        ]
    )


def estimated_error(estimate: Estimate, reference: ReferenceSample, k: int) -> FloatArray:
    """Return the tracking error z_e (7,) of an estimate to sample `k` of a reference."""
    return tracking_error(
        estimate.state, estimate.trailer_xy, reference.state[k], reference.trailer_xy[k]
    )
