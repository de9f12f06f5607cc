"""`[corridor]`: ground beside the path that the vehicle must not touch."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, NotNegative, Positive
from ttempc.reference.corridor import Corridor


@dataclass(frozen=True, config=STRICT)
class CorridorSettings:
    """Corridor about the path for both axle points and the tool, and limit of the hitch angle.

    By it a run is judged, and a controller that can keep to it is told.
    """

    half_width_m: Positive
    """Largest distance of a point from the path."""
    along_m: tuple[tuple[NotNegative, NotNegative], ...] = ()
    """Intervals [from, to] of the path, by the tractor point, where it holds; empty: everywhere."""
    hitch_limit_deg: Annotated[float, Field(gt=0, le=120)] | None = None
    """Largest angle between tractor and drawbar; absent: not limited."""

    def corridor(self, tool_behind_m: float | None) -> Corridor:
        """Return the corridor of a vehicle with a tool so far behind the trailer point, if any.

        Raises:
            InvalidTuning: the intervals do not increase.
        """
        limit = self.hitch_limit_deg
        return Corridor(
            half_width_m=self.half_width_m,
            along_m=self.along_m,
            hitch_limit=None if limit is None else math.radians(limit),
            tool_behind_m=tool_behind_m,
        )
