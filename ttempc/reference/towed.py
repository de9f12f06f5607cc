"""Trailer that cannot keep to the line of its tractor: without steering, or at its stop.

The tractor point stays on the path. The trailer follows from its kinematics, with the steering that
it has: at the line wherever that suffices, beside it in turns.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath
from ..jit import cached_njit
from ..types import FloatArray
from ..vehicle import Vehicle
from .hermite import CubicHermite
from .path import Path
from .posture import Posture, place_on, posture_on_path, unit

_FOLLOWED_SHARE: Final = 1.05
"""Share of the trailer's stop up to which it is taken to follow: at its stop it runs only some
centimetres inside the curve (5 % of 25 deg are about 3 cm at R = 6 m)."""
_TOWED_SHARE: Final = 0.9  # of the stop that a towed trailer uses; the rest is left for feedback
_LARGEST_FOLD: Final = math.radians(75.0)  # between two bodies; beyond it a vehicle jack-knifes
_STEP_M: Final = 0.05  # between the places of the table; the error of a step is its fifth power
_FORGOTTEN: Final = 25.0  # lengths of the trailer over which its first angle decays to e^-25
_CHECK_STEP_M: Final = 0.1
_MOST_PLACES: Final = 20_000  # at which a trailer's distance from its line is looked at
_BESIDE_M: Final = 0.05  # between the places of the line that are compared with a trailer point


@dataclass(frozen=True, slots=True, eq=False)
class Tow:
    """Angles of a towed trailer along a path, by the arc length of the tractor point."""

    fold: CubicHermite  # lambda = psi_t - psi_i [rad]
    steering: CubicHermite  # delta_i [rad]
    lap_m: float  # period of both [m]; infinite for an open path

    def at(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return lambda, delta_i [rad] and their derivatives [rad/m] at arc lengths (...) [m]."""
        first, last = self.fold.knots[[0, -1]]
        inside = distance
        if math.isfinite(self.lap_m):
            inside = distance - self.lap_m * np.floor(distance / self.lap_m)
        inside = np.clip(inside, first, last)
        fold, fold_per_m = self.fold.at(inside)
        steering, steering_per_m = self.steering.at(inside)
        return fold, steering, fold_per_m, steering_per_m


@functools.lru_cache(maxsize=16)
def tow(path: Path, vehicle: Vehicle, behind_m: float | None = None) -> Tow | None:
    """Return the angles of a trailer that cannot keep to its line, None for one that can.

    A trailer with steering can where `posture_on_path` needs at most 105 % of its stop. Otherwise
    its steering is that of this posture, cut at 90 % of the stop, or 0 where no posture fits; that
    of a plain trailer is 0. With lambda = psi_t - psi_i and the curvature kappa of the path

        lambda' = kappa - (sin(lambda) - a kappa cos(lambda) - d cos(delta_i) delta_i')
                          / (d cos(delta_i) + L_i + c),

    which is `articulated` per metre of the tractor point, without side slip. It forgets its first
    angle over a length of the trailer, so that in reverse the reference is the same curve.

    Raises:
        InvalidPath: the trailer would fold by more than 75 deg, with the place.
    """
    towed_m = vehicle.drawbar_length + vehicle.trailer_length + vehicle.trailer_turning_offset
    if towed_m <= 0.0:
        raise InvalidPath(
            f"vehicle: the trailer turns about a point {-towed_m:.2f} m ahead of its hitch, no "
            "reference keeps it behind the tractor"
        )
    margin = _FORGOTTEN * towed_m
    beyond = 0.0 if path.laps else margin
    count = math.ceil((margin + path.lap_m + beyond) / _STEP_M)
    # Every other place is a middle of a step.
    places = np.linspace(-margin, path.lap_m + beyond, 2 * count + 1)
    steered_by = _steering(path, vehicle, behind_m, places)
    if steered_by is None:
        return None
    steering, steering_per_m = steered_by
    kappa = path.curvature(places)
    drawbar = vehicle.drawbar_length * np.cos(steering)
    rate = 1.0 / (towed_m - vehicle.drawbar_length + drawbar)
    steered = rate * drawbar * steering_per_m
    fold = np.zeros(count + 1)
    fold[0] = math.atan(towed_m * float(kappa[0]))
    step = float(places[2] - places[0])
    _integrate_fold(fold, step, kappa, rate, steered, vehicle.hitch_offset)
    at = places[::2]
    slope = _fold_rate(fold, kappa[::2], rate[::2], steered[::2], vehicle.hitch_offset)
    _check_fold(path, at, fold, fold - steering[::2])
    kept = at >= -_STEP_M if path.laps else np.full(len(at), True)
    return Tow(
        CubicHermite(at[kept], fold[kept], slope[kept]),
        CubicHermite(at[kept], steering[::2][kept], steering_per_m[::2][kept]),
        path.lap_m if path.laps else math.inf,
    )


