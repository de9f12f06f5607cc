"""`[terrain]`: shape of the ground."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT, BearingDeg, DataFile
from ...testbed.ground.features import AnyFeature
from ...testbed.ground.terrain import Terrain, flat, rough
from ...testbed.randomness import generator


@dataclass(frozen=True, config=STRICT)
class TerrainSettings:
    """Roughness, slope and features; a height map replaces size and roughness."""

    iso_class: Literal["A", "B", "C", "D", "E", "F", "flat"] = "D"
    """Roughness class of ISO 8608, geometric mean."""
    slope_rad: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    """Slope of the whole field."""
    uphill_deg: BearingDeg = 90.0
    """Direction in which the slope rises, counter-clockwise from east."""
    size_x_m: Annotated[float, Field(gt=0, le=400)] = 80.0
    """Extent of the field from west to east."""
    size_y_m: Annotated[float, Field(gt=0, le=400)] = 50.0
    """Extent of the field from south to north."""
    spacing_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    """Distance between neighbouring points of the grid."""
    height_map: DataFile = ""
    """File of heights [m] (.npy, .csv, .txt), centred on the origin; empty: no file."""
    features: tuple[AnyFeature, ...] = ()
    """Rises, furrows, bumps, ditches and steps."""

    def terrain(self, seed: int) -> Terrain:
        """Return the ground of the run with this seed.

        Raises:
            InvalidField: the sizes do not fit, the height map is missing or not usable, or a
                feature lies outside the field or is too fine for the grid.
        """
        size, spacing = (self.size_x_m, self.size_y_m), self.spacing_m
        if self.height_map:
            ground = Terrain.from_file(Path(self.height_map), spacing)
        elif self.iso_class == "flat":
            ground = flat(size, spacing)
        else:
            ground = rough(self.iso_class, generator(seed, "terrain"), size, spacing)
        return ground.shaped(self.features).tilted(self.slope_rad, math.radians(self.uphill_deg))
