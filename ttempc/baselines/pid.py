"""Conventional guidance: a loop for each of front steering, trailer steering and speed.

Feedback on cross-track and heading error beside a feedforward of the path's curvature is the
guidance of commercial machines (O'Connor, Bell, Elkaim and Parkinson 1996, "Automatic steering of
farm vehicles using GPS", Proc. Precision Agriculture; Thuilot, Cariou, Martinet and Berducat 2002,
"Automatic guidance of a farm tractor relying on a single CP-DGPS", Autonomous Robots 13). Every
loop is designed for itself, on straight motion at the reference's speed, and knows nothing of the
others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..laws.tracking_controller import Actions, TrackingController, around_exact_feedforward
from ..models.tracking_error import Error, estimated_error
from ..reference.reference import Reference, ReferenceSample
from ..types import Estimate, FloatArray, Input, State
from ..vehicle import Vehicle

# Closed loops are this many times slower than what they leave out, the steering's lag and half
# of a period; a triple pole then keeps a phase margin of 40 deg.
_SLOWER = 6.0
_SLOWEST_MPS = 0.3  # no gain is made for less, for it would grow beyond all bounds; assumed


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains on an error e: action = -(proportional e + integral int e dt + derivative e')."""

    proportional: FloatArray  # (N,) at every tick
    integral: FloatArray  # (N,)
    derivative: FloatArray  # (N,)


def front_steering_gains(speed: FloatArray, vehicle: Vehicle, period_s: float) -> Gains:
    """Return the gains from the tractor's cross-track error [m] to its steering [rad].

    e' = v psi_e, psi_e' = v delta_t / L^t: two integrators, e'' = v^2 delta_t / L^t. With all
    three actions the poles are those of s^3 + 3 p s^2 + 3 p^2 s + p^3, p in `pole`.
    """
    p = pole(vehicle.steering_lag_t, period_s)
    inverse = vehicle.wheelbase / _rolling(speed) ** 2
    return Gains(3.0 * p**2 * inverse, p**3 * inverse, 3.0 * p * inverse)


def trailer_steering_gains(speed: FloatArray, vehicle: Vehicle, period_s: float) -> Gains:
    """Return the gains from the trailer's cross-track error [m] to its steering [rad].

    With D = d + L^i, a point at the end of a straight trailer behind a tractor on the path obeys

        (D / v) e' + e = -d delta_i:

    the steering sets the trailer aside by the drawbar's length, and it gets there as it rolls.
    That is of first order: two actions place both poles at -p, a derivative would only pass
    noise on. In reverse the lag is negative, and the same two poles hold the trailer. Forwards a
    loop slower than the trailer by itself would need a gain of the wrong sign: then p = v / 2D,
    the integral action alone.
    """
    d = vehicle.drawbar_length
    lag = (d + vehicle.trailer_length) / _rolling(speed)
    p = np.maximum(pole(vehicle.steering_lag_i, period_s), 0.5 / np.abs(lag))
    return Gains((1.0 - 2.0 * p * lag) / d, -(p**2) * lag / d, np.zeros_like(lag))


def speed_gains(speed: FloatArray, vehicle: Vehicle) -> Gains:
    """Return the gains from the along-track error [m] to the hydrostat's position.

    A PI law on the speed v_r - k e, which asks for less of it the farther the vehicle is ahead,
    comes to all three actions on e, for e' = v - v_r. The poles of

        tau v' + v = K hp

    and e go to -1 / tau, as fast as the drive by itself.
    """
    tau, unit = vehicle.speed_time_constant, np.ones_like(speed) / vehicle.speed_gain
    return Gains(3.0 / tau * unit, 1.0 / tau**2 * unit, 2.0 * unit)


def _rolling(speed: FloatArray) -> FloatArray:
    """Return the speed, or where it is slower the least for which gains are made [m/s]."""
    return np.copysign(np.maximum(np.abs(speed), _SLOWEST_MPS), speed)


def pole(lag_s: float, period_s: float) -> float:
    """Return how fast a steering loop may be [1/s]."""
    return 1.0 / (_SLOWER * (lag_s + 0.5 * period_s))


class GuidanceFeedback:
    """Three loops, each on its own error; an integral waits while its input is at a limit."""

    def __init__(
        self, grid: ReferenceSample, feedforward: FloatArray, vehicle: Vehicle, period_s: float
    ) -> None:
        self._grid = grid
        self._feedforward = feedforward
        self._period_s = period_s
        speed = grid.state[:, State.V]
        loops = (
            front_steering_gains(speed, vehicle, period_s),
            trailer_steering_gains(grid.speed_i, vehicle, period_s),
            speed_gains(speed, vehicle),
        )
        self._proportional = np.stack([loop.proportional for loop in loops], axis=-1)  # (N, 3)
        self._integral = np.stack([loop.integral for loop in loops], axis=-1)
        self._derivative = np.stack([loop.derivative for loop in loops], axis=-1)
        self._speed = np.stack([speed, grid.speed_i], axis=-1)
        self._summed = np.zeros(3)  # integral actions
        self._wanted = feedforward[0]  # command of the period before, without the limits

    def step(self, k: int, estimate: Estimate, sent: FloatArray) -> Actions:
        """Return the actions of tick `k`."""
        error = estimated_error(estimate, self._grid, k)
        aside = -np.array([error[Error.Y_T], error[Error.Y_I], error[Error.X_T]])
        speed_t, speed_i = self._speed[k]
        moving = -np.array(
            [
                speed_t * np.sin(error[Error.PSI_T]),
                speed_i * np.sin(error[Error.PSI_I]),
                error[Error.V],
            ]
        )
        growth = -self._integral[k] * aside * self._period_s
        winding_up = (self._wanted - sent) * growth > 0.0
        if k > 0:
            self._summed += np.where(winding_up, 0.0, growth)
        feedback = self._summed - self._proportional[k] * aside - self._derivative[k] * moving
        self._wanted = self._feedforward[k] + feedback
        return Actions(feedback=feedback, robust=np.zeros(len(Input)))

    def prepare(self, k: int) -> None:
        """Do nothing: there is nothing to warm up."""


def pid_controller(vehicle: Vehicle, reference: Reference, period_s: float) -> TrackingController:
    """Compose the exact feedforward and conventional guidance."""

    def law(grid: ReferenceSample, feedforward: FloatArray) -> GuidanceFeedback:
        return GuidanceFeedback(grid, feedforward, vehicle, period_s)

    return around_exact_feedforward(vehicle, reference, period_s, 1, law)