def _steering(
    path: Path, vehicle: Vehicle, behind_m: float | None, places: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Return delta_i [rad] of a towed trailer at `places` and its derivative, None for another."""
    straight = np.zeros_like(places)
    stop = vehicle.steering_limit_i
    if vehicle.is_plain:
        return straight, straight
    count = math.ceil(path.length_m / _CHECK_STEP_M) + 1
    try:
        needed = posture_on_path(
            path, vehicle, np.linspace(0.0, path.length_m, count), behind_m
        ).delta_i
        if np.max(np.abs(needed)) <= _FOLLOWED_SHARE * stop:
            return None
        posture = posture_on_path(path, vehicle, places, behind_m)
    except InvalidPath:  # no posture has both points on the line
        return straight, straight
    most = _TOWED_SHARE * stop
    steering = np.clip(posture.delta_i, -most, most)
    return steering, np.where(np.abs(posture.delta_i) < most, posture.delta_i_per_m, 0.0)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _integrate_fold(
    fold: FloatArray,
    step: float,
    kappa: FloatArray,
    rate: FloatArray,
    steered: FloatArray,
    hitch: float,
) -> None:
    """Integrate lambda from `fold[0]` by the classical Runge-Kutta method.

    The coefficients are given at the ends and the middles of the steps.
    """
    for n in range(len(fold) - 1):
        first = 2 * n
        middle = first + 1
        last = first + 2
        now = fold[n]
        k_1 = _fold_rate_at(now, kappa[first], rate[first], steered[first], hitch)
        half = now + 0.5 * step * k_1
        k_2 = _fold_rate_at(half, kappa[middle], rate[middle], steered[middle], hitch)
        half = now + 0.5 * step * k_2
        k_3 = _fold_rate_at(half, kappa[middle], rate[middle], steered[middle], hitch)
        end = now + step * k_3
        k_4 = _fold_rate_at(end, kappa[last], rate[last], steered[last], hitch)
        fold[n + 1] = now + step * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4) / 6.0


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def _fold_rate_at(fold: float, kappa: float, rate: float, steered: float, hitch: float) -> float:
    """Return lambda' of `tow` at one place; `steered` is the part of the trailer's steering."""
    return kappa - rate * (math.sin(fold) - hitch * kappa * math.cos(fold)) + steered


def _fold_rate(
    fold: FloatArray, kappa: FloatArray, rate: FloatArray, steered: FloatArray, hitch: float
) -> FloatArray:
    """Return lambda' at many places (n,)."""
    return kappa - rate * (np.sin(fold) - hitch * kappa * np.cos(fold)) + steered


def _check_fold(path: Path, at: FloatArray, fold: FloatArray, hitch: FloatArray) -> None:
    """Refuse angles (n,) of the trailer to the tractor, or of the drawbar, that are too large."""
    driven = (at >= 0.0) & (at <= path.lap_m)
    largest = np.where(driven, np.maximum(np.abs(fold), np.abs(hitch)), 0.0)
    worst = int(np.argmax(np.nan_to_num(largest, nan=math.inf)))
    if not largest[worst] <= _LARGEST_FOLD:
        raise InvalidPath(
            f"path too tight at {place_on(path, float(at[worst]))}: the towed trailer would fold "
            f"by {math.degrees(largest[worst]):.0f} deg, allowed are "
            f"{math.degrees(_LARGEST_FOLD):.0f} deg; a wider turn or a shorter trailer does it"
        )


def towed_posture(path: Path, vehicle: Vehicle, towed: Tow, distance: ArrayLike) -> Posture:
    """Return the posture of a towed trailer with the tractor point at `distance` [m], (...).

    The trailer's yaw, the drawbar's and the travel of the trailer point follow from lambda and
    delta_i and their derivatives per metre.
    """
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    length_i = vehicle.trailer_length
    s_t = np.asarray(distance, dtype=float)
    pose_t = path.pose(s_t)
    kappa_t = path.curvature(s_t)
    fold, delta_i, fold_per_m, delta_i_per_m = towed.at(s_t)

    psi_i = pose_t[..., 2] - fold
    psi_d = psi_i + delta_i
    trailer = pose_t[..., :2] - a * unit(pose_t[..., 2]) - d * unit(psi_d) - length_i * unit(psi_i)
    turn_i = kappa_t - fold_per_m
    ratio = (
        np.cos(fold) + a * kappa_t * np.sin(fold) + d * (turn_i + delta_i_per_m) * np.sin(delta_i)
    )
    wheelbase = vehicle.wheelbase
    return Posture(
        pose_t=pose_t,
        pose_i=np.concatenate([trailer, psi_i[..., None]], axis=-1),
        curvature_t=kappa_t,
        curvature_i=turn_i / ratio,
        psi_d=psi_d,
        delta_t=np.arctan(wheelbase * kappa_t),
        delta_t_per_m=wheelbase * path.curvature_derivative(s_t) / (1 + (wheelbase * kappa_t) ** 2),
        delta_i_per_m=delta_i_per_m,
        travel_ratio=ratio,
    )


def distance_off_line(path: Path, vehicle: Vehicle) -> float:
    """Return the largest distance of the trailer's reference from the path [m], 0 if it follows."""
    towed = tow(path, vehicle)
    if towed is None:
        return 0.0
    count = min(_MOST_PLACES, math.ceil(path.length_m / _CHECK_STEP_M) + 1)
    along = np.linspace(0.0, path.length_m, count)
    trailer = towed_posture(path, vehicle, towed, along).pose_i[:, :2]
    behind = vehicle.drawbar_offset + vehicle.trailer_length
    nearest = np.full(count, math.inf)
    # A trailer that cuts a curve is ahead of where it would be on the line.
    for offset in np.arange(-0.5 * behind, 1.5 * behind, _BESIDE_M):
        line = path.pose(along - behind + offset)[:, :2]
        nearest = np.minimum(nearest, np.hypot(*(trailer - line).T))
    return float(nearest.max())
