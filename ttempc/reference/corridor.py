"""Corridor about a path, and limit of the hitch angle: what a vehicle is to keep to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidTuning
from ..types import FloatArray
from ..validation import check_positive


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

    def require_margin(self, margin_m: ArrayLike) -> None:
        """Refuse margins [m] that leave no corridor.

        Raises:
            InvalidTuning: with the numbers.
        """
        worst = float(np.max(margin_m))
        if worst >= self.half_width_m:
            raise InvalidTuning(
                f"corridor_margin_m: got {worst:g} of a corridor of half_width_m "
                f"{self.half_width_m:g}, must be less"
            )

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
