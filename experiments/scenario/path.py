"""`[path]`, `[start]` and `[corridor]`: path, speed, gear, first place, space about the path."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass as stdlib_dataclass
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.reference.corridor import Corridor, SpeedTube
from ttempc.reference.headland import headland
from ttempc.reference.leading import check_plain, leading_path
from ttempc.reference.path import Path as ReferencePath
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import Comfortable, ConstantSpeed, SpeedProfile
from ttempc.reference.smoothing import smooth, thinned
from ttempc.reference.speed import Backward, PlannedSpeed, limited_in_corridor, limited_in_curves
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

from ...testbed.configuration.config_io import (
    STRICT,
    DataFile,
    LengthM,
    NotNegative,
    Positive,
    SpeedMps,
)
from ...testbed.geodesy import DEFAULT_FRAME, MapFrame
from ..errors import InvalidScenario
from ..formats.field import FieldSettings
from .waypoint_file import read_waypoints

MOST_M: Final = 100_000
"""Longest path: a day at 1 m/s."""
MOST_TICKS: Final = 1_000_000
"""Largest number of control ticks: two days at 5 Hz, a gigabyte of rows."""
_ROUNDING = 1e-9  # of half widths
_BENT_M: Final = 0.1  # by which the path of a leading tractor may be smoothed
_LINE_STEP_M: Final = 0.1  # between the points of a path as a line
_SLOWEST_MPS: Final = 0.1
"""Slowest speed of a reference; one that stands has no direction to be tracked in."""


@stdlib_dataclass(frozen=True, slots=True)
class Mission:
    """Path, speed and gear of a run."""

    path: ReferencePath  # in the direction of the vehicle's heading
    speed: SpeedProfile
    reverse: bool  # in reverse gear, from the end of the path to its beginning
    notes: tuple[str, ...] = ()  # lines for the log
    frame: MapFrame = DEFAULT_FRAME  # place of the map on the earth
    line: FloatArray | None = None  # (n, 2) [m] as given, in driving order; None: the path itself

    @classmethod
    def along(
        cls,
        path: ReferencePath,
        speed: SpeedProfile,
        *,
        reverse: bool,
        notes: tuple[str, ...] = (),
        line: FloatArray | None = None,
    ) -> Mission:
        """Return the mission along `path` from its beginning; `reverse`: in reverse gear."""
        if reverse:
            speed = Backward(speed, path.length_m)
            path = path.reversed()
        return cls(path, speed, reverse, notes, line=line)

    def driven_line(self) -> FloatArray:
        """Return the line that was given, in driving order, (n, 2) [m]; all laps of a path."""
        if self.line is not None:
            return self.line
        length_m = self.path.length_m
        along = np.linspace(0.0, length_m, math.ceil(length_m / _LINE_STEP_M) + 1)
        return self.path.pose(along[::-1] if self.reverse else along)[:, :2]

    def led_by(self, vehicle: Vehicle, max_deviation_m: float) -> Mission:
        """Return the mission on which the working point of a plain trailer is on the line.

        The tractor leads it there, on a path of its own that `max_deviation_m` [m] may smooth.
        """
        check_plain(vehicle)
        suits = Comfortable(vehicle, self.speed.top_speed)
        path = leading_path(self.path, vehicle, max_deviation_m, suits)
        speed = self.speed
        if isinstance(speed, Backward):
            speed = replace(speed, start_m=path.length_m)
        note = "path: the working point is on the line, the tractor leads it there"
        notes = (*self.notes, note)
        return replace(self, path=path, speed=speed, notes=notes, line=self.driven_line())

    def check_size(self, period_s: float) -> None:
        """Refuse a path that is too long for a run with this control period [s]."""
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


OnLine = Literal["tractor", "working-point"]
"""Point of a vehicle with a plain trailer that keeps to the line."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class CurveSpeed:
    """Slower in curves: the speed there follows from a largest lateral acceleration."""

    lateral_mps2: Positive
    """Largest lateral acceleration of the tractor point: speed squared times curvature."""
    acceleration_mps2: Positive = 0.2
    """Largest acceleration along the path, before a curve and behind it."""

    def limit(self, speed: SpeedProfile, path: ReferencePath) -> SpeedProfile:
        """Return a forward profile along a path, slower in its curves."""
        return limited_in_curves(speed, path, self.lateral_mps2, self.acceleration_mps2)


