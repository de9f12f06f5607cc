"""`[[soil.tramlines]]`: wheel tracks of earlier passes."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, Positive
from proving_ground.testbed.ground.tramlines import Tramlines, parallel_lines
from ttempc.reference.path import Path
from ttempc.types import FloatArray

# The vehicle stands with its trailer behind the beginning of a path and stops beyond its end.
_BEYOND_PATH_M = 5.0
_PATH_STEP_M = 0.2


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Tracks:
    """What all tramlines have: two tracks of changed soil, by default those of the tractor."""

    track_m: Positive = 0.95  # between the middles of left and right track
    width_m: Positive = 0.3  # of each track
    strength_factor: Positive = 1.5  # assumed; cone index in a track over that beside it

    def over(self, *lines: FloatArray) -> Tramlines:
        """Return the tracks beside these lines, each (n, 2) [m].

        Raises:
            InvalidField: they cannot be.
        """
        return Tramlines(lines, self.track_m, self.width_m, self.strength_factor)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PathTramlines(Tracks):
    """The wheels of the last pass ran along the reference path itself."""

    kind: Literal["path"]

    def tramlines(self, path: Path) -> Tramlines:
        """Return the tracks.

        Raises:
            InvalidField: they cannot be.
        """
        along = np.arange(-_BEYOND_PATH_M, path.lap_m + _BEYOND_PATH_M, _PATH_STEP_M)
        return self.over(path.pose(along)[:, :2])


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LineTramlines(Tracks):
    """The wheels ran along a line through given points."""

    kind: Literal["line"]
    points_m: tuple[tuple[float, float], ...]

    def tramlines(self, path: Path) -> Tramlines:
        """Return the tracks, wherever the path is.

        Raises:
            InvalidField: they cannot be.
        """
        return self.over(np.array(self.points_m))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PassesTramlines(Tracks):
    """Straight passes beside each other, from a sprayer or a seeder, say."""

    kind: Literal["passes"]
    x_m: float  # where the first pass begins
    y_m: float
    heading_deg: float = 0.0  # counter-clockwise from east
    length_m: Positive
    passes: Annotated[int, Field(ge=1, le=200)] = 1
    spacing_m: Positive = 3.0  # from pass to pass, to the left

    def tramlines(self, path: Path) -> Tramlines:
        """Return the tracks, wherever the path is.

        Raises:
            InvalidField: they cannot be.
        """
        start, heading = (self.x_m, self.y_m), math.radians(self.heading_deg)
        return self.over(
            *parallel_lines(start, heading, self.length_m, self.passes, self.spacing_m)
        )


TramlinesSettings = Annotated[
    PathTramlines | LineTramlines | PassesTramlines, Field(discriminator="kind")
]
