"""Tramlines: wheel tracks of earlier passes, compacted or loosened against the soil beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass as stdlib_dataclass
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, PlaceM
from ..errors import InvalidField

if TYPE_CHECKING:
    from scipy.spatial import KDTree

_STEP_OF_WIDTH: Final = 0.2  # of the points along a track: its edge is short by 1 % of its width


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Tracks:
    """Two tracks of changed soil beside a line; the default ones are those of the tractor."""

    # Descriptions instead of docstrings, because subclasses do not inherit those.
    track_m: Annotated[
        float, Field(ge=1e-3, le=100, description="Distance between the middles of both tracks.")
    ] = 0.95
    width_m: Annotated[float, Field(ge=1e-3, le=100, description="Width of each track.")] = 0.3
    strength_factor: Annotated[
        float,
        Field(ge=0.05, le=20, description="Cone index in a track over that beside it; assumed."),
    ] = 1.5

    def __post_init__(self) -> None:
        if self.width_m > self.track_m:
            raise ValueError(
                f"got tracks {self.width_m} m wide and {self.track_m} m apart, "
                "the width must be at most the distance"
            )


@stdlib_dataclass(frozen=True, slots=True, eq=False)
class Tramlines:
    """Soil layer of two tracks beside every line; where tracks cross, they count once.

    Raises:
        InvalidField: there is no line, or a line has less than two points, no length or a point
            that is not finite.
    """

    lines: tuple[FloatArray, ...]  # each (n, 2) [m], the middle between both tracks
    tracks: Tracks

    _points: KDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
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
        points = np.concatenate(list(self._track_points()))
        object.__setattr__(self, "_points", scipy.spatial.KDTree(points))

    @property
    def finest(self) -> float:
        """The width of a track [m]."""
        return self.tracks.width_m

    def over(self, below: FloatArray, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] over that of the layers below [kPa]."""
        places = np.stack(np.broadcast_arrays(x, y), axis=-1)  # (..., 2)
        reach = 0.5 * self.tracks.width_m
        distance, _ = self._points.query(places, distance_upper_bound=reach * (1.0 + 1e-12))
        return np.where(np.isfinite(distance), self.tracks.strength_factor * below, below)

    def _track_points(self) -> Iterable[FloatArray]:
        """Yield the points along each track, (n, 2) [m]."""
        for line in self.lines:
            steps = np.diff(line, axis=0)
            steps = steps[np.any(steps != 0.0, axis=1)]  # (pieces, 2)
            lengths = np.linalg.norm(steps, axis=1)
            ends = np.concatenate([[0.0], np.cumsum(lengths)])  # (pieces + 1,)
            count = math.ceil(ends[-1] / (_STEP_OF_WIDTH * self.tracks.width_m)) + 1
            places = np.linspace(0.0, ends[-1], count)
            piece = np.clip(np.searchsorted(ends, places, "right") - 1, 0, len(steps) - 1)
            ahead = (steps / lengths[:, None])[piece]  # (count, 2)
            driven = line[0] + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])[piece]
            driven += (places - ends[piece])[:, None] * ahead
            left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
            for side in (0.5, -0.5):
                yield driven + side * self.tracks.track_m * left


def parallel_lines(
    start: tuple[PlaceM, PlaceM], heading: float, length: float, count: int, spacing: float
) -> tuple[FloatArray, ...]:
    """Return parallel straight lines (2, 2) [m], each to the left of the last.

    Args:
        start: start of the first line (x, y) [m].
        heading: direction, counter-clockwise from x [rad].
        length: length of each line [m].
        count: number of lines.
        spacing: distance from line to line [m].
    """
    ahead = np.array([math.cos(heading), math.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    first = np.array([start, start + length * ahead])  # (2, 2)
    return tuple(first + index * spacing * left for index in range(count))