class _ClosedForm:
    speed_mps: float
    curves: CurveSpeed | None
    reverse: bool
    max_deviation_m = _BENT_M

    @abstractmethod
    def path(self) -> ReferencePath:
        """Return the path."""

    def mission(self) -> Mission:
        """Return path, speed and gear."""
        path = self.path()
        speed: SpeedProfile = ConstantSpeed(self.speed_mps)
        if self.curves:
            speed = self.curves.limit(speed, path)
        return Mission.along(path, speed, reverse=self.reverse)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FigureEight(_ClosedForm):
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
    curves: CurveSpeed | None = None
    """Slower in curves; absent: one speed."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""
    on_line: OnLine = "tractor"
    """Point that keeps to the line where the trailer has no steering: the tractor, or the working
    point (the tool, else the trailer's axle)."""

    def path(self) -> ReferencePath:
        """Return the path."""
        return figure_eight(self.radius_m, self.centre_distance_m, self.blend_m, self.laps)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Straight(_ClosedForm):
    """A straight line to the east from the middle of the field."""

    kind: Literal["straight"] = "straight"
    """Kind of path."""
    length_m: LengthM = 30.0
    """Length of the path."""
    speed_mps: SpeedMps = 1.0
    """Speed along the path."""
    curves: CurveSpeed | None = None
    """Slower in curves; absent: one speed."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""
    on_line: OnLine = "tractor"
    """Point that keeps to the line where the trailer has no steering: the tractor, or the working
    point (the tool, else the trailer's axle)."""

    def path(self) -> ReferencePath:
        """Return the path."""
        return straight(self.length_m)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Headland(_ClosedForm):
    """Parallel passes, east-west about the middle of the field, with turns beyond their ends."""

    kind: Literal["headland"] = "headland"
    """Kind of path."""
    length_m: LengthM = 30.0
    """Length of each pass."""
    width_m: LengthM = 4.0
    """Distance from pass to pass."""
    passes: Annotated[int, Field(ge=1, le=200)] = 4
    """Number of passes."""
    laps: Annotated[int, Field(ge=0, le=100)] = 0
    """Number of laps of two passes with a turn back; 0: none, the passes are driven once."""
    radius_m: LengthM = 7.0
    """Smallest radius of the turns; these are loops, half circles or U turns."""
    blend_m: LengthM = 2.0
    """Length over which the curvature changes from 0 to that of a turn."""
    speed_mps: SpeedMps = 1.0
    """Speed along the path."""
    curves: CurveSpeed | None = None
    """Slower in curves; absent: one speed."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""
    on_line: OnLine = "tractor"
    """Point that keeps to the line where the trailer has no steering: the tractor, or the working
    point (the tool, else the trailer's axle)."""

    def path(self) -> ReferencePath:
        """Return the path."""
        shape = self.length_m, self.width_m, self.passes, self.radius_m, self.blend_m
        return headland(*shape, self.laps)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FilePath:
    """The line through the points of a waypoint file, smoothed as far as the tractor needs it."""

    kind: Literal["file"] = "file"
    """Kind of path."""
    file: DataFile
    """File with the line, relative to the scenario: columns of text, GeoJSON, KML, GPX, ISOXML,
    NMEA, a field folder of AgOpenGPS, a bag of ROS."""
    line: str = ""
    """Name or number of the line, where the file has several."""
    max_deviation_m: LengthM = 0.1
    """Largest distance of the path from the line through the points, where it must be smoothed."""
    speed_mps: SpeedMps | None = None
    """Speed along the path; absent: the speeds of the file, 1.0 if it has none."""
    acceleration_mps2: Positive = 0.1
    """Acceleration between the speeds of the file."""
    curves: CurveSpeed | None = None
    """Slower in curves; absent: the speeds of the file, or the one of `speed_mps`."""
    reverse: bool = False
    """Whether the vehicle drives the path in reverse gear."""
    on_line: OnLine = "tractor"
    """Point that keeps to the line where the trailer has no steering: the tractor, or the working
    point (the tool, else the trailer's axle)."""

    def mission(
        self,
        field: FieldSettings,
        vehicle: Vehicle,
        field_m: tuple[float, float] | None = None,
    ) -> Mission:
        """Return path, speed and gear.

        The path is the nearest to the points that the tractor of `vehicle` can drive with reserves.
        `field_m` is the extent, west-east and south-north, in which all points must lie, None where
        it is not known.
        """
        file = Path(self.file)
        waypoints = read_waypoints(file, field, self.line)
        points = waypoints.points
        if field_m is not None:
            _check_on_field(points, field_m)
        kept = thinned(points)
        speeds, notes = self._speeds(waypoints.speed, kept)
        fastest = float(np.max(speeds))
        suits = Comfortable(vehicle, fastest)
        smoothed = smooth(points[kept], self.max_deviation_m, suits)
        speed: SpeedProfile = ConstantSpeed(fastest)
        if len(speeds) > 1:
            speed = PlannedSpeed(smoothed.distance_m, speeds, self.acceleration_mps2)
        if self.curves:
            speed = self.curves.limit(speed, smoothed.path)
        if len(kept) < len(points):
            notes = (f"path: {len(points) - len(kept)} points too near to another dropped", *notes)
        along = f"within {100.0 * smoothed.deviation_m:.1f} cm of the line through them"
        driven = f"path: {len(points)} points of {file.name}, driven {along}"
        notes = (driven, *notes, *waypoints.notes)
        mission = Mission.along(
            smoothed.path, speed, reverse=self.reverse, notes=notes, line=points
        )
        return replace(mission, frame=waypoints.frame)

    def _speeds(
        self, given: FloatArray | None, kept: NDArray[np.intp]
    ) -> tuple[FloatArray, tuple[str, ...]]:
        """Return the speed of each point that is kept, or one of all, and notes.

        Raises:
            InvalidScenario: the speeds change the gear.
        """
        if self.speed_mps is not None or given is None:
            return np.array([self.speed_mps or 1.0]), ()
        backward = np.flatnonzero(given < 0.0)
        if len(backward):
            cure = "split the file into a forward path and one with path.reverse = true"
            if len(backward) == len(given):
                cure = "give speeds above 0 and path.reverse = true"
            raise InvalidScenario(
                f"path: speed {given[backward[0]]:g} m/s at point {backward[0]}: a path is driven "
                f"in one gear; {cure}"
            )
        speeds = np.maximum(given[kept], _SLOWEST_MPS)
        slow = int(np.sum(given < _SLOWEST_MPS))
        if not slow:
            return speeds, ()
        note = (
            f"path: speeds below {_SLOWEST_MPS:g} m/s at {slow} points driven at that speed, since "
            "a reference that stands cannot be tracked"
        )
        return speeds, (note,)


def _check_on_field(points: FloatArray, field_m: tuple[float, float]) -> None:
    """Refuse points beyond the field before they are smoothed: kilometres take minutes."""
    beyond = np.flatnonzero((np.abs(points) > 0.5 * np.array(field_m)).any(axis=1))
    if len(beyond):
        x, y = points[beyond[0]]
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        raise InvalidScenario(
            f"path: point {beyond[0]} of {len(points)} at x = {x:.6g}, y = {y:.6g} m lies "
            f"beyond the field of {field_m[0]:g} x {field_m[1]:g} m about (0, 0) "
            "(terrain.size_x_m, size_y_m, or the origin in [field]; the middle of the points is at "
            f"{middle[0]:.6g}, {middle[1]:.6g} m)"
        )


AnyPath = Annotated[FigureEight | Straight | Headland | FilePath, Field(discriminator="kind")]
"""A table with a key `kind`; without it, a figure eight."""


@dataclass(frozen=True, config=STRICT)
class StartSettings:
    """Where the vehicle stands at the start, beside the beginning of its path."""

    offset_m: Annotated[float, Field(ge=-20, le=20)] = 0.0
    """Offset of the tractor point to the left of the path."""
    heading_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    """Heading of the vehicle to that of the path, counter-clockwise."""
    rolling: bool = True
    """Whether it rolls at the speed of the path; otherwise it stands."""

    def pose(self, x: float, y: float, yaw: float) -> tuple[float, float, float]:
        """Return place [m] and heading [rad] for a path that begins at `x`, `y` with `yaw`."""
        aside = self.offset_m
        turned = yaw + math.radians(self.heading_deg)
        return x - aside * math.sin(yaw), y + aside * math.cos(yaw), turned


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
        """Return the corridor of a vehicle with a tool so far behind the trailer point, if any."""
        limit = self.hitch_limit_deg
        return Corridor(
            half_width_m=self.half_width_m,
            along_m=self.along_m,
            hitch_limit=None if limit is None else math.radians(limit),
            tool_behind_m=tool_behind_m,
        )
