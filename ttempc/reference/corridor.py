"""Corridor about a path, and limit of the hitch angle: what a vehicle is to keep to."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidTuning, check_positive, check_vector
from ..types import FloatArray

_SLOWEST_MPS: Final = 0.2  # assumed: below it wheels and valves of the plant are not tested


@dataclass(frozen=True)
class SpeedTube:
    """Half widths across the path that tractor and trailer point keep at a speed v,

        h(v) = h_0 + h_1 v    for each of them.

    h_0 is due to the noise of the sensors, which filter and controller follow at any speed. A push,
    by a slip angle for example, moves a point sideways in proportion to v, while the time until
    filter and steering have answered does not depend on it. Both are measured on runs of the
    controller on ground alike (docs/appendix/mpc-bounds.md, Corridor); linear is assumed.

    Raises:
        InvalidTuning: a value is not finite or negative.

    Example:
        >>> SpeedTube((0.05, 0.03), (0.1, 0.05)).half_width(0.5).tolist()
        [0.1, 0.055]
    """

    at_rest_m: tuple[float, float] = (0.0, 0.0)  # h_0 of tractor, trailer
    per_speed_s: tuple[float, float] = (0.0, 0.0)  # h_1 of tractor, trailer [m per m/s]

    def __post_init__(self) -> None:
        check_vector("corridor_at_rest_m", self.at_rest_m, 2, zero=True)
        check_vector("corridor_per_speed_s", self.per_speed_s, 2, zero=True)

    def half_width(self, speed_mps: float) -> FloatArray:
        """Return the half widths of tractor and trailer point at a speed, (2,) [m]."""
        return np.array(self.at_rest_m) + np.array(self.per_speed_s) * speed_mps

    def speed_within(self, half_width_m: float) -> float:
        """Return the largest speed [m/s] at which the tube fits into a corridor.

        Infinite where it fits at any speed, at least 0.2 m/s where it fits at none.
        """
        left = half_width_m - np.array(self.at_rest_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            speeds = np.where(left >= 0.0, left / np.array(self.per_speed_s), 0.0)
        return max(float(np.nan_to_num(speeds, nan=math.inf, posinf=math.inf).min()), _SLOWEST_MPS)


@dataclass(frozen=True)
class Corridor:
    """Largest distance from the path of both axle points and the tool, largest hitch angle.

    Raises:
        InvalidTuning: a value is out of its range, or the intervals do not increase.

    Example:
        >>> rows = Corridor(half_width_m=0.1, along_m=((10.0, 40.0),))
        >>> rows.half_width([5.0, 20.0])
        array([inf, 0.1])
    """

    half_width_m: float
    # Arc lengths [from, to] of the tractor point between which it holds; empty: everywhere.
    along_m: tuple[tuple[float, float], ...] = ()
    hitch_limit: float | None = None  # largest |beta| [rad], everywhere; None: not limited
    tool_behind_m: float | None = None  # tool point behind the trailer point; None: no tool

    def __post_init__(self) -> None:
        check_positive("corridor: half_width_m", self.half_width_m)
        if self.hitch_limit is not None:
            check_positive("corridor: hitch_limit", self.hitch_limit)
        if self.tool_behind_m is not None:
            check_positive("corridor: tool_behind_m", self.tool_behind_m, zero=True)
        ends = np.ravel(self.along_m)
        if not (np.isfinite(ends).all() and (np.diff(ends) > 0.0).all()):
            intervals = [list(interval) for interval in self.along_m]
            raise InvalidTuning(f"corridor: along_m: got {intervals}, distances must increase")

    def require_hitch(self, hitch_angle: FloatArray) -> None:
        """Refuse a limit that the `hitch_angle` (N,) [rad] of the reference itself exceeds.

        Raises:
            InvalidTuning: with the numbers.
        """
        largest = float(np.abs(hitch_angle).max())
        if self.hitch_limit is not None and largest >= self.hitch_limit:
            raise InvalidTuning(
                f"corridor: hitch_limit: got {math.degrees(self.hitch_limit):.1f} deg, must exceed "
                f"the hitch angle of the reference, {math.degrees(largest):.1f} deg"
            )

    def half_width(self, distance_m: ArrayLike) -> FloatArray:
        """Return the half width at arc lengths (...) of the tractor point [m]; inf: free ground."""
        distance = np.asarray(distance_m, dtype=float)
        if not self.along_m:
            return np.full_like(distance, self.half_width_m)
        holds = np.searchsorted(np.ravel(self.along_m), distance, side="right") % 2 == 1
        return np.where(holds, self.half_width_m, np.inf)
