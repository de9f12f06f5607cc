"""The feedforward action: the inputs that would drive a perfect vehicle along the reference."""

from __future__ import annotations

import numpy as np

from ttempc.equations import PaperEquations
from ttempc.reference import Reference, ReferenceSample
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle


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


def exact_feedforward(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return (delta_t, delta_i, hp) of the exact posture, (`ticks`, 3).

    Taken in the middle of each period, because an input held for a period lags by half of it.
    """
    return reference.at((np.arange(ticks) + 0.5) * period_s).inputs
