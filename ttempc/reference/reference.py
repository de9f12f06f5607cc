"""Time-based reference of tractor and trailer along a path, with its inputs."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath, InvalidReference
from ..types import FloatArray, Input, Shared, State
from ..vehicle import Vehicle
from .corridor import Corridor
from .path import Path

_ITERATIONS = 12  # Newton from the straight posture needs 3 to 4, more on sharp paths
_CLOSED_M = 1e-9  # tolerance of the drawbar's length; the next Newton step squares it
_CHECK_STEP_M = 0.1


@dataclass(frozen=True, slots=True)
class Posture:
    """Posture of the vehicle with tractor point and guided point on their lines.

    (...) is the shape of the arc lengths of the tractor point. Derivatives are by the travel of the
    tractor point and so independent of the speed.
    """

    distance_i: FloatArray  # (...) arc length of the trailer point [m]
    pose_t: FloatArray  # (..., 3) x, y [m] and heading [rad] of the tractor
    pose_i: FloatArray  # (..., 3) the same of the trailer, at its guided point
    curvature_t: FloatArray  # (...) of the path at the tractor point [1/m]
    curvature_i: FloatArray  # (...) change of the trailer's heading along the path [1/m]
    psi_d: FloatArray  # (...) heading of the drawbar [rad], continuous with the tractor's
    delta_t: FloatArray  # (...) front steering [rad]
    delta_t_per_m: FloatArray  # (...) its derivative [rad/m]
    delta_i_per_m: FloatArray  # (...) derivative of the trailer steering [rad/m]
    travel_ratio: FloatArray  # (...) travel of the trailer point per travel of the tractor point

    @property
    def beta(self) -> FloatArray:
        """Hitch angle psi_t - psi_d [rad], (...)."""
        return self.pose_t[..., 2] - self.psi_d

    @property
    def delta_i(self) -> FloatArray:
        """Trailer steering psi_d - psi_i [rad], (...)."""
        return self.psi_d - self.pose_i[..., 2]


def posture_on_path(
    path: Path, vehicle: Vehicle, distance: ArrayLike, behind_m: float | None = None
) -> Posture:
    """Return the posture with the tractor point at arc length `distance` [m] of `path`.

    The trailer point is on the path and the trailer along it. With `behind_m` the trailer point
    is a guided point, and it follows its line at an angle to it, see `trailer_drift`, where
    D = -c (`Vehicle.trailer_turning_offset`). The drawbar joins RJ1 and RJ2,

        RJ1 = p_t - a e(psi_t),   RJ2 = p_i + L_i e(psi_i),   |RJ1 - RJ2| = d.

    Newton's method solves this for the arc length of the trailer. Travel ratio and turning rates
    follow by differentiation along and across the drawbar.

    Raises:
        InvalidPath: no trailer position behind the tractor satisfies this, the path is too tight.
    """
    a, d, length_i = vehicle.hitch_offset, vehicle.drawbar_length, vehicle.trailer_length
    s_t = np.asarray(distance, dtype=float)
    pose_t, kappa_t = path.pose(s_t), path.curvature(s_t)
    rj1 = pose_t[..., :2] - a * _unit(pose_t[..., 2])

    s_i = s_t - (a + d + length_i) + (behind_m or 0.0)
    drift_at, behind = _drift_at(path, vehicle, behind_m, s_i), behind_m or 0.0
    for _ in range(_ITERATIONS):
        pose_i, kappa_i, drawbar, forward, left = _drawbar(
            path, vehicle, rj1, s_i, behind, drift_at
        )
        along = _unit(pose_i[..., 2])
        rj2_per_m = forward[..., None] * along + left[..., None] * _normal(along)
        gap = np.sum(drawbar**2, axis=-1) - d**2
        s_i = s_i + gap / (2.0 * np.sum(drawbar * rj2_per_m, axis=-1))
        if np.max(np.abs(gap)) < _CLOSED_M * d:
            break
    pose_i, kappa_i, drawbar, forward, left = _drawbar(path, vehicle, rj1, s_i, behind, drift_at)
    misfit = np.abs(np.hypot(drawbar[..., 0], drawbar[..., 1]) - d)
    if not np.all(misfit < _CLOSED_M):  # NaN counts as a misfit
        worst = float(np.ravel(s_t)[np.argmax(misfit)])
        raise InvalidPath(f"no posture fits the path with the tractor at {_place(path, worst)}")

    psi_t, psi_i = pose_t[..., 2], pose_i[..., 2]
    psi_d = np.arctan2(drawbar[..., 1], drawbar[..., 0])
    psi_d = psi_d + math.tau * np.round((psi_t - psi_d) / math.tau)
    beta, delta_i = psi_t - psi_d, psi_d - psi_i
    # d(RJ1)/ds = e_t - a kappa_t n_t and d(RJ2)/ds = ratio (forward e_i + left n_i) agree along
    # the drawbar; their difference across it turns the drawbar.
    ratio = (np.cos(beta) + a * kappa_t * np.sin(beta)) / (
        forward * np.cos(delta_i) + left * np.sin(delta_i)
    )
    across_1 = np.sin(beta) - a * kappa_t * np.cos(beta)
    across_2 = ratio * (left * np.cos(delta_i) - forward * np.sin(delta_i))
    wheelbase = vehicle.wheelbase
    return Posture(
        distance_i=s_i,
        pose_t=pose_t,
        pose_i=pose_i,
        curvature_t=kappa_t,
        curvature_i=kappa_i,
        psi_d=psi_d,
        delta_t=np.arctan(wheelbase * kappa_t),
        delta_t_per_m=wheelbase * path.curvature_derivative(s_t) / (1 + (wheelbase * kappa_t) ** 2),
        delta_i_per_m=(across_1 - across_2) / d - ratio * kappa_i,
        travel_ratio=ratio,
    )


_DRIFT_STEP_M: Final = 0.02
_DRIFT_REACH: Final = 25.0  # lengths over which the far end is forgotten, to e^-25
_DRIFT_MARGIN_M: Final = 3.0  # by which Newton may leave its first guess
_DRIFT_ITERATIONS: Final = 6  # each reduces the rest to some hundredths
_LEAST_LEVER_M: Final = 1e-3


def trailer_drift(path: Path, ahead_m: float, behind_m: float, s: FloatArray) -> FloatArray:
    """Return phi = psi_path - psi_i [rad] at equidistant arc lengths `s` (n,) of the guided point.

    This point follows the line p(s) - g e(psi_path), g = `behind_m`, as a tool g behind the
    trailer point does where that is on the path. The trailer does not move sideways in a place
    D = `ahead_m` ahead of the guided point, or behind it for D < 0. With the curvature kappa

        phi' = kappa + sqrt(1 + g^2 kappa^2) / D sin(phi - atan(g kappa)).

    Of its solutions one does not grow along the path: for D > 0 that which is at rest in the end,
    so that the trailer turns before its path does, for D < 0 that which is so in the beginning.
    """
    order = slice(None, None, -1 if ahead_m > 0.0 else 1)  # from where phi is at rest
    kappa, rate = path.curvature(s[order]), 1.0 / abs(ahead_m)
    gain, steady = rate * np.hypot(1.0, behind_m * kappa), np.arctan(behind_m * kappa)
    turn = -math.copysign(1.0, ahead_m) * kappa
    # phi' = r - rate phi along this order, exact for r linear between samples
    decay = math.exp(-rate * (s[1] - s[0]))
    mean = (1.0 - decay) / (rate * (s[1] - s[0]))
    phi = steady
    for _ in range(_DRIFT_ITERATIONS):
        r = turn + rate * phi - gain * np.sin(phi - steady)
        phi = np.append(r[0], (1.0 - mean) * r[1:] + (mean - decay) * r[:-1]) / rate
        reach, factor = 1, decay
        while reach < len(s) and factor > 0.0:  # sums over all samples before, by doubling
            phi[reach:] = phi[reach:] + factor * phi[:-reach]
            reach, factor = 2 * reach, factor * factor
    return phi[order]


def check_drivable(
    path: Path, vehicle: Vehicle, front_share: float = 0.9, trailer_share: float = 1.05
) -> None:
    """Refuse a path that needs more steering than the vehicle has.

    The path may need `front_share` of the front steering's stop; the rest is left for feedback. It
    may need `trailer_share` of the trailer's stop, which can be above 1: a trailer at its stop runs
    only some centimetres inside the curve (5 % of 25 deg are about 3 cm at R = 6 m).

    Raises:
        InvalidPath: with the place, the angle that is needed and the one that is allowed.
    """
    count = math.ceil(path.length_m / _CHECK_STEP_M) + 1
    along = np.linspace(0.0, path.length_m, count)

    def check(name: str, angle: FloatArray, allowed: float, share: float) -> None:
        worst = int(np.argmax(np.abs(angle)))
        if abs(angle[worst]) > allowed:
            raise InvalidPath(
                f"path too tight at {_place(path, along[worst])}: {name} would need "
                f"{math.degrees(abs(angle[worst])):.1f} deg, allowed are "
                f"{math.degrees(allowed):.1f} deg ({share:.0%} of its stop)"
            )

    delta_t = np.arctan(vehicle.wheelbase * path.curvature(along))
    check("front steering", delta_t, front_share * vehicle.steering_limit_t, front_share)
    delta_i = posture_on_path(path, vehicle, along).delta_i
    check("trailer steering", delta_i, trailer_share * vehicle.steering_limit_i, trailer_share)


def _place(path: Path, distance: float) -> str:
    x, y, _ = path.pose(distance)
    return f"s = {distance:.1f} m (x = {x:.1f}, y = {y:.1f} m)"


def _drift_at(
    path: Path, vehicle: Vehicle, behind_m: float | None, s_i: FloatArray
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return a function from arc length and curvature to `trailer_drift` and the turn psi_i'."""
    if behind_m is None:
        return lambda s, kappa: (np.zeros_like(s), kappa)
    ahead = -vehicle.trailer_turning_offset
    ahead = math.copysign(max(abs(ahead), _LEAST_LEVER_M), ahead)
    margin = _DRIFT_REACH * abs(ahead) + _DRIFT_MARGIN_M
    table = np.arange(float(s_i.min()) - margin, float(s_i.max()) + margin, _DRIFT_STEP_M)
    drift = trailer_drift(path, ahead, behind_m, table)

    def at(s: FloatArray, kappa: FloatArray) -> tuple[FloatArray, FloatArray]:
        phi = np.interp(s, table, drift)
        return phi, (behind_m * kappa * np.cos(phi) - np.sin(phi)) / ahead

    return at


