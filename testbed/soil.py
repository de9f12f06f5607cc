"""The strength of the ground: cone index as a function of the place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from testbed.errors import InvalidField
from testbed.terrain import Terrain
from ttempc.types import FloatArray

# Soils by name, cone index [kPa]. "hard" stands for asphalt or a dry farm road, which no cone
# penetrates: a finite strength (assumed) at which more strength would change little. There the
# motion resistance is 5 % of the load and the empty vehicle drives with 1.9 % slip.
NAMED_SOILS: Final[Mapping[str, float]] = MappingProxyType({"hard": 2000.0})


@dataclass(frozen=True, slots=True)
class Patch:
    """An ellipse of other strength.

    Raises:
        InvalidField: a value is not finite, or a radius or the cone index is not above 0.
    """

    x: float  # [m] centre, map frame
    y: float  # [m]
    radius_x: float  # [m] semi-axis along the patch's own x
    radius_y: float  # [m]
    cone_index: float  # [kPa]
    angle: float = 0.0  # [rad] of the patch's own x in the map frame

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.x, self.y, self.angle))):
            raise InvalidField(f"soil patch: got {self}, every value must be finite")
        for name in ("radius_x", "radius_y"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidField(f"soil patch: got {name} {value} m, must be finite and above 0")
        _check_cone_index(self.cone_index)

    @classmethod
    def circle(cls, x: float, y: float, radius: float, cone_index: float) -> Patch:
        """Return a round patch."""
        return cls(x, y, radius, radius, cone_index)

    def covers(self, x: FloatArray, y: FloatArray) -> np.ndarray:
        """Return where (x, y) [m] lies inside the ellipse, boolean, in the shape of x and y."""
        dx, dy = x - self.x, y - self.y
        along = math.cos(self.angle) * dx + math.sin(self.angle) * dy
        across = math.cos(self.angle) * dy - math.sin(self.angle) * dx
        return (along / self.radius_x) ** 2 + (across / self.radius_y) ** 2 <= 1.0


@dataclass(frozen=True, slots=True)
class SoilMap:
    """A background of one strength with patches; where they overlap, the later one holds.

    Raises:
        InvalidField: the background is not finite and above 0.
    """

    background: float  # cone index [kPa]
    patches: tuple[Patch, ...] = field(default=())

    def __post_init__(self) -> None:
        _check_cone_index(self.background)

    @classmethod
    def named(cls, name: str) -> SoilMap:
        """Return the uniform soil of that name.

        Raises:
            InvalidField: no soil has that name.
        """
        if name not in NAMED_SOILS:
            raise InvalidField(f"soil: got {name!r}, must be one of {', '.join(NAMED_SOILS)}")
        return cls(NAMED_SOILS[name])

    def cone_index(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m]."""
        east, north = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        strength = np.full(east.shape, self.background)
        for patch in self.patches:
            strength[patch.covers(east, north)] = patch.cone_index
        return strength

    def rasterised(self, terrain: Terrain) -> FloatArray:
        """Return the cone index [kPa] at every point of the terrain's grid, (ny, nx)."""
        ny, nx = terrain.heights.shape
        x = terrain.origin[0] + terrain.spacing_m * np.arange(nx)
        y = terrain.origin[1] + terrain.spacing_m * np.arange(ny)
        return self.cone_index(x, y[:, None])


def _check_cone_index(value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InvalidField(f"soil: got cone index {value} kPa, must be finite and above 0")
