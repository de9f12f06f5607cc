"""`[[soil.tramlines]]`: wheel tracks of earlier passes."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.reference.path import Path

from ...testbed.configuration.config_io import STRICT, BearingDeg, LengthM, PlaceM
from ...testbed.ground.tramlines import Tracks, Tramlines, parallel_lines

# The trailer starts behind the beginning of the path, and the vehicle stops behind its end.
_BEYOND_PATH_M: Final = 5.0
_PATH_STEP_M: Final = 0.2


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PathTramlines(Tracks):
    """Tracks of an earlier pass along the reference path."""

    kind: Literal["path"] = "path"
    """Kind of tramlines."""

    def tramlines(self, path: Path) -> Tramlines:
        """Return the soil layer."""
        along = np.arange(-_BEYOND_PATH_M, path.lap_m + _BEYOND_PATH_M, _PATH_STEP_M)
        return Tramlines((path.pose(along)[:, :2],), self)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LineTramlines(Tracks):
    """Tracks of a pass along a line through given points."""

    kind: Literal["line"] = "line"
    """Kind of tramlines."""
    points_m: tuple[tuple[PlaceM, PlaceM], ...]
    """Points (x, y), map frame."""

    def tramlines(self, path: Path) -> Tramlines:
        """Return the soil layer; it does not depend on the path.

        Raises:
            InvalidField: the points make no line.
        """
        return Tramlines((np.array(self.points_m),), self)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PassesTramlines(Tracks):
    """Tracks of straight parallel passes, for example of a sprayer or a seeder."""

    kind: Literal["passes"] = "passes"
    """Kind of tramlines."""
    x_m: PlaceM
    """Start of the first pass, map frame."""
    y_m: PlaceM
    """Start of the first pass, map frame."""
    heading_deg: BearingDeg = 0.0
    """Direction of the passes, counter-clockwise from east."""
    length_m: LengthM
    """Length of each pass."""
    passes: Annotated[int, Field(ge=1, le=200)] = 1
    """Number of passes."""
    spacing_m: LengthM = 3.0
    """Distance from pass to pass, to the left."""

    def tramlines(self, path: Path) -> Tramlines:
        """Return the soil layer; it does not depend on the path."""
        start, heading = (self.x_m, self.y_m), math.radians(self.heading_deg)
        lines = parallel_lines(start, heading, self.length_m, self.passes, self.spacing_m)
        return Tramlines(lines, self)


AnyTramlines = Annotated[
    PathTramlines | LineTramlines | PassesTramlines, Field(discriminator="kind")
]
"""A table with a key `kind`."""
