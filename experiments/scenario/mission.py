"""A course: a path, how fast it is driven and in which gear."""

from __future__ import annotations

from dataclasses import dataclass

from ttempc.reference.path import Path
from ttempc.reference.reference import SpeedProfile
from ttempc.reference.speed import Backward


@dataclass(frozen=True, slots=True)
class Course:
    """Where and how fast to drive, whoever drives it."""

    path: Path  # in the direction in which the vehicle looks
    speed: SpeedProfile
    reverse: bool  # in reverse gear, from the end of the path to its beginning
    notes: tuple[str, ...] = ()  # what a reader of the log should know of it

    @classmethod
    def along(
        cls, path: Path, speed: SpeedProfile, *, reverse: bool, notes: tuple[str, ...] = ()
    ) -> Course:
        """Return the course along `path` from its beginning; in reverse the vehicle backs it."""
        if reverse:
            path, speed = path.reversed(), Backward(speed, path.length_m)
        return cls(path, speed, reverse, notes)
