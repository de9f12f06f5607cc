"""What lies on the ground on top of its roughness: rises, furrows, ditches and bumps, steps.

A feature is a height [m] as a function of the place, in closed form, positioned in the map frame;
directions are counter-clockwise from x (east). `Terrain.shaped` adds it to a grid and refuses what
that grid cannot hold. Every flank is at most as high as it is long, 45 degrees on average: the
look-ups under a wheel (`testbed.wheels.tyre`) know no wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

from ..errors import InvalidField

Profile = Literal["cosine", "cylinder"]

STEEPEST_RISE_RAD = 0.6  # that of a tilted field


class Feature(Protocol):
    """A height that is added to the ground."""

    what: ClassVar[str]  # the noun that starts a refusal

    @property
    def place(self) -> tuple[float, float] | None:
        """(x, y) [m] that must lie on the field; None where it is everywhere."""
        ...

    @property
    def flank(self) -> float:
        """Shortest distance [m] over which it climbs as far as it does."""
        ...

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return what is added to the ground [m] at (x, y) [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Rise:
    """A slope that changes: level ground turns into a slope in a valley, and level in a crest.

    With u [m] from (x, y) uphill, the slope grows linearly to tan(slope) over `rounding`, stays,
    and fades over `rounding` until u = `length`; beyond, the ground is level again and
    tan(slope) (length - rounding) higher. It spans the field across its direction.

    Raises:
        InvalidField: a value is not finite or out of its range.
    """

    what: ClassVar[str] = "rise"

    x: float  # [m] where it begins
    y: float  # [m]
    uphill: float  # [rad]
    slope: float  # [rad] at its steepest; below 0 it falls
    length: float  # [m] from level to level
    rounding: float  # [m] of valley and of crest

    def __post_init__(self) -> None:
        _check(self, "length", "rounding")
        if not abs(self.slope) <= STEEPEST_RISE_RAD:
            raise InvalidField(
                f"rise: got slope {self.slope} rad, must be in "
                f"[-{STEEPEST_RISE_RAD}, {STEEPEST_RISE_RAD}]"
            )
        if 2.0 * self.rounding > self.length:
            raise InvalidField(
                f"rise: got rounding {self.rounding} m, must be at most half the length, "
                f"{0.5 * self.length} m"
            )

    @property
    def place(self) -> tuple[float, float]:
        """Where it begins."""
        return self.x, self.y

    @property
    def flank(self) -> float:
        """The shorter of its curves."""
        return self.rounding

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return what is added to the ground [m] at (x, y) [m]."""
        along, _ = _turned(self.x, self.y, self.uphill, x, y)
        crest = along - (self.length - self.rounding)
        return math.tan(self.slope) * (self._bent(along) - self._bent(crest))

    def _bent(self, along: FloatArray) -> FloatArray:
        """Return the integral of a slope that grows from 0 to 1 over the rounding."""
        curve = np.clip(along, 0.0, self.rounding)
        return curve**2 / (2.0 * self.rounding) + np.maximum(along - self.rounding, 0.0)


