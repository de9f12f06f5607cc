"""`[terrain]` and `[soil]`: the shape and the strength of the ground."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from experiments.settings.base import STRICT, Positive
from testbed.randomness import generator
from testbed.soil import SoilMap
from testbed.soil_layers import Patch
from testbed.terrain import Terrain, flat, rough


@dataclass(frozen=True, config=STRICT)
class TerrainSettings:
    """Roughness and slope of the ground, or a height map from a file instead of the roughness."""

    iso_class: Literal["A", "B", "C", "D", "E", "F", "flat"] = "D"  # ISO 8608, geometric mean
    slope_rad: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    uphill_deg: float = 90.0  # direction in which the slope rises, counter-clockwise from east
    size_x_m: Annotated[float, Field(gt=0, le=400)] = 80.0
    size_y_m: Annotated[float, Field(gt=0, le=400)] = 50.0
    spacing_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    height_map: str = ""  # file of heights [m] (.npy, .csv, .txt), centred on the origin

    def terrain(self, seed: int) -> Terrain:
        """Return the ground of the run with this seed.

        Raises:
            InvalidField: sizes do not fit, or the height map is missing or not usable.
        """
        size, spacing = (self.size_x_m, self.size_y_m), self.spacing_m
        if self.height_map:
            ground = Terrain.from_file(Path(self.height_map), spacing)
        elif self.iso_class == "flat":
            ground = flat(size, spacing)
        else:
            ground = rough(self.iso_class, generator(seed, "terrain"), size, spacing)
        return ground.tilted(self.slope_rad, math.radians(self.uphill_deg))


@dataclass(frozen=True, config=STRICT)
class PatchSettings:
    """A round patch of soil of another strength."""

    x_m: float
    y_m: float
    radius_m: Positive
    cone_index_kpa: Positive


@dataclass(frozen=True, config=STRICT)
class SoilSettings:
    """Cone index of the soil, with patches laid over it; a later patch covers an earlier one."""

    cone_index_kpa: Positive = 600.0
    patches: tuple[PatchSettings, ...] = ()

    def soil(self) -> SoilMap:
        """Return the strength of the ground as a function of the place."""
        return SoilMap(
            self.cone_index_kpa,
            tuple(
                Patch.circle(patch.x_m, patch.y_m, patch.radius_m, patch.cone_index_kpa)
                for patch in self.patches
            ),
        )
