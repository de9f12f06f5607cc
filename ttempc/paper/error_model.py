"""Linear model of the tracking error along the reference, as in the paper."""

from __future__ import annotations

import numpy as np

from ..models.tracking_error import Error
from ..reference.reference import ReferenceSample
from ..types import FloatArray
from ..vehicle import Vehicle
from .equations import PaperEquations


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
    frames = {"trailer": (Error.X_I, Error.Y_I), "tractor": (Error.X_T, Error.Y_T)}
    x_i, y_i = frames[equations.trailer_error_frame]

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
