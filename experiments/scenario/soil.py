"""`[soil]`: the strength of the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, Positive
from proving_ground.testbed.ground.soil import Layer, SoilMap
from proving_ground.testbed.ground.soil_layers import Gradient, Patch, RandomField, StrengthMap
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.randomness import generator
from ttempc.reference.path import Path as DrivenPath

from .tramlines import TramlinesSettings

_BACKGROUND_KPA = 600.0  # where the scenario names neither a soil nor a strength


@dataclass(frozen=True, config=STRICT)
class GradientSettings:
    """Strength that changes linearly over a distance; it covers the background."""

    from_kpa: Positive
    to_kpa: Positive
    distance_m: Positive
    x_m: float = 0.0  # where it begins
    y_m: float = 0.0
    towards_deg: float = 0.0  # counter-clockwise from east

    def gradient(self) -> Gradient:
        """Return the layer."""
        towards = math.radians(self.towards_deg)
        return Gradient(self.x_m, self.y_m, towards, self.distance_m, self.from_kpa, self.to_kpa)


@dataclass(frozen=True, config=STRICT)
class StrengthMapSettings:
    """Cone index from a file."""

    file: str  # grid of cone index [kPa] (.npy, .csv, .txt), first row in the south
    spacing_m: Positive
    x_m: float = 0.0  # middle of the map
    y_m: float = 0.0

    def strength_map(self) -> StrengthMap:
        """Return the layer.

        Raises:
            InvalidField: the file is missing or not usable.
        """
        return StrengthMap.from_file(Path(self.file), self.spacing_m, (self.x_m, self.y_m))


@dataclass(frozen=True, config=STRICT)
class RandomSettings:
    """Random strength, log-normal about what lies below it."""

    coefficient_of_variation: Annotated[float, Field(ge=0, le=2)] = 0.3  # assumed
    correlation_m: Positive = 5.0  # assumed


@dataclass(frozen=True, config=STRICT)
class PatchSettings:
    """A round patch of soil of another strength."""

    x_m: float
    y_m: float
    radius_m: Positive
    cone_index_kpa: Positive

    def patch(self) -> Patch:
        """Return the layer."""
        return Patch.circle(self.x_m, self.y_m, self.radius_m, self.cone_index_kpa)


@dataclass(frozen=True, config=STRICT)
class SoilSettings:
    """A named soil or a cone index, and layers over it in the order of the keys below.

    Gradient, map and patches take the place of what lies below them; the random field and the
    tramlines multiply it.
    """

    name: str | None = None  # of a soil in testbed/ground/soil.py
    cone_index_kpa: Positive | None = None
    gradient: GradientSettings | None = None
    map: StrengthMapSettings | None = None
    random: RandomSettings | None = None
    patches: tuple[PatchSettings, ...] = ()
    tramlines: tuple[TramlinesSettings, ...] = ()

    def __post_init__(self) -> None:
        if self.name is not None and self.cone_index_kpa is not None:
            raise ValueError(
                f"got name {self.name!r} and cone_index_kpa {self.cone_index_kpa:g}, "
                "give one of the two"
            )
        if self.name is None and self.cone_index_kpa is None:
            object.__setattr__(self, "cone_index_kpa", _BACKGROUND_KPA)

    def strength_map(self) -> StrengthMap | None:
        """Return the map from the file, if there is one.

        Raises:
            InvalidField: the file is missing or not usable.
        """
        return self.map and self.map.strength_map()

    def soil(
        self, seed: int, terrain: Terrain, path: DrivenPath, strength_map: StrengthMap | None
    ) -> SoilMap:
        """Return the strength of the ground in the run with this seed.

        Raises:
            InvalidField: no soil has that name, or a layer cannot be.
        """
        layers: list[Layer] = []
        if self.gradient:
            layers.append(self.gradient.gradient())
        if strength_map:
            layers.append(strength_map)
        if self.random:
            spread, length = self.random.coefficient_of_variation, self.random.correlation_m
            layers.append(RandomField.drawn(generator(seed, "soil"), terrain, spread, length))
        layers += [settings.patch() for settings in self.patches]
        layers += [settings.tramlines(path) for settings in self.tramlines]
        if self.name is not None:
            return SoilMap.named(self.name, tuple(layers))
        assert self.cone_index_kpa is not None
        return SoilMap(self.cone_index_kpa, tuple(layers))

    def anchored(self, folder: Path) -> SoilSettings:
        """Return these settings with the path of the map made absolute."""
        if not self.map:
            return self
        file = str((folder / self.map.file).resolve())
        return replace(self, map=replace(self.map, file=file))
