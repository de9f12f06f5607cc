"""The paper's tracking error of tractor and trailer, and its linear model along the reference."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from ttempc.equations import PaperEquations
from ttempc.kinematics import wrap_angle
from ttempc.reference import ReferenceSample
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle


class Error(IntEnum):
    """Index of each entry of the tracking error z_e: where the reference lies, seen from each body.

    Positions in the frame of the body [m], x forward, y left; yaw [rad]; speed [m/s].
    """

    X_T = 0
    Y_T = 1
    PSI_T = 2
    X_I = 3
    Y_I = 4
    PSI_I = 5
    V = 6


_TAYLOR_TERMS = 15

POSITIONS = (Error.X_T, Error.Y_T, Error.X_I, Error.Y_I)


def tracking_error(
    state: FloatArray,
    trailer_xy: FloatArray,
    reference_state: FloatArray,
    reference_trailer_xy: FloatArray,
) -> FloatArray:
    """Return z_e = T (z_r - z), eq. (errorstate), (7,) in the order of `Error`.

    Both states (7,) are minimal ones (`State`); T turns positions into the frames of the actual
    bodies. Yaw errors lie in [-pi, pi].
    """
    x, y, psi_t, psi_i, _, _, v = state.tolist()
    x_r, y_r, psi_t_r, psi_i_r, _, _, v_r = reference_state.tolist()
    x_i, y_i = trailer_xy.tolist()
    x_i_r, y_i_r = reference_trailer_xy.tolist()
    dx, dy, cos, sin = x_r - x, y_r - y, math.cos(psi_t), math.sin(psi_t)
    dx_i, dy_i, cos_i, sin_i = x_i_r - x_i, y_i_r - y_i, math.cos(psi_i), math.sin(psi_i)
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


def linearise(
    reference: ReferenceSample, vehicle: Vehicle, equations: PaperEquations
) -> tuple[FloatArray, FloatArray]:
    """Return A (N, 7, 7) and B (N, 7, 3) of eq. (errorstateupdate) at N reference samples.

    z_e' = A z_e + B u_e with u_e = u_r - u, u = (delta^t, lambda, HP).
    """
    v = reference.state[:, -1]
    speed_i = v if equations.trailer_speed == "tractor" else reference.speed_i
    length_t, length_i = vehicle.wheelbase, vehicle.trailer_length
    tau = vehicle.speed_time_constant
    seen = {"trailer": (Error.X_I, Error.Y_I), "tractor": (Error.X_T, Error.Y_T)}
    x_i, y_i = seen[equations.trailer_error_frame]

    a = np.zeros((len(v), 7, 7))
    a[:, Error.X_T, Error.Y_T] = reference.yaw_rate_t
    a[:, Error.X_T, Error.V] = 1.0
    a[:, Error.Y_T, Error.X_T] = -reference.yaw_rate_t
    a[:, Error.Y_T, Error.PSI_T] = v
    a[:, Error.X_I, y_i] = reference.yaw_rate_i
    a[:, Error.X_I, Error.V] = speed_i / v
    a[:, Error.Y_I, x_i] = -reference.yaw_rate_i
    a[:, Error.Y_I, Error.PSI_I] = speed_i
    a[:, Error.V, Error.V] = -1.0 / tau

    b = np.zeros((len(v), 7, 3))
    b[:, Error.PSI_T, 0] = v / length_t
    b[:, Error.PSI_I, 0] = equations.hitch_sign * v * vehicle.drawbar_offset / (length_t * length_i)
    b[:, Error.PSI_I, 1] = v / length_i
    b[:, Error.V, 2] = vehicle.speed_gain / tau
    return a, b


def zero_order_hold(a: FloatArray, b: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A_d (N, n, n) and B_d (N, n, m) of z' = A z + B u with u held for `period_s`.

    By the exponential of the block matrix [[A, B], [0, 0]] (Van Loan 1978), all samples at once.
    """
    count, n, m = b.shape
    block = np.zeros((count, n + m, n + m))
    block[:, :n, :n] = a * period_s
    block[:, :n, n:] = b * period_s
    held = _exponential(block)  # (N, n + m, n + m)
    return held[:, :n, :n].copy(), held[:, :n, n:].copy()


def _exponential(matrices: FloatArray) -> FloatArray:
    """Return exp of each of (N, n, n) matrices by Taylor's series, scaled and squared.

    scipy's expm takes one matrix after the other and wakes a pool of threads for each: 20 times
    slower along a reference, and far more on a busy machine. Scaled to a norm of 1/2, 15 terms
    leave less than 1e-17.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, math.frexp(norm)[1] + 1)
    scaled = matrices / 2.0**squarings
    unit = np.eye(matrices.shape[-1])
    result = unit + scaled / _TAYLOR_TERMS
    for order in range(_TAYLOR_TERMS - 1, 0, -1):
        result = unit + scaled @ result / order
    for _ in range(squarings):
        result = result @ result
    return result
