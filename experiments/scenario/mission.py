"""Mission: path, speed profile and gear; corridor about the path."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Final

from pydantic import Field
from pydantic.dataclasses import dataclass as validated_dataclass

from ttempc.reference.corridor import Corridor, SpeedTube
from ttempc.reference.path import Path
from ttempc.reference.reference import SpeedProfile
from ttempc.reference.speed import Backward, limited_in_corridor

from ...testbed.configuration.config_io import STRICT, NotNegative, Positive
from ..errors import InvalidScenario

MOST_M: Final = 100_000
"""Longest path: a day at 1 m/s."""
MOST_TICKS: Final = 1_000_000
"""Largest number of control ticks: two days at 5 Hz, a gigabyte of rows."""
_ROUNDING = 1e-9  # of half widths


@dataclass(frozen=True, slots=True)
class Mission:
    """Path, speed and gear of a run."""

    path: Path  # in the direction of the vehicle's heading
    speed: SpeedProfile
    reverse: bool  # in reverse gear, from the end of the path to its beginning
    notes: tuple[str, ...] = ()  # lines for the log

    @classmethod
    def along(
        cls, path: Path, speed: SpeedProfile, *, reverse: bool, notes: tuple[str, ...] = ()
    ) -> Mission:
        """Return the mission along `path` from its beginning; `reverse`: in reverse gear."""
        if reverse:
            path, speed = path.reversed(), Backward(speed, path.length_m)
        return cls(path, speed, reverse, notes)

    def check_size(self, period_s: float) -> None:
        """Refuse a path that is too long for a run with this control period [s].

        Raises:
            InvalidScenario: with its length or its ticks, and the limit.
        """
        length_m = self.path.length_m
        ticks = self.speed.duration_s(length_m) / period_s
        for what, count, limit in (("m", length_m, MOST_M), ("control ticks", ticks, MOST_TICKS)):
            if not count <= limit:
                raise InvalidScenario(
                    f"path: {count:.6g} {what}, must be {limit} or fewer: a shorter path, fewer "
                    "laps or a higher speed"
                )

    def in_corridor(self, corridor: Corridor, tube: SpeedTube) -> Mission:
        """Return the mission at speeds at which a tube fits into a corridor, where it can."""
        half_width = corridor.half_width_m
        limit = tube.speed_within(half_width)
        speed = limited_in_corridor(self.speed, self.path.length_m, corridor, limit)
        if speed is self.speed:
            return self
        widths = tube.half_width(limit)
        kept = ", ".join(f"{100.0 * width:.1f}" for width in widths)
        late = speed.duration_s(self.path.length_m) - self.speed.duration_s(self.path.length_m)
        note = (
            f"corridor of +-{100.0 * half_width:.1f} cm: {limit:.2f} m/s, at which tractor and "
            f"trailer keep +-({kept}) cm; {late:.0f} s more"
        )
        if widths.max() > half_width * (1.0 + _ROUNDING):
            note += "; corridor cannot be kept at any speed"
        return replace(self, speed=speed, notes=(*self.notes, note))


@validated_dataclass(frozen=True, config=STRICT)
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
