"""Linear quadratic regulator: the linear MPC's model and outputs, without horizon and bounds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..laws.articulated_mpc import TUNING
from ..laws.tracking_controller import Actions, TrackingController, around_exact_feedforward
from ..mpc.articulated_error import error_dynamics, error_state
from ..mpc.qp import HorizonTuning
from ..mpc.riccati import riccati_gains
from ..reference.reference import Reference, ReferenceSample
from ..types import Estimate, FloatArray, Input
from ..vehicle import Vehicle

_M = len(Input)

# Steps weigh more than in the MPC. With its weights an LQR, which knows no bounds, runs into the
# rates of the valves from an offset of some decimetres on and cycles there by metres.
LQR_TUNING = replace(TUNING, step_weight=(1.0, 1.0, 1.0))

# What lies farther ahead than this does not move the gain any more: a dozen vehicle lengths.
_BEYOND_S = 30.0


def step_gains(
    a: FloatArray, b: FloatArray, c: FloatArray, output_weight: FloatArray, step_weight: FloatArray
) -> FloatArray:
    """Return the gains K (N, m, n + m) of the steps Delta u_k = -K_k (z_k, u_{k-1}).

    They minimise sum y_k' Q y_k + sum Delta u_k' R Delta u_k over all N stages of

        z_{k+1} = A_k z_k + B_k u_k,    y_k = C_k z_k,    u_k = u_{k-1} + Delta u_k,

    with A (N, n, n), B (N, n, m), C (N + 1, p, n) and the diagonal weights Q (p,), R (m,). The
    regulator's state is (z_k, u_{k-1}) and its terminal cost C_N' Q C_N.
    """
    count, n, m = b.shape
    augmented = np.zeros((count, n + m, n + m))  # of (z_k, u_{k-1})
    augmented[:, :n, :n], augmented[:, :n, n:] = a, b
    augmented[:, n:, n:] = np.eye(m)
    by_step = augmented[:, :, n:]  # a step acts as the previous input does
    cost = np.zeros((count + 1, n + m, n + m))
    cost[:, :n, :n] = [(outputs.T * output_weight) @ outputs for outputs in c]
    return riccati_gains(augmented, by_step, cost[:-1], step_weight, cost[-1])


class LqrFeedback:
    """Time-varying state feedback on the error and the disturbance that lasts.

    The input of the period before is the one that was sent: what the limits cut off is not
    wound up.
    """

    def __init__(
        self,
        grid: ReferenceSample,
        reference: Reference,
        feedforward: FloatArray,
        period_s: float,
        tuning: HorizonTuning,
    ) -> None:
        a, b, c = error_dynamics(reference, period_s, len(feedforward))
        weights = np.array(tuning.output_weight), np.array(tuning.step_weight)
        self._gains = step_gains(a, b, c, *weights)
        self._feedforward = feedforward  # u_r (N, 3)
        self._state = grid.state
        self._vehicle = reference.vehicle

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        state = error_state(self._state[k], estimate, self._vehicle)
        before = self._feedforward[max(k - 1, 0)] - sent  # u_e(k-1)
        u_e = before - self._gains[k] @ np.concatenate([state, before])
        return Actions(feedback=-u_e, robust=np.zeros(_M))

    def prepare(self, k: int) -> None:
        """Do nothing: a product of a matrix and a vector needs no warming up."""


def lqr_controller(
    vehicle: Vehicle, reference: Reference, period_s: float, tuning: HorizonTuning = LQR_TUNING
) -> TrackingController:
    """Compose the exact feedforward and the LQR of the articulated error model."""

    def law(grid: ReferenceSample, feedforward: FloatArray) -> LqrFeedback:
        return LqrFeedback(grid, reference, feedforward, period_s, tuning)

    beyond = math.ceil(_BEYOND_S / period_s)
    return around_exact_feedforward(vehicle, reference, period_s, beyond, law)
