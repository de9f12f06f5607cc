"""`[path]`: where to drive, how often and how fast."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as File
from typing import Annotated, Literal, Self

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, Positive
from ttempc.reference.headland import headland
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed
from ttempc.reference.smoothing import smooth
from ttempc.reference.speed import PlannedSpeed

from ..errors import InvalidScenario
from .mission import Course
from .waypoint_file import read_route


class Anchored:
    """A path without files, wherever its scenario stands."""

    def anchored(self, folder: File) -> Self:
        """Return the same with the paths of its files made absolute from `folder`."""
        return self


@dataclass(frozen=True, config=STRICT)
class FigureEight(Anchored):
    """Two circles joined by two crossing straights; the long axis lies east-west."""

    kind: Literal["figure-eight"] = "figure-eight"
    radius_m: Positive = 10.0
    centre_distance_m: Positive = 30.0
    blend_m: Positive = 2.0  # length over which curvature goes from 0 to that of the circle
    laps: Annotated[int, Field(ge=1, le=100)] = 2
    speed_mps: Positive = 1.0
    reverse: bool = False  # the vehicle backs along the path

    def course(self) -> Course:
        """Return path and speed.

        Raises:
            InvalidPath: circles, blends and straights do not fit together.
        """
        path = figure_eight(self.radius_m, self.centre_distance_m, self.blend_m, self.laps)
        return Course.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, config=STRICT)
class Straight(Anchored):
    """A straight line to the east from the middle of the field."""

    kind: Literal["straight"]
    length_m: Positive = 30.0
    speed_mps: Positive = 1.0
    reverse: bool = False  # the vehicle backs along the path

    def course(self) -> Course:
        """Return path and speed."""
        path = straight(self.length_m)
        return Course.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, config=STRICT)
class Headland(Anchored):
    """Parallel passes, east-west about the middle of the field, with turns beyond their ends."""

    kind: Literal["headland"]
    length_m: Positive = 30.0  # of each pass
    width_m: Positive = 4.0  # from pass to pass
    passes: Annotated[int, Field(ge=1, le=200)] = 4
    radius_m: Positive = 7.0  # smallest of the turns; these are loops, half circles or U's
    blend_m: Positive = 2.0  # length over which curvature goes from 0 to that of the turn
    speed_mps: Positive = 1.0
    reverse: bool = False  # the vehicle backs along the path

    def course(self) -> Course:
        """Return path and speed."""
        path = headland(self.length_m, self.width_m, self.passes, self.radius_m, self.blend_m)
        return Course.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, config=STRICT)
class FilePath(Anchored):
    """Points from a file, smoothed; formats and columns: `waypoint_file.read_route`."""

    kind: Literal["file"]
    file: str  # relative to the scenario
    max_deviation_m: Positive = 0.1  # of the smoothed path from the line through the points
    speed_mps: Positive | None = None  # instead of the file's own; 1.0 where that has none
    acceleration_mps2: Positive = 0.1  # between the file's own speeds
    origin_m: tuple[float, float] | None = None  # file coordinates of the middle of the field
    origin_deg: tuple[float, float] | None = None  # latitude, longitude of it (GeoJSON)
    reverse: bool = False  # the vehicle backs along the path

    def course(self) -> Course:
        """Return path and speed.

        Raises:
            InvalidRoute: the file is missing or is not understood.
            InvalidPath: its points make no path.
            InvalidReference: its speeds cannot be driven.
            InvalidScenario: the file backs up, the scenario does not.
        """
        file = File(self.file)
        route = read_route(file, self.origin_m, self.origin_deg)
        if route.backward and not self.reverse:
            raise InvalidScenario(f"path: {file} is driven backward, set path.reverse = true")
        smoothed = smooth(route.points, self.max_deviation_m)
        if self.speed_mps is None and route.speed is not None:
            speed = PlannedSpeed(smoothed.distance_m, route.speed, self.acceleration_mps2)
        else:
            speed = ConstantSpeed(self.speed_mps or 1.0)
        note = (
            f"path: {len(route.points)} points of {file.name}, smoothed within "
            f"{100.0 * smoothed.deviation_m:.1f} cm of the line through them"
        )
        return Course.along(smoothed.path, speed, reverse=self.reverse, notes=(note,))

    def anchored(self, folder: File) -> Self:
        """Return the same with the path of its file made absolute from `folder`."""
        return replace(self, file=str((folder / self.file).resolve()))


PathSettings = Annotated[FigureEight | Straight | Headland | FilePath, Field(discriminator="kind")]
