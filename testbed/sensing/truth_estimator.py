"""Truth estimator: true state and true disturbances, for control without estimation error."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ttempc.types import Command, Disturbance, Estimate, Estimator, FloatArray, Measurement, State
from ttempc.vehicle import Vehicle

from ..truth import Pose, Truth

MEMORY_M: Final = 3.0
"""Distance [m] over which disturbances are averaged, with exponential weights.

Chosen for the error of `ttempc` on five fields with seeds 1 and 2: from 2 to 5 m it changes by at
most 0.6 cm; with 1 m the law acts on oscillations that end before it can correct them.
"""

MEMORY_S: Final = 3.0
"""Time [s] over which they are averaged at least.

The tyres follow the steering with a lag and a slip. An observer as fast as the law returns both as
a disturbance, the law compensates it, and the loop cycles.
"""

_LEAST_M: Final = 1e-3  # driven in a period, below which nothing is learned


class TruthEstimator(Estimator):
    """Estimator that returns the plant's state; satisfies `ttempc.types.Estimator`.

    The disturbances are what the model lacks to the true motion from tick to tick. With (s, l) and
    (s_i, l_i), the displacements of tractor and trailer point along and across the mean heading of
    their bodies in a period T, the wheel speed v_w, and the symbols of
    `ttempc.models.kinematics.articulated`:

        slips    l / s,   (l_i - c dpsi_i) / s,   1 - s / (T v_w)
        steering atan(L_t dpsi_t / s) - delta_t
        drive    ((v(k+1) - a v(k)) / (1 - a) - K hp) / tau,   a = exp(-T / tau)

    They are averaged over the last `MEMORY_M` metres, and at least `MEMORY_S` seconds: a controller
    can compensate the part that persists, not the oscillation of a wheel on the next bump. The
    speed is, for the same reason, the wheel speed less the mean slip. Nothing is counted as fixed
    in the map: filters that split the slips gained up to 0.2 cm on `side-slope` and nothing on
    `wet-slope`.

    Args:
        truth: returns the plant's present state.
        vehicle: model that the disturbances complete.
    """

    def __init__(self, truth: Callable[[], Truth], vehicle: Vehicle) -> None:
        self._truth = truth
        self._vehicle = vehicle
        self._last: Truth | None = None
        self._disturbance = np.zeros(len(Disturbance))

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the truth with a covariance of zero; measurements are ignored."""
        truth = self._truth()
        if self._last and command:
            self._learn(self._last, truth, command)
        self._last = truth
        state = np.empty(len(State))
        state[State.X] = truth.tractor.x
        state[State.Y] = truth.tractor.y
        state[State.PSI_T] = truth.tractor.yaw
        state[State.PSI_I] = truth.trailer.yaw
        state[State.DELTA_T] = truth.delta_t
        state[State.DELTA_I] = truth.delta_i
        state[State.V] = truth.wheel_speed * (1.0 - self._disturbance[Disturbance.WHEEL])
        return Estimate(
            time_s,
            state,
            np.zeros((len(State), len(State))),
            np.array([truth.trailer.x, truth.trailer.y]),
            truth.beta,
            disturbance=self._disturbance.copy(),
        )

    def _learn(self, last: Truth, truth: Truth, command: Command) -> None:
        """Average the disturbances of the period between two ticks into those before."""
        along, across_t = _displacement(last.tractor, truth.tractor)
        period = truth.time_s - last.time_s
        wheel_speed = 0.5 * (last.wheel_speed + truth.wheel_speed)
        if abs(along) < _LEAST_M or abs(wheel_speed) * period < _LEAST_M:
            return
        _, across_i = _displacement(last.trailer, truth.trailer)
        vehicle = self._vehicle
        turn = _turn(last.tractor, truth.tractor)
        decay = math.exp(-period / vehicle.speed_time_constant)
        steady = (truth.speed - decay * last.speed) / (1.0 - decay)
        present: FloatArray = np.empty(len(Disturbance))
        present[Disturbance.SLIP_T] = across_t / along
        turning = vehicle.trailer_turning_offset * _turn(last.trailer, truth.trailer)
        present[Disturbance.SLIP_I] = (across_i - turning) / along
        present[Disturbance.STEERING] = math.atan(vehicle.wheelbase * turn / along) - 0.5 * (
            last.delta_t + truth.delta_t
        )
        present[Disturbance.DRIVE] = (
            steady - vehicle.speed_gain * command.hp
        ) / vehicle.speed_time_constant
        present[Disturbance.WHEEL] = 1.0 - along / (period * wheel_speed)
        share_of_memory = min(abs(along) / MEMORY_M, period / MEMORY_S)
        weight = -math.expm1(-share_of_memory)
        self._disturbance += weight * (present - self._disturbance)


def _turn(last: Pose, pose: Pose) -> float:
    """Return the change of yaw [rad]."""
    return math.remainder(pose.yaw - last.yaw, math.tau)


def _displacement(last: Pose, pose: Pose) -> tuple[float, float]:
    """Return the displacement along and across the mean heading of two poses [m]."""
    heading = last.yaw + 0.5 * _turn(last, pose)
    cos = math.cos(heading)
    sin = math.sin(heading)
    dx = pose.x - last.x
    dy = pose.y - last.y
    return cos * dx + sin * dy, cos * dy - sin * dx
