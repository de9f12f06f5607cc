"""Time-based reference of tractor and trailer along a path, with its inputs."""

import math
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath, InvalidReference
from ..types import FloatArray, Immutable, Input, State
from ..vehicle import Vehicle
from .corridor import Corridor
from .path import Path
from .posture import Posture, place_on, posture_on_path
from .towed import tow, towed_posture

_CHECK_STEP_M: Final = 0.1


def posture(
    path: Path, vehicle: Vehicle, distance: ArrayLike, behind_m: float | None = None
) -> Posture:
    """Return the posture at arc length `distance` [m]: both points on their lines, or towed.

    Raises:
        InvalidPath: the trailer can neither follow the path nor be towed along it.
    """
    towed = tow(path, vehicle, behind_m)
    if towed is None:
        return posture_on_path(path, vehicle, distance, behind_m)
    return towed_posture(path, vehicle, towed, distance)


def check_drivable(path: Path, vehicle: Vehicle, front_share: float = 0.9) -> None:
    """Refuse a path that needs more steering than the tractor has, or folds the trailer.

    The path may need `front_share` of the front steering's stop; the rest is left for feedback. A
    trailer whose steering does not suffice is towed beside the line.

    Raises:
        InvalidPath: with the place, the angle that is needed and the one that is allowed.
    """
    count = math.ceil(path.length_m / _CHECK_STEP_M) + 1
    along = np.linspace(0.0, path.length_m, count)
    angle = np.abs(np.arctan(vehicle.wheelbase * path.curvature(along)))
    worst = int(np.argmax(angle))
    allowed = front_share * vehicle.steering_limit_t
    if angle[worst] > allowed:
        raise InvalidPath(
            f"path too tight at {place_on(path, float(along[worst]))}: front steering would need "
            f"{math.degrees(angle[worst]):.1f} deg, allowed are "
            f"{math.degrees(allowed):.1f} deg ({front_share:.0%} of its stop)"
        )
    tow(path, vehicle)


_COMFORTABLE_RATE: Final = 0.25  # share of the rate of the front steering; assumed


@dataclass(frozen=True, slots=True)
class Comfortable:
    """Whether the tractor of a vehicle can drive a path with reserves, at a speed.

    The front steering then needs at most 90 % of its stop and 25 % of its rate.
    """

    vehicle: Vehicle
    speed_mps: float

    def __call__(self, path: Path) -> bool:
        """Return whether it can."""
        vehicle = self.vehicle
        along = np.linspace(0.0, path.length_m, math.ceil(path.length_m / _CHECK_STEP_M) + 1)
        bent = vehicle.wheelbase * path.curvature(along)
        if np.max(np.arctan(np.abs(bent))) > 0.9 * vehicle.steering_limit_t:
            return False
        bent_per_m = vehicle.wheelbase * path.curvature_derivative(along)
        rate = self.speed_mps * bent_per_m / (1.0 + bent**2)
        return bool(np.max(np.abs(rate)) <= _COMFORTABLE_RATE * vehicle.steering_rate_t)


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
        return self.speed

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.speed * times_s, np.full_like(times_s, self.speed), np.zeros_like(times_s)

    def duration_s(self, length_m: float) -> float:
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
class Reference(Immutable):
    """Both axle points of the vehicle on one path, as functions of time.

    A trailer whose steering does not suffice, or is absent, is beside it in turns, see `tow`.

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
    # Of a controller: its vehicle has the guided point for the trailer point, so far behind the
    # axle [m], see `guided`; None: both axle points are on the path
    guided_behind_m: float | None = None

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
        return self.speed.duration_s(self.path.length_m)

    def at(self, time_s: ArrayLike) -> ReferenceSample:
        """Return the reference at one time or at an array of times [s]."""
        times = np.asarray(time_s, dtype=float)
        vehicle = self.vehicle
        distance, v, acceleration = self.speed.travel(times + self.lead_s)
        at = posture(self.path, vehicle, distance, self.guided_behind_m)
        speed_i = at.travel_ratio * v
        delta_t = at.delta_t
        delta_i = at.delta_i
        lead_t = vehicle.steering_lag_t * v * at.delta_t_per_m
        command_i = delta_i + vehicle.steering_lag_i * v * at.delta_i_per_m
        if tow(self.path, vehicle, self.guided_behind_m) is not None:
            # the reference of a towed trailer is near its stop, and leads it for a moment
            stop = vehicle.steering_limit_i
            command_i = np.clip(command_i, -stop, stop)
        hp = (v + vehicle.speed_time_constant * acceleration) / vehicle.speed_gain
        x, y, psi_t = np.moveaxis(at.pose_t, -1, 0)
        psi_i = at.pose_i[..., 2]
        return ReferenceSample(
            time_s=times,
            distance_m=distance,
            curvature=at.curvature_t,
            state=np.stack([x, y, psi_t, psi_i, delta_t, delta_i, v], axis=-1),
            inputs=np.stack([delta_t + lead_t, command_i, hp], axis=-1),
            trailer_xy=at.pose_i[..., :2],
            hitch_angle=at.beta,
            yaw_rate_t=at.curvature_t * v,
            yaw_rate_i=at.curvature_i * speed_i,
            speed_i=speed_i,
        )

    def on_grid(self, period_s: float, beyond: int = 0) -> ReferenceSample:
        """Return the reference (N,) at every control tick to its end and `beyond` ticks more."""
        ticks = math.ceil(self.duration_s / period_s - 1e-9) + 1 + beyond
        return self.at(np.arange(ticks) * period_s)


Guided = Literal["tool", "axle"]
GUIDED: Final = ("tool", "axle")
"""Points behind that a controller can keep to their line."""


def guided(reference: Reference, point: Guided) -> Reference:
    """Return the reference on which a controller keeps the tool, or the trailer axle, to its line.

    A tool that the soil holds lets the trailer turn about a point c behind its axle: with the axle
    on its line, the heading and with it the tool, g behind the axle, would be off. The vehicle of
    the result has the guided point for its trailer point: with L_i + g and c - g in place of L_i
    and c its equation of yaw is the same, and outputs and gains are those of the tool. Without tool
    and c the reference stays as it is: what is recorded and judged.
    """
    vehicle = reference.vehicle
    behind = 0.0
    if point == "tool":
        behind = vehicle.tool_behind
    if not (behind or vehicle.trailer_turning_offset):
        return reference
    virtual = replace(
        vehicle,
        trailer_length=vehicle.trailer_length + behind,
        trailer_turning_offset=vehicle.trailer_turning_offset - behind,
        tool_behind=0.0,
    )
    return replace(reference, vehicle=virtual, guided_behind_m=behind)


def check_pace(reference: Reference, period_s: float) -> None:
    """Refuse a reference beyond the steering rates or the range of the hydrostat.

    It is checked at every control tick.

    Raises:
        InvalidReference: with the place, the rate or position that is needed and the limit.
    """
    grid = reference.on_grid(period_s)
    vehicle = reference.vehicle
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


def exact_feedforward(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return the inputs of the reference for each tick, (ticks, 3) in the order of `Input`.

    They are those of the middle of each period, because an input that is constant over a period
    lags by half of it.
    """
    return reference.at((np.arange(ticks) + 0.5) * period_s).inputs