def _drawbar(
    path: Path,
    vehicle: Vehicle,
    rj1: FloatArray,
    s_i: FloatArray,
    behind_m: float,
    drift_at: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return what belongs to the trailer at `s_i`.

    That is its pose (..., 3), its turn psi_i' along the path, the vector RJ2 -> RJ1 (..., 2), and
    the travel of RJ2 per metre of path, along and across the trailer.
    """
    pose_i, kappa = path.pose(s_i), path.curvature(s_i)
    phi, turn = drift_at(s_i, kappa)
    pose_i[..., :2] -= behind_m * _unit(pose_i[..., 2])
    pose_i[..., 2] -= phi
    rj2 = pose_i[..., :2] + vehicle.trailer_length * _unit(pose_i[..., 2])
    forward = np.cos(phi) + behind_m * kappa * np.sin(phi)
    left = np.sin(phi) - behind_m * kappa * np.cos(phi) + vehicle.trailer_length * turn
    return pose_i, turn, rj1 - rj2, forward, left


def _unit(angle: FloatArray) -> FloatArray:
    """Return e(angle), (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _normal(unit: FloatArray) -> FloatArray:
    """Return `unit` turned left by a right angle, (..., 2)."""
    return np.stack([-unit[..., 1], unit[..., 0]], axis=-1)


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
class Reference(Shared):
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
        posture = posture_on_path(self.path, vehicle, distance, self.guided_behind_m)
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
    vehicle, behind = reference.vehicle, 0.0
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


def exact_feedforward(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return the inputs of the reference for each tick, (ticks, 3) in the order of `Input`.

    They are those of the middle of each period, because an input that is constant over a period
    lags by half of it.
    """
    return reference.at((np.arange(ticks) + 0.5) * period_s).inputs
