"""Speed profiles: speeds planned along the path, and driving in reverse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..errors import InvalidReference
from ..types import FloatArray
from .corridor import Corridor
from .path import Path
from .reference import SpeedProfile

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator

_STEP_M = 0.05  # between the samples of the speed along the path
_STEP_S = 0.05  # between the knots of the speed in time
_SMOOTHING_S = 2.0  # window of the moving average of the speed
_PLACE_M = 0.1  # between the places at which a speed is limited
_ACCELERATION_MPS2 = 0.1  # 15 % of the hydrostat for the paper's K and tau
_STRAIGHT_PER_M = 1e-9  # curvature below which a place counts as straight


@dataclass(frozen=True, slots=True)
class Backward:
    """A forward profile driven in reverse, from `start_m` towards arc length 0."""

    forward: SpeedProfile
    start_m: float  # arc length at which the drive begins [m]

    @property
    def top_speed(self) -> float:
        return self.forward.top_speed

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        distance, speed, acceleration = self.forward.travel(times_s)
        return self.start_m - distance, -speed, -acceleration

    def duration_s(self, length_m: float) -> float:
        return self.forward.duration_s(length_m)


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSpeed:
    """Desired speeds at places along the path, reduced to a largest acceleration.

    Between places the desired speed is linear in arc length. It is reduced until

        |d(v^2) / ds| <= 2 a_max,

    forward and backward along the path, so that the vehicle brakes before a slow place. A moving
    average over 2 s of time makes speed and acceleration continuous. The speed is constant before
    the first and after the last place.

    Raises:
        InvalidReference: a speed or the acceleration is not finite or not above 0, with the index
            of the place and its arc length; or the arc lengths do not increase.

    Examples:
        >>> speed = PlannedSpeed(np.array([0.0, 50.0, 100.0]), np.array([1.0, 0.5, 1.0]))
        >>> distance, speed_mps, _ = speed.travel(np.array([0.0, 20.0]))
        >>> bool(speed_mps[1] <= 1.0)
        True
    """

    distance_m: FloatArray  # (n,) arc length of each place [m], increasing
    speed_mps: FloatArray  # (n,) desired speed at each place [m/s]
    acceleration_mps2: float = _ACCELERATION_MPS2  # a_max

    _speed: PchipInterpolator = field(init=False, repr=False)  # over time [s]

    def __post_init__(self) -> None:
        limit = self.acceleration_mps2
        if not (math.isfinite(limit) and limit > 0.0):
            raise InvalidReference(f"acceleration: got {limit} m/s^2, must be finite and above 0")
        for index, (s, v) in enumerate(zip(self.distance_m, self.speed_mps, strict=True)):
            if not (math.isfinite(v) and v > 0.0):
                raise InvalidReference(
                    f"speed: got {v} m/s at point {index}, s = {s:.2f} m, must be finite and above "
                    "0: a reference that stands or turns round cannot be tracked"
                )
        if not np.all(np.diff(self.distance_m) > 0.0):
            raise InvalidReference("speed: the places along the path must go forward")
        first = float(self.distance_m[0])
        last = float(self.distance_m[-1])
        s = np.linspace(first, last, max(2, math.ceil((last - first) / _STEP_M) + 1))
        v = _within(np.interp(s, self.distance_m, self.speed_mps), s[1] - s[0], limit)
        times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(s) / (v[1:] + v[:-1]))])
        # Distance at equal times; the speed is constant beyond both ends.
        margin = _SMOOTHING_S
        count = math.ceil((times[-1] + 2.0 * margin) / _STEP_S) + 1
        knots = _STEP_S * np.arange(count) - margin
        hermite = scipy.interpolate.CubicHermiteSpline(times, s, v)
        inside = hermite(np.clip(knots, 0.0, times[-1]))
        before = np.minimum(knots, 0.0) * v[0]
        after = np.maximum(knots - times[-1], 0.0) * v[-1]
        half = round(0.5 * _SMOOTHING_S / _STEP_S)
        distance = inside + before + after
        mean = (distance[2 * half :] - distance[: -2 * half]) / (2 * half * _STEP_S)
        speed = scipy.interpolate.PchipInterpolator(knots[half:-half], mean)
        object.__setattr__(self, "_speed", speed)

    @property
    def top_speed(self) -> float:
        return float(np.max(self.speed_mps))

    def travel(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        first, last = self._speed.x[[0, -1]]
        inside = np.clip(times_s, first, last)
        speed = self._speed(inside)
        distance = self._distance(inside) + speed * (times_s - inside)
        acceleration = np.where(inside == times_s, self._speed.derivative()(inside), 0.0)
        return distance, speed, acceleration

    def duration_s(self, length_m: float) -> float:
        last = self._speed.x[-1]
        end, speed, _ = self.travel(np.array(last))
        if length_m >= end:
            return float(last + (length_m - end) / speed)
        crossings = self._speed.antiderivative().solve(
            length_m - self.distance_m[0] + self._speed.antiderivative()(0.0), extrapolate=False
        )
        return float(crossings[0])

    def _distance(self, times_s: FloatArray) -> FloatArray:
        """Return the arc length [m] at times within the knots."""
        travel = self._speed.antiderivative()
        return self.distance_m[0] + travel(times_s) - travel(0.0)


def limited_in_corridor(
    speed: SpeedProfile, length_m: float, corridor: Corridor, limit_mps: float
) -> SpeedProfile:
    """Return a profile that is nowhere faster than `speed`, and within a limit in a corridor.

    It changes its speed in the manner of `PlannedSpeed`, before and behind the places where the
    corridor holds. A profile within the limit is returned as it is.

    Example:
        >>> from ttempc import ConstantSpeed
        >>> corridor = Corridor(0.1, ((20.0, 40.0),))
        >>> slower = limited_in_corridor(ConstantSpeed(1.0), 60.0, corridor, 0.5)
        >>> slower.duration_s(60.0) > 80.0
        True
    """

    def most(place: FloatArray) -> FloatArray:
        return np.where(np.isfinite(corridor.half_width(place)), limit_mps, math.inf)

    return _limited(speed, length_m, most)


def limited_in_curves(
    speed: SpeedProfile, path: Path, lateral_mps2: float, acceleration_mps2: float
) -> SpeedProfile:
    """Return a profile that is nowhere faster than `speed`, and slower in the curves of a path.

    The lateral acceleration of the tractor point stays within a limit:

        v^2 |kappa| <= a_lateral.

    The profile brakes before a curve and accelerates behind it in the manner of `PlannedSpeed`. A
    profile within the limit is returned as it is.

    Args:
        speed: forward profile along the path.
        path: its curvature counts.
        lateral_mps2: largest lateral acceleration, a_lateral [m/s^2].
        acceleration_mps2: largest acceleration along the path [m/s^2].

    Raises:
        InvalidReference: a limit is not finite or not above 0.

    Example:
        >>> from ttempc import ConstantSpeed, figure_eight
        >>> path = figure_eight(radius_m=10.0, laps=1)
        >>> slower = limited_in_curves(ConstantSpeed(3.0), path, 0.4, 0.2)
        >>> _, speed_mps, _ = slower.travel(np.linspace(0.0, slower.duration_s(path.length_m), 500))
        >>> round(float(speed_mps.min()), 2)
        2.0
    """
    if not (math.isfinite(lateral_mps2) and lateral_mps2 > 0.0):
        raise InvalidReference(
            f"lateral acceleration: got {lateral_mps2} m/s^2, must be finite and above 0"
        )

    def most(place: FloatArray) -> FloatArray:
        bent = np.maximum(np.abs(path.curvature(place)), _STRAIGHT_PER_M)
        return np.sqrt(lateral_mps2 / bent)

    return _limited(speed, path.length_m, most, acceleration_mps2)


def _limited(
    speed: SpeedProfile,
    length_m: float,
    most: Callable[[FloatArray], FloatArray],
    acceleration_mps2: float = _ACCELERATION_MPS2,
) -> SpeedProfile:
    """Return a profile within `speed` and within limits by place, itself where it is already.

    Args:
        speed: profile, forward or in reverse.
        length_m: travel along the path [m].
        most: largest speed [m/s] at arc lengths [m], (n,) -> (n,).
        acceleration_mps2: largest acceleration along the path [m/s^2].
    """
    count = max(2, math.ceil(length_m / _PLACE_M) + 1)
    arc, along, _ = speed.travel(np.linspace(0.0, speed.duration_s(length_m), count))
    travelled = np.linspace(0.0, length_m, count)
    driven = np.abs(arc - arc[0])
    place = np.interp(travelled, driven, arc)
    desired = np.interp(travelled, driven, np.abs(along))
    # The moving average reaches half its window ahead and back, and speeds are linear to the next.
    reach = math.ceil(0.5 * _SMOOTHING_S * speed.top_speed / (length_m / (count - 1))) + 1
    lowest = scipy.ndimage.minimum_filter1d(most(place), 2 * reach + 1, mode="nearest")
    limited = np.minimum(desired, lowest)
    if np.array_equal(limited, desired):
        return speed
    planned = PlannedSpeed(travelled, limited, acceleration_mps2)
    return Backward(planned, float(arc[0])) if along[0] < 0.0 else planned


def _within(speed: FloatArray, step_m: float, limit: float) -> FloatArray:
    """Return the largest speeds (n,) [m/s] up to `speed` with accelerations up to `limit`."""
    energy = speed**2  # (n,) v^2 changes by no more than 2 a ds
    ramp = 2.0 * limit * step_m * np.arange(len(energy))
    forward = np.minimum.accumulate(energy - ramp) + ramp
    backward = np.minimum.accumulate((forward + ramp)[::-1])[::-1] - ramp
    return np.sqrt(backward)
