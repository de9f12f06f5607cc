"""Feedforward action of the paper."""

from __future__ import annotations

import numpy as np

from ..reference.reference import ReferenceSample
from ..types import FloatArray
from ..vehicle import Vehicle
from .equations import PaperEquations


def printed_feedforward(
    reference: ReferenceSample, vehicle: Vehicle, equations: PaperEquations
) -> FloatArray:
    """Return u_f = (delta^t_r, lambda_r, HP_r) of eq. (ffcontrolaction), (N, 3).

    With a straight drawbar and small angles, lambda_r = (gamma^i L^i - s gamma^t L^d) / v, where
    s is the sign at the hitch (+1 as printed). The paper's delta^i_r is lambda_r - beta.
    """
    v = reference.state[:, -1]
    lever_i = reference.yaw_rate_i * vehicle.trailer_length
    lever_t = equations.hitch_sign * reference.yaw_rate_t * vehicle.drawbar_offset
    return np.stack(
        [
            reference.yaw_rate_t * vehicle.wheelbase / v,
            (lever_i - lever_t) / v,
            v / vehicle.speed_gain,
        ],
        axis=-1,
    )
