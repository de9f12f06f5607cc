"""Integration of the articulated model."""

from __future__ import annotations

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
