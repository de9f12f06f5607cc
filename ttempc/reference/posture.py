"""Posture of a vehicle with both of its points on their lines."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath
from ..types import FloatArray
from ..vehicle import Vehicle
from .path import Path

_ITERATIONS = 12  # Newton from the straight posture needs 3 to 4, more on sharp paths
_CLOSED_M = 1e-9  # tolerance of the drawbar's length; the next Newton step squares it


@dataclass(frozen=True, slots=True)
class Posture:
    """Posture of the vehicle with tractor point and guided point on their lines.

    (...) is the shape of the arc lengths of the tractor point. Derivatives are by the travel of the
    tractor point and so independent of the speed.
    """

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
    s_t = np.asarray(distance, dtype=float)
    pose_t = path.pose(s_t)
    trailer = _trailer_behind(path, vehicle, s_t, pose_t, behind_m)

    psi_t = pose_t[..., 2]
    psi_d = np.arctan2(trailer.drawbar[..., 1], trailer.drawbar[..., 0])
    psi_d = psi_d + math.tau * np.round((psi_t - psi_d) / math.tau)
    beta = psi_t - psi_d
    delta_i = psi_d - trailer.pose[..., 2]

    # d(RJ1)/ds = e_t - a kappa_t n_t and d(RJ2)/ds = ratio (forward e_i + left n_i) agree along
    # the drawbar; their difference across it turns the drawbar.
    a = vehicle.hitch_offset
    kappa_t = path.curvature(s_t)
    forward = trailer.forward
    left = trailer.left
    ratio = (np.cos(beta) + a * kappa_t * np.sin(beta)) / (
        forward * np.cos(delta_i) + left * np.sin(delta_i)
    )
    across_1 = np.sin(beta) - a * kappa_t * np.cos(beta)
    across_2 = ratio * (left * np.cos(delta_i) - forward * np.sin(delta_i))
    drawbar_turn = (across_1 - across_2) / vehicle.drawbar_length

    wheelbase = vehicle.wheelbase
    return Posture(
        pose_t=pose_t,
        pose_i=trailer.pose,
        curvature_t=kappa_t,
        curvature_i=trailer.turn,
        psi_d=psi_d,
        delta_t=np.arctan(wheelbase * kappa_t),
        delta_t_per_m=wheelbase * path.curvature_derivative(s_t) / (1 + (wheelbase * kappa_t) ** 2),
        delta_i_per_m=drawbar_turn - ratio * trailer.turn,
        travel_ratio=ratio,
    )


class _Trailer(NamedTuple):
    """Trailer at arc lengths of its path, and what lies between it and the hitch of a tractor."""

    pose: FloatArray  # (..., 3) x, y [m] and heading [rad]
    turn: FloatArray  # (...) psi_i' [rad/m]
    drawbar: FloatArray  # (..., 2) vector RJ2 -> RJ1 [m]
    forward: FloatArray  # (...) travel of RJ2 per metre of path, along the trailer
    left: FloatArray  # (...) the same across it


def _trailer_behind(
    path: Path, vehicle: Vehicle, s_t: FloatArray, pose_t: FloatArray, behind_m: float | None
) -> _Trailer:
    """Return the trailer whose drawbar reaches a tractor, see `posture_on_path`."""
    d = vehicle.drawbar_length
    behind = behind_m or 0.0
    rj1 = pose_t[..., :2] - vehicle.hitch_offset * unit(pose_t[..., 2])
    s_i = s_t - (vehicle.hitch_offset + d + vehicle.trailer_length) + behind
    drift_at = _drift_at(path, vehicle, behind_m, s_i)

    for _ in range(_ITERATIONS):
        trailer = _trailer_at(path, vehicle, rj1, s_i, behind, drift_at)
        along = unit(trailer.pose[..., 2])
        rj2_per_m = trailer.forward[..., None] * along + trailer.left[..., None] * _normal(along)
        gap = np.sum(trailer.drawbar**2, axis=-1) - d**2
        s_i = s_i + gap / (2.0 * np.sum(trailer.drawbar * rj2_per_m, axis=-1))
        if np.max(np.abs(gap)) < _CLOSED_M * d:
            break

    trailer = _trailer_at(path, vehicle, rj1, s_i, behind, drift_at)
    misfit = np.abs(np.hypot(trailer.drawbar[..., 0], trailer.drawbar[..., 1]) - d)
    if not np.all(misfit < _CLOSED_M):  # NaN counts as a misfit
        worst = float(np.ravel(s_t)[np.argmax(misfit)])
        raise InvalidPath(f"no posture fits the path with the tractor at {place_on(path, worst)}")
    return trailer


def _trailer_at(
    path: Path,
    vehicle: Vehicle,
    rj1: FloatArray,
    s_i: FloatArray,
    behind_m: float,
    drift_at: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> _Trailer:
    """Return the trailer at `s_i` and what lies between it and RJ1."""
    pose_i = path.pose(s_i)
    kappa = path.curvature(s_i)
    phi, turn = drift_at(s_i, kappa)
    pose_i[..., :2] -= behind_m * unit(pose_i[..., 2])
    pose_i[..., 2] -= phi
    rj2 = pose_i[..., :2] + vehicle.trailer_length * unit(pose_i[..., 2])
    forward = np.cos(phi) + behind_m * kappa * np.sin(phi)
    left = np.sin(phi) - behind_m * kappa * np.cos(phi) + vehicle.trailer_length * turn
    return _Trailer(pose_i, turn, rj1 - rj2, forward, left)


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
    kappa = path.curvature(s[order])
    rate = 1.0 / abs(ahead_m)
    gain = rate * np.hypot(1.0, behind_m * kappa)
    steady = np.arctan(behind_m * kappa)
    turn = -math.copysign(1.0, ahead_m) * kappa
    # phi' = r - rate phi along this order, exact for r linear between samples
    decay = math.exp(-rate * (s[1] - s[0]))
    mean = (1.0 - decay) / (rate * (s[1] - s[0]))
    phi = steady
    for _ in range(_DRIFT_ITERATIONS):
        r = turn + rate * phi - gain * np.sin(phi - steady)
        phi = np.append(r[0], (1.0 - mean) * r[1:] + (mean - decay) * r[:-1]) / rate
        reach = 1
        factor = decay
        while reach < len(s) and factor > 0.0:  # sums over all samples before, by doubling
            phi[reach:] = phi[reach:] + factor * phi[:-reach]
            reach = 2 * reach
            factor = factor * factor
    return phi[order]


def place_on(path: Path, distance: float) -> str:
    """Return a place of a path in words, for a message."""
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


def unit(angle: FloatArray) -> FloatArray:
    """Return e(angle) = (cos, sin), (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _normal(unit: FloatArray) -> FloatArray:
    """Return `unit` turned left by a right angle, (..., 2)."""
    return np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
