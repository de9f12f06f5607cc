"""Terrain features: rises, furrows, bumps, ditches and steps.

A feature is a height [m] as a function of the position in the map frame, in closed form. Keys that
end in `_deg` are directions, counter-clockwise from x (east). `Terrain.shaped` adds a feature to a
grid and refuses a feature that the grid cannot represent. A flank is at most as high as it is
long, 45 degrees on average, because the wheel model (`testbed.wheels.tyre`) samples heights and
has no contact with walls.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, BearingDeg, LengthM, NotNegative, PlaceM

Profile = Literal["cosine", "cylinder"]

STEEPEST_RISE_RAD: Final = 0.6  # as for the slope of a whole field


class Feature(Protocol):
    """A height that is added to the ground."""

    @property
    def kind(self) -> str:
        """Noun that begins an error message."""
        ...

    @property
    def place(self) -> tuple[float, float] | None:
        """(x, y) [m] that must lie on the field; None for a feature of the whole field."""
        ...

    @property
    def flank(self) -> float:
        """Shortest horizontal distance [m] over which the feature reaches its height."""
        ...

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        ...


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Rise:
    """A slope between two level parts of the field, with a rounded valley and a rounded crest.

    With u [m] the distance from (x, y) uphill, the slope grows linearly to tan(slope) over the
    rounding, is constant, and falls to 0 over the rounding until u = length. The ground behind it
    is level and tan(slope) (length - rounding) higher. The rise spans the field across its
    direction.
    """

    kind: Literal["rise"] = "rise"
    """Kind of feature."""
    x_m: PlaceM
    """Start of the rise, map frame."""
    y_m: PlaceM
    """Start of the rise, map frame."""
    slope_rad: Annotated[float, Field(ge=-STEEPEST_RISE_RAD, le=STEEPEST_RISE_RAD)]
    """Largest slope; negative where the ground falls."""
    length_m: LengthM
    """Distance between the level parts."""
    rounding_m: LengthM = 2.0
    """Length of the valley and of the crest."""
    uphill_deg: BearingDeg = 0.0
    """Direction of the rise, counter-clockwise from east."""

    def __post_init__(self) -> None:
        if 2.0 * self.rounding_m > self.length_m:
            raise ValueError(
                f"got rounding_m {self.rounding_m}, must be at most half the length, "
                f"{0.5 * self.length_m} m"
            )

    @property
    def place(self) -> tuple[float, float]:
        """Start of the rise (x, y) [m]."""
        return self.x_m, self.y_m

    @property
    def flank(self) -> float:
        """Length of the valley [m]."""
        return self.rounding_m

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        along, _ = _rotated(self.place, self.uphill_deg, x, y)
        crest = along - (self.length_m - self.rounding_m)
        return math.tan(self.slope_rad) * (self._ramp(along) - self._ramp(crest))

    def _ramp(self, along: FloatArray) -> FloatArray:
        """Return the integral of a slope that grows from 0 to 1 over the rounding."""
        curve = np.clip(along, 0.0, self.rounding_m)
        return curve**2 / (2.0 * self.rounding_m) + np.maximum(along - self.rounding_m, 0.0)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Furrows:
    """Ridges and furrows over the whole field: depth/2 cos(2 pi u / period), u across them.

    A ridge runs through the origin of the map.
    """

    kind: Literal["furrows"] = "furrows"
    """Kind of feature."""
    period_m: LengthM
    """Distance from ridge to ridge."""
    depth_m: LengthM
    """Height of a ridge above a furrow."""
    along_deg: BearingDeg = 90.0
    """Direction of the furrows, counter-clockwise from east."""

    def __post_init__(self) -> None:
        _check_steepness("depth_m", self.depth_m, self.flank)

    @property
    def place(self) -> None:
        """None: the furrows cover the field."""
        return

    @property
    def flank(self) -> float:
        """Distance from furrow to ridge [m]."""
        return 0.5 * self.period_m

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        _, across = _rotated((0.0, 0.0), self.along_deg, x, y)
        return 0.5 * self.depth_m * np.cos(2.0 * math.pi / self.period_m * across)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Bump:
    """An obstacle along a line, with round ends.

    With d [m] the distance from the line, the height is 0 where d > width/2, elsewhere

        cosine     height/2 (1 + cos(2 pi d / width))
        cylinder   the segment of a circle with chord `width` and sagitta `height`.
    """

    kind: Literal["bump"] = "bump"
    """Kind of feature."""
    x_m: PlaceM
    """Middle of the line, map frame."""
    y_m: PlaceM
    """Middle of the line, map frame."""
    height_m: LengthM
    """Height on the line."""
    width_m: LengthM
    """Width across the line."""
    length_m: NotNegative = 0.0
    """Length of the line without the round ends; 0: a round bump."""
    along_deg: BearingDeg = 90.0
    """Direction of the line, counter-clockwise from east."""
    profile: Profile = "cosine"
    """Shape of a section across the line."""

    def __post_init__(self) -> None:
        _check_steepness("height_m", self.height_m, self.flank)

    @property
    def place(self) -> tuple[float, float]:
        """Middle of the line (x, y) [m]."""
        return self.x_m, self.y_m

    @property
    def flank(self) -> float:
        """Half the width [m]."""
        return 0.5 * self.width_m

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        distance = _distance_from_line(self, x, y)
        if self.profile == "cosine":
            return _cosine(self.height_m, distance, self.flank)
        radius = (self.flank**2 + self.height_m**2) / (2.0 * self.height_m)
        return np.sqrt(radius**2 - distance**2) - math.sqrt(radius**2 - self.flank**2)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Ditch:
    """A trench along a line, with round ends: a cosine bump of negative height."""

    kind: Literal["ditch"] = "ditch"
    """Kind of feature."""
    x_m: PlaceM
    """Middle of the line, map frame."""
    y_m: PlaceM
    """Middle of the line, map frame."""
    depth_m: LengthM
    """Depth on the line."""
    width_m: LengthM
    """Width across the line, at the top."""
    length_m: NotNegative = 0.0
    """Length of the line without the round ends; 0: a round hole."""
    along_deg: BearingDeg = 90.0
    """Direction of the line, counter-clockwise from east."""

    def __post_init__(self) -> None:
        _check_steepness("depth_m", self.depth_m, self.flank)

    @property
    def place(self) -> tuple[float, float]:
        """Middle of the line (x, y) [m]."""
        return self.x_m, self.y_m

    @property
    def flank(self) -> float:
        """Half the width [m]."""
        return 0.5 * self.width_m

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]; negative inside the ditch."""
        return _cosine(-self.depth_m, _distance_from_line(self, x, y), self.flank)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Step:
    """Ground that is higher behind a line, with a straight ramp; it spans the field."""

    kind: Literal["step"] = "step"
    """Kind of feature."""
    x_m: PlaceM
    """Start of the ramp, map frame."""
    y_m: PlaceM
    """Start of the ramp, map frame."""
    height_m: PlaceM
    """Height behind the ramp; negative for a step down."""
    ramp_m: LengthM
    """Length of the ramp."""
    uphill_deg: BearingDeg = 0.0
    """Direction across the step, counter-clockwise from east."""

    def __post_init__(self) -> None:
        _check_steepness("height_m", self.height_m, self.flank)

    @property
    def place(self) -> tuple[float, float]:
        """Start of the ramp (x, y) [m]."""
        return self.x_m, self.y_m

    @property
    def flank(self) -> float:
        """Length of the ramp [m]."""
        return self.ramp_m

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        along, _ = _rotated(self.place, self.uphill_deg, x, y)
        return self.height_m * np.clip(along / self.ramp_m, 0.0, 1.0)


