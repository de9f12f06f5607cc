"""Time-based reference of tractor and trailer along a path, with its inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidReference
from ..types import FloatArray, Input, State
from ..vehicle import Vehicle
from .corridor import Corridor
from .path import Path
from .posture import posture_on_path


class SpeedProfile(Protocol):
    """Arc length and speed of the tractor point as functions of time.

    A negative speed drives in reverse, towards smaller arc lengths.
    """

    @property
    def top_speed(self) -> float:
        """Largest speed of the profile, forward or in reverse [m/s]."""
        ...

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc length [m], speed [m/s] and acceleration [m/s^2] at `times_s`."""
        ...

    def duration_s(self, length_m: float) -> float:
        """Return the time that `length_m` takes [s]."""
        ...


@dataclass(frozen=True, slots=True)
class ConstantSpeed:
    """One speed from the first instant on.

    Raises:
        InvalidReference: the speed is not finite or not above 0 (remark 3 of the paper).
    """

    speed: float = 1.0  # v_r [m/s]

    def __post_init__(self) -> None:
        if not math.isfinite(self.speed) or self.speed <= 0.0:
            raise InvalidReference(f"speed: got {self.speed} m/s, must be finite and above 0")

    @property
    def top_speed(self) -> float:
        """The speed itself [m/s]."""
        return self.speed

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc length [m], speed [m/s] and acceleration [m/s^2] at `times_s`."""
        return self.speed * times_s, np.full_like(times_s, self.speed), np.zeros_like(times_s)

    def duration_s(self, length_m: float) -> float:
        """Return the time that `length_m` takes [s]."""
        return length_m / self.speed


@dataclass(frozen=True, slots=True)
class ReferenceSample:
    """The reference at one time or at many; (...) is the shape of the times."""

    time_s: FloatArray  # (...) [s]
    distance_m: FloatArray  # (...) arc length of the tractor point [m]
    curvature: FloatArray  # (...) of the path at the tractor point [1/m], positive to the left
    state: FloatArray  # (..., 7) see `State`; yaw angles continuous
    inputs: FloatArray  # (..., 3) see `Input`; they keep the exact model on the reference
    trailer_xy: FloatArray  # (..., 2) [m] trailer point, map frame
    hitch_angle: FloatArray  # (...) beta_r [rad]
    yaw_rate_t: FloatArray  # (...) gamma^t_r [rad/s]
    yaw_rate_i: FloatArray  # (...) gamma^i_r [rad/s]
    speed_i: FloatArray  # (...) speed of the trailer point [m/s]

    @property
    def psi_d(self) -> FloatArray:
        """Yaw of the drawbar [rad], (...)."""
        return self.state[..., 2] - self.hitch_angle


@dataclass(frozen=True)
class Reference:
    """Both axle points of the vehicle on one path, as functions of time.

    The steering inputs lead the steering angles by the actuators' lags and the hydrostat leads
    the speed, so that the articulated model fed with them stays on the reference:

        u_delta = delta_r + lag delta_r',   hp = (v_r + tau v_r') / K.

    In steady motion these are delta_t = atan(L^t kappa), delta_i_r and hp = v_r / K. Times before 0
    and after `duration_s` are allowed, since the path continues there. In reverse the vehicle heads
    along the path and rolls back over it; the equations hold with a negative v_r.

    Raises:
        InvalidReference: the top speed of the profile is above that of the hydrostat, or the
            profile drives forward and the vehicle is in reverse gear, or the other way round.

    Examples:
        >>> from ttempc import Vehicle, figure_eight
        >>> reference = Reference(figure_eight(laps=1), Vehicle(), ConstantSpeed(1.0))
        >>> sample = reference.at([0.0, 10.0])  # state: (..., 7), inputs: (..., 3)
        >>> sample.state.shape, sample.inputs.shape
        ((2, 7), (2, 3))
    """

    path: Path
    vehicle: Vehicle
    speed: SpeedProfile
    lead_s: float = 0.0  # by which the time on the path is ahead of that of `at` [s]
    corridor: Corridor | None = None  # which the vehicle is to keep to; None: free ground

    def __post_init__(self) -> None:
        if self.speed.top_speed > self.vehicle.speed_gain:
            raise InvalidReference(
                f"speed: got {self.speed.top_speed} m/s, the hydrostat ends at "
                f"{self.vehicle.speed_gain} m/s"
            )
        _, speed, _ = self.speed.travel(np.zeros(1))
        if (speed[0] < 0.0) != self.vehicle.reverse:
            gear = "in reverse" if self.vehicle.reverse else "forward"
            raise InvalidReference(
                f"speed: got {speed[0]} m/s at the start, the vehicle is geared to drive {gear}"
            )

    @property
    def duration_s(self) -> float:
        """Time from the beginning of the path to its end [s]."""
        return self.speed.duration_s(self.path.length_m)

    def at(self, time_s: ArrayLike) -> ReferenceSample:
        """Return the reference at one time or at an array of times [s]."""
        times = np.asarray(time_s, dtype=float)
        vehicle = self.vehicle
        distance, v, acceleration = self.speed.travel(times + self.lead_s)
        posture = posture_on_path(self.path, vehicle, distance)
        speed_i = posture.travel_ratio * v
        delta_t, delta_i = posture.delta_t, posture.delta_i
        lead_t = vehicle.steering_lag_t * v * posture.delta_t_per_m
        lead_i = vehicle.steering_lag_i * v * posture.delta_i_per_m
        hp = (v + vehicle.speed_time_constant * acceleration) / vehicle.speed_gain
        x, y, psi_t = np.moveaxis(posture.pose_t, -1, 0)
        psi_i = posture.pose_i[..., 2]
        return ReferenceSample(
            time_s=times,
            distance_m=distance,
            curvature=posture.curvature_t,
            state=np.stack([x, y, psi_t, psi_i, delta_t, delta_i, v], axis=-1),
            inputs=np.stack([delta_t + lead_t, delta_i + lead_i, hp], axis=-1),
            trailer_xy=posture.pose_i[..., :2],
            hitch_angle=posture.beta,
            yaw_rate_t=posture.curvature_t * v,
            yaw_rate_i=posture.curvature_i * speed_i,
            speed_i=speed_i,
        )

    def on_grid(self, period_s: float, beyond: int = 0) -> ReferenceSample:
        """Return the reference (N,) at every control tick to its end and `beyond` ticks more."""
        ticks = math.ceil(self.duration_s / period_s - 1e-9) + 1 + beyond
        return self.at(np.arange(ticks) * period_s)


def check_pace(reference: Reference, period_s: float) -> None:
    """Refuse a reference beyond the steering rates or the range of the hydrostat.

    It is checked at every control tick.

    Raises:
        InvalidReference: with the place, the rate or position that is needed and the limit.
    """
    grid, vehicle = reference.on_grid(period_s), reference.vehicle
    lead = (grid.inputs - grid.state[:, State.DELTA_T :])[:, :2]  # lag times rate
    rates = np.abs(lead / [vehicle.steering_lag_t, vehicle.steering_lag_i])
    for actuator, needed, limit, unit in (
        ("front steering", np.degrees(rates[:, 0]), vehicle.steering_rate_t, "deg/s"),
        ("trailer steering", np.degrees(rates[:, 1]), vehicle.steering_rate_i, "deg/s"),
        ("hydrostat", np.abs(grid.inputs[:, Input.HP]), 1.0, "of its range"),
    ):
        allowed = math.degrees(limit) if unit == "deg/s" else limit
        worst = int(np.argmax(needed))
        if needed[worst] > allowed + 1e-9:
            x, y = grid.state[worst, :2]
            raise InvalidReference(
                f"reference too fast at s = {grid.distance_m[worst]:.1f} m (x = {x:.1f}, "
                f"y = {y:.1f} m): {actuator} would need {needed[worst]:.2f} {unit}, allowed are "
                f"{allowed:.2f}; drive slower, or smoother (path.max_deviation_m, blend_m, "
                "acceleration_mps2)"
            )
