"""Posture of a vehicle with both axle points on one path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath
from ..types import FloatArray
from ..vehicle import Vehicle
from .path import Path

_ITERATIONS = 12  # Newton from the straight posture needs 3 to 4, more on sharp paths
_CLOSED_M = 1e-9  # tolerance of the drawbar's length; the next Newton step squares it
_CHECK_STEP_M = 0.1


@dataclass(frozen=True, slots=True)
class Posture:
    """Posture of the vehicle with both axle points on a path.

    (...) is the shape of the arc lengths of the tractor point. Derivatives are by the travel of the
    tractor point and so independent of the speed.
    """

    distance_i: FloatArray  # (...) arc length of the trailer point [m]
    pose_t: FloatArray  # (..., 3) x, y [m] and heading [rad] of the tractor
    pose_i: FloatArray  # (..., 3) the same of the trailer
    curvature_t: FloatArray  # (...) of the path at the tractor point [1/m]
    curvature_i: FloatArray  # (...) of the path at the trailer point [1/m]
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


def posture_on_path(path: Path, vehicle: Vehicle, distance: ArrayLike) -> Posture:
    """Return the posture with the tractor point at arc length `distance` [m] of `path`.

    The drawbar joins RJ1 and RJ2,

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

    s_i = s_t - (a + d + length_i)
    for _ in range(_ITERATIONS):
        pose_i, kappa_i, drawbar = _drawbar(path, vehicle, rj1, s_i)
        along = _unit(pose_i[..., 2])
        rj2_per_m = along + (length_i * kappa_i)[..., None] * _normal(along)
        gap = np.sum(drawbar**2, axis=-1) - d**2
        s_i = s_i + gap / (2.0 * np.sum(drawbar * rj2_per_m, axis=-1))
        if np.max(np.abs(gap)) < _CLOSED_M * d:
            break
    pose_i, kappa_i, drawbar = _drawbar(path, vehicle, rj1, s_i)
    misfit = np.abs(np.hypot(drawbar[..., 0], drawbar[..., 1]) - d)
    if not np.all(misfit < _CLOSED_M):  # NaN counts as a misfit
        worst = float(np.ravel(s_t)[np.argmax(misfit)])
        raise InvalidPath(f"no posture fits the path with the tractor at {_place(path, worst)}")

    psi_t, psi_i = pose_t[..., 2], pose_i[..., 2]
    psi_d = np.arctan2(drawbar[..., 1], drawbar[..., 0])
    psi_d = psi_d + math.tau * np.round((psi_t - psi_d) / math.tau)
    beta, delta_i = psi_t - psi_d, psi_d - psi_i
    # d(RJ1)/ds = e_t - a kappa_t n_t and d(RJ2)/ds = ratio (e_i + L_i kappa_i n_i) agree along
    # the drawbar; their difference across it turns the drawbar.
    ratio = (np.cos(beta) + a * kappa_t * np.sin(beta)) / (
        np.cos(delta_i) + length_i * kappa_i * np.sin(delta_i)
    )
    across_1 = np.sin(beta) - a * kappa_t * np.cos(beta)
    across_2 = ratio * (length_i * kappa_i * np.cos(delta_i) - np.sin(delta_i))
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


def _drawbar(
    path: Path, vehicle: Vehicle, rj1: FloatArray, s_i: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return trailer pose (..., 3), curvature and the vector RJ2 -> RJ1 (..., 2) at `s_i`."""
    pose_i = path.pose(s_i)
    rj2 = pose_i[..., :2] + vehicle.trailer_length * _unit(pose_i[..., 2])
    return pose_i, path.curvature(s_i), rj1 - rj2


def _unit(angle: FloatArray) -> FloatArray:
    """Return e(angle), (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _normal(unit: FloatArray) -> FloatArray:
    """Return `unit` turned left by a right angle, (..., 2)."""
    return np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
