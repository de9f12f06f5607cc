"""Mission: a path, a speed profile and a gear."""

from __future__ import annotations

from dataclasses import dataclass

from ttempc.reference.path import Path
from ttempc.reference.reference import SpeedProfile
from ttempc.reference.speed import Backward


@dataclass(frozen=True, slots=True)
class Mission:
    """Path, speed and gear of a run; they do not depend on the controller."""

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