AnyFeature = Annotated[Rise | Furrows | Bump | Ditch | Step, Field(discriminator="kind")]
"""A table with a key `kind`."""


def _rotated(
    origin: tuple[PlaceM, PlaceM], direction_deg: float, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates of (x, y) [m] along and across a direction through an origin."""
    dx, dy = np.asarray(x) - origin[0], np.asarray(y) - origin[1]
    direction = math.radians(direction_deg)
    cosine, sine = math.cos(direction), math.sin(direction)
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _distance_from_line(feature: Bump | Ditch, x: ArrayLike, y: ArrayLike) -> FloatArray:
    """Return the distance of (x, y) [m] from the line of a feature, at most its flank [m]."""
    along, across = _rotated(feature.place, feature.along_deg, x, y)
    beyond = np.maximum(np.abs(along) - 0.5 * feature.length_m, 0.0)
    return np.minimum(np.hypot(beyond, across), feature.flank)


def _cosine(height: float, distance: FloatArray, flank: float) -> FloatArray:
    return 0.5 * height * (1.0 + np.cos(math.pi * distance / flank))


def _check_steepness(key: str, height: float, flank: float) -> None:
    if abs(height) > flank:
        raise ValueError(
            f"got {key} {height} over a flank of {flank} m, must be at most as high as long"
        )
