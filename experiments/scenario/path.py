"""`[path]`: reference path and speed."""

from __future__ import annotations

from pathlib import Path as File
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.reference.headland import headland
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed
from ttempc.reference.smoothing import smooth
from ttempc.reference.speed import PlannedSpeed
from ttempc.types import FloatArray

from ...testbed.configuration.config_io import (
    STRICT,
    DataFile,
    LengthM,
    PlaceM,
    Positive,
    SpeedMps,
)
from ..errors import InvalidScenario
from .mission import Mission
from .waypoint_file import read_waypoints


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FigureEight:
    """Two circles joined by two crossing straights; the long axis lies east-west."""

    kind: Literal["figure-eight"] = "figure-eight"
    """Kind of path."""
    radius_m: LengthM = 10.0
    """Radius of the circles."""
    centre_distance_m: LengthM = 30.0
    """Distance between the centres of the circles."""
    blend_m: LengthM = 2.0
    """Length over which the curvature changes from 0 to that of a circle."""
    laps: Annotated[int, Field(ge=1, le=100)] = 2
    """Number of laps."""
    speed_mps: SpeedMps = 1.0
    """Speed along the path."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""

    def mission(self) -> Mission:
        """Return path, speed and gear.

        Raises:
            InvalidPath: circles, blends and straights do not fit together.
        """
        path = figure_eight(self.radius_m, self.centre_distance_m, self.blend_m, self.laps)
        return Mission.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Straight:
    """A straight line to the east from the middle of the field."""

    kind: Literal["straight"] = "straight"
    """Kind of path."""
    length_m: LengthM = 30.0
    """Length of the path."""
    speed_mps: SpeedMps = 1.0
    """Speed along the path."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""

    def mission(self) -> Mission:
        """Return path, speed and gear."""
        path = straight(self.length_m)
        return Mission.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Headland:
    """Parallel passes, east-west about the middle of the field, with turns beyond their ends."""

    kind: Literal["headland"] = "headland"
    """Kind of path."""
    length_m: LengthM = 30.0
    """Length of each pass."""
    width_m: LengthM = 4.0
    """Distance from pass to pass."""
    passes: Annotated[int, Field(ge=1, le=200)] = 4
    """Number of passes."""
    radius_m: LengthM = 7.0
    """Smallest radius of the turns; these are loops, half circles or U turns."""
    blend_m: LengthM = 2.0
    """Length over which the curvature changes from 0 to that of a turn."""
    speed_mps: SpeedMps = 1.0
    """Speed along the path."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""

    def mission(self) -> Mission:
        """Return path, speed and gear."""
        path = headland(self.length_m, self.width_m, self.passes, self.radius_m, self.blend_m)
        return Mission.along(path, ConstantSpeed(self.speed_mps), reverse=self.reverse)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FilePath:
    """A smooth path through the points of a waypoint file."""

    kind: Literal["file"] = "file"
    """Kind of path."""
    file: DataFile
    """Waypoint file, relative to the scenario; formats: `waypoint_file.read_waypoints`."""
    max_deviation_m: LengthM = 0.1
    """Largest distance of the smoothed path from the line through the points."""
    speed_mps: SpeedMps | None = None
    """Speed along the path; absent: the speeds of the file, 1.0 if it has none."""
    acceleration_mps2: Positive = 0.1
    """Acceleration between the speeds of the file."""
    origin_m: tuple[PlaceM, PlaceM] | None = None
    """File coordinates of the middle of the field."""
    origin_deg: tuple[PlaceM, PlaceM] | None = None
    """Latitude and longitude of the middle of the field (GeoJSON)."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""

    def mission(self, field_m: tuple[float, float] | None = None) -> Mission:
        """Return path, speed and gear.

        Args:
            field_m: extent of the field from west to east and from south to north, in which all
                points must lie; None where it is not known.

        Raises:
            InvalidWaypoints: the file is missing or not understood.
            InvalidPath: the points make no path.
            InvalidReference: the vehicle cannot drive the speeds of the file.
            InvalidScenario: the file drives in reverse gear, the scenario does not.
        """
        file = File(self.file)
        waypoints = read_waypoints(file, self.origin_m, self.origin_deg)
        if waypoints.backward and not self.reverse:
            raise InvalidScenario(f"path: {file} is driven backward, set path.reverse = true")
        if field_m is not None:
            _check_on_field(waypoints.points, field_m)
        smoothed = smooth(waypoints.points, self.max_deviation_m)
        if self.speed_mps is None and waypoints.speed is not None:
            speed = PlannedSpeed(smoothed.distance_m, waypoints.speed, self.acceleration_mps2)
        else:
            speed = ConstantSpeed(self.speed_mps or 1.0)
        note = (
            f"path: {len(waypoints.points)} points of {file.name}, smoothed within "
            f"{100.0 * smoothed.deviation_m:.1f} cm of the line through them"
        )
        return Mission.along(smoothed.path, speed, reverse=self.reverse, notes=(note,))


def _check_on_field(points: FloatArray, field_m: tuple[float, float]) -> None:
    """Refuse points beyond the field before they are smoothed: kilometres take minutes.

    Raises:
        InvalidScenario: with the first of them.
    """
    beyond = np.flatnonzero((np.abs(points) > 0.5 * np.array(field_m)).any(axis=1))
    if len(beyond):
        x, y = points[beyond[0]]
        raise InvalidScenario(
            f"path: point {beyond[0]} of {len(points)} at x = {x:.6g}, y = {y:.6g} m lies "
            f"beyond the field of {field_m[0]:g} x {field_m[1]:g} m about (0, 0) "
            "(terrain.size_x_m, size_y_m, path.origin_m, origin_deg; the file is in metres)"
        )


AnyPath = Annotated[FigureEight | Straight | Headland | FilePath, Field(discriminator="kind")]
"""A table with a key `kind`; without it, a figure eight."""
