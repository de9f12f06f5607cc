"""Tracking error of tractor and trailer in the frames of the bodies."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from ..reference.reference import ReferenceSample
from ..types import Estimate, FloatArray
from .kinematics import wrap_angle


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


def estimated_error(estimate: Estimate, reference: ReferenceSample, k: int) -> FloatArray:
    """Return the tracking error z_e (7,) of an estimate to sample `k` of a reference."""
    return tracking_error(
        estimate.state, estimate.trailer_xy, reference.state[k], reference.trailer_xy[k]
    )
