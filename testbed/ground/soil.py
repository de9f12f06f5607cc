"""Soil strength: cone index as a function of position."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

from ..errors import InvalidField
from .terrain import Terrain

# Soils by name, cone index [kPa], all assumed: one loam, stronger as it dries, over the range of
# the traction equation. On "moist" the empty tractor slips little, on "wet" it slips and slides.
# Brixius' equation fits down to 225 kPa (Thangavadivelu 1994), so no weaker soil has a name. "hard"
# stands for asphalt or a dry farm road, which no cone penetrates: a finite strength above which the
# law changes little. There the motion resistance is 5 % of the load and the empty vehicle drives
# with 1.9 % slip.
NAMED_SOILS: Final[Mapping[str, float]] = MappingProxyType(
    {"hard": 2000.0, "dry": 1000.0, "moist": 600.0, "wet": 300.0}
)


class Layer(Protocol):
    """A layer that changes the strength of the layers below it."""

    @property
    def finest(self) -> float:
        """Smallest width [m] of its details; a grid must be finer."""
        ...

    def over(self, below: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m] where it was `below` [kPa]; all one shape."""
        ...


@dataclass(frozen=True, slots=True)
class SoilMap:
    """A background of one strength and layers over it, in their order from below.

    Raises:
        InvalidField: the background is not finite and above 0.
    """

    background: float  # cone index [kPa]
    layers: tuple[Layer, ...] = field(default=())

    def __post_init__(self) -> None:
        if not (math.isfinite(self.background) and self.background > 0.0):
            raise InvalidField(
                f"soil: got cone index {self.background} kPa, must be finite and above 0"
            )

    @classmethod
    def named(cls, name: str, layers: tuple[Layer, ...] = ()) -> SoilMap:
        """Return the soil of that name, with layers over it.

        Raises:
            InvalidField: no soil has that name.
        """
        if name not in NAMED_SOILS:
            raise InvalidField(f"soil: got {name!r}, must be one of {', '.join(NAMED_SOILS)}")
        return cls(NAMED_SOILS[name], layers)

    def cone_index(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the cone index [kPa] at (x, y) [m]."""
        east, north = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        strength = np.full(east.shape, self.background)
        for layer in self.layers:
            strength = layer.over(strength, east, north)
        return strength

    def rasterised(self, terrain: Terrain) -> FloatArray:
        """Return the cone index [kPa] at every point of the terrain's grid, (ny, nx).

        Raises:
            InvalidField: a layer has details narrower than the spacing of the grid.
        """
        for layer in self.layers:
            if layer.finest < terrain.spacing_m * (1.0 - 1e-9):
                raise InvalidField(
                    f"soil: got {type(layer).__name__.lower()} {layer.finest:g} m wide, must be "
                    f"as wide as the grid's spacing, {terrain.spacing_m:g} m"
                )
        return self.cone_index(*terrain.points())
