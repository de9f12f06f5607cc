"""`[path]`: where to drive, how often and how fast."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from testbed.strict import STRICT, Positive
from ttempc.path import Path, figure_eight, straight


@dataclass(frozen=True, config=STRICT)
class FigureEight:
    """Two circles joined by two crossing straights; the long axis lies east-west."""

    kind: Literal["figure-eight"] = "figure-eight"
    radius_m: Positive = 10.0
    centre_distance_m: Positive = 30.0
    blend_m: Positive = 2.0  # length over which curvature goes from 0 to that of the circle
    laps: Annotated[int, Field(ge=1, le=100)] = 2
    speed_mps: Positive = 1.0

    def path(self) -> Path:
        """Return the path.

        Raises:
            InvalidPath: circles, blends and straights do not fit together.
        """
        return figure_eight(self.radius_m, self.centre_distance_m, self.blend_m, self.laps)


@dataclass(frozen=True, config=STRICT)
class Straight:
    """A straight line to the east from the middle of the field."""

    kind: Literal["straight"]
    length_m: Positive = 30.0
    speed_mps: Positive = 1.0

    def path(self) -> Path:
        """Return the path."""
        return straight(self.length_m)


PathSettings = Annotated[FigureEight | Straight, Field(discriminator="kind")]