@dataclass(frozen=True, slots=True)
class Furrows:
    """Ridges and furrows all over the field, depth/2 cos(2 pi u / period), u across them.

    Raises:
        InvalidField: a value is not finite or out of its range.
    """

    what: ClassVar[str] = "furrows"

    period: float  # [m] from ridge to ridge
    depth: float  # [m] from ridge to furrow
    direction: float  # [rad] in which they run; a ridge runs through the origin

    def __post_init__(self) -> None:
        _check(self, "period", "depth")
        _check_steepness(self.what, "depth", self.depth, self.flank)

    @property
    def place(self) -> None:
        """They are everywhere."""
        return

    @property
    def flank(self) -> float:
        """From furrow to ridge."""
        return 0.5 * self.period

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return what is added to the ground [m] at (x, y) [m]."""
        _, across = _turned(0.0, 0.0, self.direction, x, y)
        return 0.5 * self.depth * np.cos(2.0 * math.pi / self.period * across)


@dataclass(frozen=True, slots=True)
class Bump:
    """A single obstacle, or with a negative height a ditch: a profile along a line, round ends.

    With d the distance from the line, 0 where d > width/2, else

        cosine     height/2 (1 + cos(2 pi d / width))
        cylinder   the segment of a circle with chord `width` and sagitta `height`.

    Raises:
        InvalidField: a value is not finite or out of its range.
    """

    what: ClassVar[str] = "bump"

    x: float  # [m] middle
    y: float  # [m]
    direction: float  # [rad] in which the line runs
    length: float  # [m] of the line without its ends; 0 makes it round
    width: float  # [m] across the line
    rise: float  # [m] in the middle; below 0 a ditch
    profile: Profile = "cosine"

    def __post_init__(self) -> None:
        _check(self, "width")
        if self.length < 0.0:
            raise InvalidField(f"bump: got length {self.length} m, must not be negative")
        if self.profile not in get_args(Profile):
            raise InvalidField(f"bump: got profile {self.profile!r}, must be cosine or cylinder")
        _check_steepness(self.what, "rise", self.rise, self.flank)

    @property
    def place(self) -> tuple[float, float]:
        """Its middle."""
        return self.x, self.y

    @property
    def flank(self) -> float:
        """From its edge to its middle."""
        return 0.5 * self.width

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return what is added to the ground [m] at (x, y) [m]."""
        along, across = _turned(self.x, self.y, self.direction, x, y)
        beyond = np.maximum(np.abs(along) - 0.5 * self.length, 0.0)
        distance = np.minimum(np.hypot(beyond, across), self.flank)  # from the line
        if self.profile == "cosine" or self.rise == 0.0:
            return 0.5 * self.rise * (1.0 + np.cos(math.pi * distance / self.flank))
        rise = abs(self.rise)
        radius = (self.flank**2 + rise**2) / (2.0 * rise)
        return math.copysign(1.0, self.rise) * (
            np.sqrt(radius**2 - distance**2) - math.sqrt(radius**2 - self.flank**2)
        )


@dataclass(frozen=True, slots=True)
class Step:
    """Ground that is higher beyond a line, by way of a straight ramp; it spans the field.

    Raises:
        InvalidField: a value is not finite or out of its range.
    """

    what: ClassVar[str] = "step"

    x: float  # [m] where the ramp begins
    y: float  # [m]
    uphill: float  # [rad]
    rise: float  # [m]; below 0 it goes down
    ramp: float  # [m] over which it rises

    def __post_init__(self) -> None:
        _check(self, "ramp")
        _check_steepness(self.what, "rise", self.rise, self.ramp)

    @property
    def place(self) -> tuple[float, float]:
        """Where the ramp begins."""
        return self.x, self.y

    @property
    def flank(self) -> float:
        """The ramp."""
        return self.ramp

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return what is added to the ground [m] at (x, y) [m]."""
        along, _ = _turned(self.x, self.y, self.uphill, x, y)
        return self.rise * np.clip(along / self.ramp, 0.0, 1.0)


def _turned(
    x0: float, y0: float, direction: float, x: ArrayLike, y: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return (x, y) [m] in a frame at (x0, y0) turned by `direction`: along and across it."""
    dx, dy = np.asarray(x) - x0, np.asarray(y) - y0
    cosine, sine = math.cos(direction), math.sin(direction)
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _check(feature: Rise | Furrows | Bump | Step, *positive: str) -> None:
    """Refuse what is not finite, and what of the named values is not above 0."""
    for item in fields(feature):
        value = getattr(feature, item.name)
        if isinstance(value, str):
            continue
        if not math.isfinite(value):
            raise InvalidField(f"{feature.what}: got {item.name} {value}, must be finite")
        if item.name in positive and value <= 0.0:
            raise InvalidField(f"{feature.what}: got {item.name} {value} m, must be above 0")


def _check_steepness(what: str, name: str, height: float, flank: float) -> None:
    if abs(height) > flank:
        raise InvalidField(
            f"{what}: got {name} {height} m over a flank of {flank} m, must be at most as much"
        )
