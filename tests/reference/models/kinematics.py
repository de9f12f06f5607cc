"""Integration of the articulated model, and the tricycle model of the paper."""

from __future__ import annotations

import math

import numpy as np

from ttempc.models.kinematics import NO_DISTURBANCE, articulated
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle


def advance(
    state: FloatArray,
    inputs: FloatArray,
    vehicle: Vehicle,
    duration_s: float,
    disturbance: FloatArray = NO_DISTURBANCE,
) -> FloatArray:
    """Return the state (7,) of `articulated` after `duration_s` under constant inputs (3,).

    One classical Runge-Kutta step: keep the duration below a third of the shortest lag.
    """
    half = 0.5 * duration_s
    k1 = articulated(state, inputs, vehicle, disturbance)
    k2 = articulated(state + half * k1, inputs, vehicle, disturbance)
    k3 = articulated(state + half * k2, inputs, vehicle, disturbance)
    k4 = articulated(state + duration_s * k3, inputs, vehicle, disturbance)
    return state + duration_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def tricycle(
    state: FloatArray, inputs: FloatArray, vehicle: Vehicle, hitch_sign: float = 1.0
) -> FloatArray:
    """Return the time derivative (7,) of the paper's model, eq. (kinematicmodel).

    `state` is z = (x^t, y^t, psi^t, x^i, y^i, psi^i, v), `inputs` u = (delta^t, lambda, HP).
    `hitch_sign` is +1 as printed. Geometry gives -1, because a hitch behind the rear axle swings
    against the tractor's turn. The relation holds for the drawbar length L^d and small angles.
    """
    _, _, psi_t, _, _, psi_i, v = state.tolist()
    delta_t, lam, hp = inputs.tolist()
    lead = vehicle.drawbar_offset / vehicle.wheelbase
    yaw_i = math.sin(lam) + hitch_sign * lead * math.tan(delta_t) * math.cos(lam)
    return np.array(
        [
            v * math.cos(psi_t),
            v * math.sin(psi_t),
            v * math.tan(delta_t) / vehicle.wheelbase,
            v * math.cos(psi_i),
            v * math.sin(psi_i),
            v * yaw_i / vehicle.trailer_length,
            (vehicle.speed_gain * hp - v) / vehicle.speed_time_constant,
        ]
    )
