"""`[terrain]` and `[soil]`: shape and strength of the ground."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.reference.path import Path as ReferencePath

from ...testbed.configuration.config_io import (
    STRICT,
    BearingDeg,
    DataFile,
    LengthM,
    PlaceM,
    StrengthKpa,
)
from ...testbed.ground.features import AnyFeature
from ...testbed.ground.soil import (
    Gradient,
    Layer,
    Patch,
    RandomStrength,
    SoilMap,
    StrengthMap,
    Tracks,
    Tramlines,
)
from ...testbed.ground.terrain import (
    DEFAULT_SHORTEST_WAVE_M,
    LEAST_SHORTEST_WAVE_M,
    Terrain,
    flat,
    rough,
)
from ...testbed.randomness import generator

_DEFAULT_KPA: Final = 600.0  # if the scenario has neither a name nor a cone index
# The trailer starts behind the beginning of the path, and the vehicle stops behind its end.
_BEYOND_PATH_M: Final = 5.0
_PATH_STEP_M: Final = 0.2


@dataclass(frozen=True, config=STRICT)
class TerrainSettings:
    """Roughness, slope and features; a height map replaces size and roughness."""

    iso_class: Literal["A", "B", "C", "D", "E", "F", "flat"] = "D"
    """Roughness class of ISO 8608, geometric mean."""
    shortest_wave_m: Annotated[float, Field(ge=LEAST_SHORTEST_WAVE_M, le=2.0)] = (
        DEFAULT_SHORTEST_WAVE_M
    )
    """Shortest wave of the roughness, at least twice `spacing_m`. Waves below the default shake the
    vehicle and its IMUs, and take a finer grid."""
    slope_rad: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    """Slope of the whole field."""
    uphill_deg: BearingDeg = 90.0
    """Direction in which the slope rises, counter-clockwise from east."""
    size_x_m: Annotated[float, Field(gt=0, le=1000)] = 80.0
    """Extent of the field from west to east."""
    size_y_m: Annotated[float, Field(gt=0, le=1000)] = 50.0
    """Extent of the field from south to north."""
    spacing_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    """Distance between neighbouring points of the grid."""
    height_map: DataFile = ""
    """File of heights [m] (.npy, .csv, .txt), centred on the origin; empty: no file."""
    features: tuple[AnyFeature, ...] = ()
    """Rises, furrows, bumps, ditches and steps."""

    def terrain(self, seed: int) -> Terrain:
        """Return the ground of the run with this seed."""
        size = (self.size_x_m, self.size_y_m)
        spacing = self.spacing_m
        if self.height_map:
            ground = Terrain.from_file(Path(self.height_map), spacing)
        elif self.iso_class == "flat":
            ground = flat(size, spacing)
        else:
            ground = rough(
                self.iso_class,
                generator(seed, "terrain"),
                size,
                spacing,
                shortest_wave_m=self.shortest_wave_m,
            )
        return ground.shaped(self.features).tilted(self.slope_rad, math.radians(self.uphill_deg))


@dataclass(frozen=True, kw_only=True, config=STRICT)
class PathTramlines(Tracks):
    """Tracks of an earlier pass along the reference path."""

    kind: Literal["path"] = "path"
    """Kind of tramlines."""

    def tramlines(self, path: ReferencePath) -> Tramlines:
        """Return the soil layer."""
        along = np.arange(-_BEYOND_PATH_M, path.lap_m + _BEYOND_PATH_M, _PATH_STEP_M)
        return Tramlines((path.pose(along)[:, :2],), self)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LineTramlines(Tracks):
    """Tracks of a pass along a line through given points."""

    kind: Literal["line"] = "line"
    """Kind of tramlines."""
    points_m: tuple[tuple[PlaceM, PlaceM], ...]
    """Points (x, y), map frame."""

    def tramlines(self, path: ReferencePath) -> Tramlines:
        """Return the soil layer; it does not depend on the path."""
        return Tramlines((np.array(self.points_m),), self)


AnyTramlines = Annotated[PathTramlines | LineTramlines, Field(discriminator="kind")]
"""A table with a key `kind`."""


@dataclass(frozen=True, config=STRICT)
class StrengthMapFile:
    """Cone index from a file."""

    file: DataFile
    """Grid of cone index [kPa] (.npy, .csv, .txt), first row in the south."""
    spacing_m: LengthM
    """Distance between neighbouring points."""
    x_m: PlaceM = 0.0
    """Middle of the grid, map frame."""
    y_m: PlaceM = 0.0
    """Middle of the grid, map frame."""


@dataclass(frozen=True, config=STRICT)
class SoilSettings:
    """A named soil or a cone index, and layers on it in the order of the keys.

    Gradient, map and patches replace the layers below them; the random field and the tramlines
    multiply the strength of the layers below them.
    """

    name: str | None = None
    """Name of a soil in testbed/ground/soil.py."""
    cone_index_kpa: StrengthKpa | None = None
    """Cone index of the background; 600 if there is neither a name nor a cone index."""
    gradient: Gradient | None = None
    """Linear change of strength."""
    map: StrengthMapFile | None = None
    """Measured strength."""
    random: RandomStrength | None = None
    """Random strength."""
    patches: tuple[Patch, ...] = ()
    """Round patches of another strength."""
    tramlines: tuple[AnyTramlines, ...] = ()
    """Wheel tracks of earlier passes."""
    ruts: bool = False
    """Whether wheels press the ground, for themselves and for those that follow."""

    def __post_init__(self) -> None:
        if self.name is not None and self.cone_index_kpa is not None:
            raise ValueError(
                f"got name {self.name!r} and cone_index_kpa {self.cone_index_kpa:g}, "
                "give one of the two"
            )
        if self.name is None and self.cone_index_kpa is None:
            object.__setattr__(self, "cone_index_kpa", _DEFAULT_KPA)

    def strength_map(self) -> StrengthMap | None:
        """Return the map from the file, None without a file."""
        if (map := self.map) is None:
            return None
        return StrengthMap.from_file(Path(map.file), map.spacing_m, (map.x_m, map.y_m))

    def soil(
        self, seed: int, terrain: Terrain, path: ReferencePath, strength_map: StrengthMap | None
    ) -> SoilMap:
        """Return the strength of the ground in the run with this seed."""
        random = self.random and self.random.draw(generator(seed, "soil"), terrain)
        layers: list[Layer] = [
            *(layer for layer in (self.gradient, strength_map, random) if layer is not None),
            *self.patches,
            *(settings.tramlines(path) for settings in self.tramlines),
        ]
        if self.name is not None:
            return replace(SoilMap.named(self.name, tuple(layers)), ruts=self.ruts)
        assert self.cone_index_kpa is not None
        return SoilMap(self.cone_index_kpa, tuple(layers), self.ruts)
