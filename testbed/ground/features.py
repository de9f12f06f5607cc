"""Terrain features: rises, furrows, bumps, ditches and steps.

A feature is a height [m] as a function of the position in the map frame, in closed form. Keys that
end in `_deg` are directions, counter-clockwise from x (east). `Terrain.shaped` adds a feature to a
grid and refuses a feature that the grid cannot represent. A flank is at most as high as it is
long, 45 degrees on average, because the wheel model (`testbed.wheels.tyre`) samples heights and
has no contact with walls.
"""

import math
from abc import abstractmethod
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, BearingDeg, LengthM, NotNegative, PlaceM

Profile = Literal["cosine", "cylinder"]

STEEPEST_RISE_RAD: Final = 0.6  # as for the slope of a whole field


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Feature:
    """A height that is added to the ground.

    The keys have descriptions as values: pydantic reads no docstrings of inherited attributes.
    """

    height_key: ClassVar[str] = ""  # key that may be at most `flank` in magnitude
    direction_key: ClassVar[str] = "along_deg"
    kind: Annotated[str, Field(description="Kind of feature.")] = ""

    @property
    def place(self) -> tuple[float, float] | None:
        """(x, y) [m] that must lie on the field; None for a feature of the whole field."""
        return None

    @property
    @abstractmethod
    def flank(self) -> float:
        """Shortest horizontal distance [m] over which the feature reaches its height."""

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height [m] that is added at (x, y) [m]."""
        x0, y0 = self.place or (0.0, 0.0)
        dx = np.asarray(x) - x0
        dy = np.asarray(y) - y0
        direction = math.radians(getattr(self, self.direction_key))
        cosine = math.cos(direction)
        sine = math.sin(direction)
        return self._height(cosine * dx + sine * dy, cosine * dy - sine * dx)

    @abstractmethod
    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        """Return the height [m] at coordinates [m] along and across the feature's direction."""

    def __post_init__(self) -> None:
        key = self.height_key
        if key and abs(getattr(self, key)) > self.flank:
            raise ValueError(
                f"got {key} {getattr(self, key)} over a flank of {self.flank} m, must be at most "
                "as high as long"
            )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _Placed(Feature):
    x_m: Annotated[PlaceM, Field(description="Start of the feature or middle of its line, east.")]
    y_m: Annotated[PlaceM, Field(description="Start of the feature or middle of its line, north.")]

    @property
    def place(self) -> tuple[float, float]:
        """Start of the feature or middle of its line (x, y) [m]."""
        return self.x_m, self.y_m


@dataclass(frozen=True, kw_only=True, config=STRICT)
class _Line(_Placed):
    width_m: Annotated[LengthM, Field(description="Width across the line, at its foot or top.")]
    length_m: Annotated[
        NotNegative, Field(description="Length of the line without the round ends; 0: round.")
    ] = 0.0
    along_deg: Annotated[
        BearingDeg, Field(description="Direction of the line, counter-clockwise from east.")
    ] = 90.0

    @property
    def flank(self) -> float:
        """Half the width [m]."""
        return 0.5 * self.width_m

    def _distance(self, along: FloatArray, across: FloatArray) -> FloatArray:
        """Return the distance [m] from the line, at most the flank."""
        beyond = np.maximum(np.abs(along) - 0.5 * self.length_m, 0.0)
        return np.minimum(np.hypot(beyond, across), self.flank)

    def _cosine(self, height: float, distance: FloatArray) -> FloatArray:
        return 0.5 * height * (1.0 + np.cos(math.pi * distance / self.flank))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Rise(_Placed):
    """A slope between two level parts of the field, with a rounded valley and a rounded crest.

    With u [m] the distance from (x, y) uphill, the slope grows linearly to tan(slope) over the
    rounding, is constant, and falls to 0 over the rounding until u = length. The ground behind it
    is level and tan(slope) (length - rounding) higher. The rise spans the field across its
    direction.
    """

    direction_key: ClassVar[str] = "uphill_deg"
    kind: Literal["rise"] = "rise"
    """Kind of feature."""
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
    def flank(self) -> float:
        """Length of the valley [m]."""
        return self.rounding_m

    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        crest = along - (self.length_m - self.rounding_m)
        return math.tan(self.slope_rad) * (self._ramp(along) - self._ramp(crest))

    def _ramp(self, along: FloatArray) -> FloatArray:
        """Return the integral of a slope that grows from 0 to 1 over the rounding."""
        curve = np.clip(along, 0.0, self.rounding_m)
        return curve**2 / (2.0 * self.rounding_m) + np.maximum(along - self.rounding_m, 0.0)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Furrows(Feature):
    """Ridges and furrows over the whole field: depth/2 cos(2 pi u / period), u across them.

    A ridge runs through the origin of the map.
    """

    height_key: ClassVar[str] = "depth_m"
    kind: Literal["furrows"] = "furrows"
    """Kind of feature."""
    period_m: LengthM
    """Distance from ridge to ridge."""
    depth_m: LengthM
    """Height of a ridge above a furrow."""
    along_deg: BearingDeg = 90.0
    """Direction of the furrows, counter-clockwise from east."""

    @property
    def flank(self) -> float:
        """Distance from furrow to ridge [m]."""
        return 0.5 * self.period_m

    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        return 0.5 * self.depth_m * np.cos(2.0 * math.pi / self.period_m * across)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Bump(_Line):
    """An obstacle along a line, with round ends.

    With d [m] the distance from the line, the height is 0 where d > width/2, elsewhere

        cosine     height/2 (1 + cos(2 pi d / width))
        cylinder   the segment of a circle with chord `width` and sagitta `height`.
    """

    height_key: ClassVar[str] = "height_m"
    kind: Literal["bump"] = "bump"
    """Kind of feature."""
    height_m: LengthM
    """Height on the line."""
    profile: Profile = "cosine"
    """Shape of a section across the line."""

    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        distance = self._distance(along, across)
        if self.profile == "cosine":
            return self._cosine(self.height_m, distance)
        radius = (self.flank**2 + self.height_m**2) / (2.0 * self.height_m)
        return np.sqrt(radius**2 - distance**2) - math.sqrt(radius**2 - self.flank**2)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Ditch(_Line):
    """A trench along a line, with round ends: a cosine bump of negative height."""

    height_key: ClassVar[str] = "depth_m"
    kind: Literal["ditch"] = "ditch"
    """Kind of feature."""
    depth_m: LengthM
    """Depth on the line."""

    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        return self._cosine(-self.depth_m, self._distance(along, across))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Step(_Placed):
    """Ground that is higher behind a line, with a straight ramp; it spans the field."""

    height_key: ClassVar[str] = "height_m"
    direction_key: ClassVar[str] = "uphill_deg"
    kind: Literal["step"] = "step"
    """Kind of feature."""
    height_m: PlaceM
    """Height behind the ramp; negative for a step down."""
    ramp_m: LengthM
    """Length of the ramp."""
    uphill_deg: BearingDeg = 0.0
    """Direction across the step, counter-clockwise from east."""

    @property
    def flank(self) -> float:
        """Length of the ramp [m]."""
        return self.ramp_m

    def _height(self, along: FloatArray, across: FloatArray) -> FloatArray:
        return self.height_m * np.clip(along / self.ramp_m, 0.0, 1.0)


AnyFeature = Annotated[Rise | Furrows | Bump | Ditch | Step, Field(discriminator="kind")]
"""A table with a key `kind`."""
