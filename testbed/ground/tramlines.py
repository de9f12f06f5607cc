"""Wheel tracks of earlier passes, rolled firmer or worked softer than the ground beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from ttempc.types import FloatArray

from ..errors import InvalidField

_STEP_OF_WIDTH: Final = 0.2  # of the points along a track: its edge is short by 1 % of its width


@dataclass(frozen=True, slots=True, eq=False)
class Tramlines:
    """Two tracks beside every line that was driven; where tracks cross, they count once.

    Raises:
        InvalidField: there is no line, one has less than two points or one that is not finite, the
            width is not above 0 or above the distance of the tracks, or the factor is not in
            [0.05, 20].
    """

    lines: tuple[FloatArray, ...]  # each (n, 2) [m], the middle between both tracks
    track: float  # [m] from the middle of the left track to that of the right one
    width: float  # [m] of each track
    factor: float  # cone index in a track over that of what lies below

    _points: KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.track) and 0.0 < self.width <= self.track):
            raise InvalidField(
                f"tramlines: got tracks {self.width} m wide and {self.track} m apart, "
                "the width must be above 0 and at most the distance"
            )
        if not 0.05 <= self.factor <= 20.0:
            raise InvalidField(f"tramlines: got factor {self.factor}, must be in [0.05, 20]")
        if not self.lines:
            raise InvalidField("tramlines: got no line, must be one or more")
        lines = tuple(np.asarray(line, dtype=float) for line in self.lines)
        for line in lines:
            if line.ndim != 2 or line.shape[1:] != (2,) or len(line) < 2:
                raise InvalidField(f"tramlines: got a {line.shape} line, must be (2 or more, 2)")
            if not np.isfinite(line).all():
                raise InvalidField("tramlines: got a point that is not finite")
            if not np.any(line != line[0]):
                raise InvalidField(f"tramlines: got a line without length at {tuple(line[0])} m")
        object.__setattr__(self, "lines", lines)
        object.__setattr__(self, "_points", KDTree(np.concatenate(list(self._tracks()))))

    @property
    def finest(self) -> float:
        """The width of a track [m]."""
        return self.width

    def over(self, below: FloatArray, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]."""
        places = np.stack(np.broadcast_arrays(x, y), axis=-1)  # (..., 2)
        reach = 0.5 * self.width
        distance, _ = self._points.query(places, distance_upper_bound=reach * (1.0 + 1e-12))
        return np.where(np.isfinite(distance), self.factor * below, below)

    def _tracks(self) -> Iterable[FloatArray]:
        """Yield points along each track, near enough to each other to make a line, (n, 2)."""
        for line in self.lines:
            steps = np.diff(line, axis=0)
            steps = steps[np.any(steps != 0.0, axis=1)]  # (pieces, 2)
            lengths = np.linalg.norm(steps, axis=1)
            ends = np.concatenate([[0.0], np.cumsum(lengths)])  # (pieces + 1,)
            count = math.ceil(ends[-1] / (_STEP_OF_WIDTH * self.width)) + 1
            places = np.linspace(0.0, ends[-1], count)
            piece = np.clip(np.searchsorted(ends, places, "right") - 1, 0, len(steps) - 1)
            ahead = (steps / lengths[:, None])[piece]  # (count, 2)
            driven = line[0] + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])[piece]
            driven += (places - ends[piece])[:, None] * ahead
            left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
            for side in (0.5, -0.5):
                yield driven + side * self.track * left


def parallel_lines(
    start: tuple[float, float], heading: float, length: float, count: int, spacing: float
) -> tuple[FloatArray, ...]:
    """Return straight lines of one heading [rad], each `spacing` [m] to the left of the last.

    Args:
        start: where the first begins (x, y) [m].
        heading: counter-clockwise from x [rad].
        length: of each [m].
        count: how many.
        spacing: from line to line [m].
    """
    ahead = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    first = np.array([start, start + length * ahead])  # (2, 2)
    return tuple(first + index * spacing * left for index in range(count))
