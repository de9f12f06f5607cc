"""`[terrain]`: the shape of the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT
from proving_ground.testbed.ground.terrain import Terrain, flat, rough
from proving_ground.testbed.randomness import generator

from .features import FeatureSettings


@dataclass(frozen=True, config=STRICT)
class TerrainSettings:
    """Roughness, slope and features; a height map from a file instead of size and roughness."""

    iso_class: Literal["A", "B", "C", "D", "E", "F", "flat"] = "D"  # ISO 8608, geometric mean
    slope_rad: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    uphill_deg: float = 90.0  # direction in which the slope rises, counter-clockwise from east
    size_x_m: Annotated[float, Field(gt=0, le=400)] = 80.0
    size_y_m: Annotated[float, Field(gt=0, le=400)] = 50.0
    spacing_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    height_map: str = ""  # file of heights [m] (.npy, .csv, .txt), centred on the origin
    features: tuple[FeatureSettings, ...] = ()

    def terrain(self, seed: int) -> Terrain:
        """Return the ground of the run with this seed.

        Raises:
            InvalidField: sizes do not fit, the height map is missing or not usable, or a feature
                cannot be or lies outside the field.
        """
        size, spacing = (self.size_x_m, self.size_y_m), self.spacing_m
        if self.height_map:
            ground = Terrain.from_file(Path(self.height_map), spacing)
        elif self.iso_class == "flat":
            ground = flat(size, spacing)
        else:
            ground = rough(self.iso_class, generator(seed, "terrain"), size, spacing)
        ground = ground.shaped(settings.feature() for settings in self.features)
        return ground.tilted(self.slope_rad, math.radians(self.uphill_deg))

    def anchored(self, folder: Path) -> TerrainSettings:
        """Return these settings with the path of the height map made absolute."""
        if not self.height_map:
            return self
        return replace(self, height_map=str((folder / self.height_map).resolve()))
