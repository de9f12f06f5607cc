"""`[soil]`: strength of the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic.dataclasses import dataclass

from ttempc.reference.path import Path as ReferencePath

from ...testbed.configuration.config_io import (
    STRICT,
    DataFile,
    LengthM,
    PlaceM,
    StrengthKpa,
)
from ...testbed.ground.soil import Layer, SoilMap
from ...testbed.ground.soil_layers import (
    Gradient,
    Patch,
    RandomStrength,
    StrengthMap,
)
from ...testbed.ground.terrain import Terrain
from ...testbed.randomness import generator
from .tramlines import AnyTramlines

_DEFAULT_KPA: Final = 600.0  # if the scenario has neither a name nor a cone index


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

    def read(self) -> StrengthMap:
        """Return the soil layer.

        Raises:
            InvalidField: the file is missing or not usable.
        """
        return StrengthMap.from_file(Path(self.file), self.spacing_m, (self.x_m, self.y_m))


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

    def __post_init__(self) -> None:
        if self.name is not None and self.cone_index_kpa is not None:
            raise ValueError(
                f"got name {self.name!r} and cone_index_kpa {self.cone_index_kpa:g}, "
                "give one of the two"
            )
        if self.name is None and self.cone_index_kpa is None:
            object.__setattr__(self, "cone_index_kpa", _DEFAULT_KPA)

    def strength_map(self) -> StrengthMap | None:
        """Return the map from the file, None without a file.

        Raises:
            InvalidField: the file is missing or not usable.
        """
        return self.map and self.map.read()

    def soil(
        self, seed: int, terrain: Terrain, path: ReferencePath, strength_map: StrengthMap | None
    ) -> SoilMap:
        """Return the strength of the ground in the run with this seed.

        Raises:
            InvalidField: there is no soil of that name, or a layer does not fit the terrain.
        """
        layers: list[Layer] = []
        if self.gradient:
            layers.append(self.gradient)
        if strength_map:
            layers.append(strength_map)
        if self.random:
            layers.append(self.random.draw(generator(seed, "soil"), terrain))
        layers += self.patches
        layers += [settings.tramlines(path) for settings in self.tramlines]
        if self.name is not None:
            return SoilMap.named(self.name, tuple(layers))
        assert self.cone_index_kpa is not None
        return SoilMap(self.cone_index_kpa, tuple(layers))
