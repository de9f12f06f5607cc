"""`[plant.vehicle]` and `[controller.vehicle]`: what the vehicle is, and what is believed of it.

Both start from one vehicle file. A key that is absent is as in the file; a key that is given
differs on purpose. `load` of a scenario fills all of them in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, AngleDeg, NotNegative, Positive
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.vehicle.vehicle import PlantVehicle
from proving_ground.testbed.vehicle.vehicle_file import DEFAULT_VEHICLE, find_vehicle, read_vehicle
from ttempc.vehicle import Vehicle

# Where the keys of a scenario stand in a vehicle file.
_PLACES: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "wheelbase_m": ("tractor", "wheelbase_m"),
        "hitch_offset_m": ("hitch", "offset_m"),
        "drawbar_m": ("drawbar", "length_m"),
        "trailer_m": ("trailer", "length_m"),
        "load_kg": ("load", "mass_kg"),
        "load_height_m": ("load", "height_m"),
        "load_forward_m": ("load", "forward_m"),
        "speed_gain_mps": ("hydrostat", "speed_gain_mps"),
        "speed_time_constant_s": ("hydrostat", "time_constant_s"),
        "hp_rate_per_s": ("hydrostat", "rate_per_s"),
        "front_limit_deg": ("front_steering", "limit_deg"),
        "front_rate_degps": ("front_steering", "rate_degps"),
        "front_lag_s": ("front_steering", "lag_s"),
        "trailer_limit_deg": ("trailer_steering", "limit_deg"),
        "trailer_rate_degps": ("trailer_steering", "rate_degps"),
        "trailer_lag_s": ("trailer_steering", "lag_s"),
    }
)


@dataclass(frozen=True, config=STRICT)
class TrueVehicle:
    """What the vehicle really is: a file, and where it differs from that."""

    file: str = DEFAULT_VEHICLE  # a shipped vehicle, or a path relative to the scenario
    hitch_offset_m: Positive | None = None  # rear axle to RJ1
    drawbar_m: Positive | None = None  # RJ1 to RJ2
    trailer_m: Positive | None = None  # RJ2 to trailer axle
    load_kg: NotNegative | None = None  # in the trailer, on top of its own mass
    load_height_m: Positive | None = None  # centre of the load above the trailer axle
    load_forward_m: float | None = None  # centre of the load ahead of the trailer axle
    speed_gain_mps: Positive | None = None  # K
    speed_time_constant_s: Positive | None = None  # tau

    def filed(self) -> PlantVehicle:
        """Return the vehicle as its file has it.

        Raises:
            InvalidPlant: the file is missing, not understood, or tells of no possible vehicle.
        """
        return read_vehicle(self.file)

    def vehicle(self) -> PlantVehicle:
        """Return the vehicle as it really is.

        Raises:
            InvalidPlant: as `filed`, or what differs from the file makes it impossible.
        """
        filed = self.filed()
        changes: dict[str, dict[str, float]] = {}
        for key, value in _given(self).items():
            table, name = _PLACES[key]
            changes.setdefault(table, {})[name] = value
        try:
            return replace(
                filed,
                **{name: replace(getattr(filed, name), **keys) for name, keys in changes.items()},
            )
        except InvalidPlant as error:
            raise InvalidPlant(f"plant.vehicle over {self.file}: {error}") from None

    def resolved(self) -> TrueVehicle:
        """Return the same with every key filled in."""
        return TrueVehicle(self.file, **_numbers(self, self.vehicle()))

    def anchored(self, folder: Path) -> TrueVehicle:
        """Return the same with the path of its file made absolute from `folder`."""
        if not self.file.endswith(".toml"):
            return self
        return replace(self, file=str((folder / self.file).resolve()))

    def text(self) -> str:
        """Return what the file says, to be kept with a run."""
        return find_vehicle(self.file).read_text(encoding="utf-8")


@dataclass(frozen=True, config=STRICT)
class BelievedVehicle:
    """What the controller and its estimator believe, where that differs from the vehicle file."""

    wheelbase_m: Positive | None = None
    hitch_offset_m: Positive | None = None
    drawbar_m: Positive | None = None
    trailer_m: Positive | None = None
    speed_gain_mps: Positive | None = None
    speed_time_constant_s: Positive | None = None
    hp_rate_per_s: Positive | None = None
    front_limit_deg: AngleDeg | None = None
    front_rate_degps: Positive | None = None
    front_lag_s: Positive | None = None
    trailer_limit_deg: AngleDeg | None = None
    trailer_rate_degps: Positive | None = None
    trailer_lag_s: Positive | None = None

    def resolved(self, filed: PlantVehicle) -> BelievedVehicle:
        """Return the same with every key filled in from the vehicle file."""
        return BelievedVehicle(**_numbers(self, filed))

    def vehicle(self, filed: PlantVehicle) -> Vehicle:
        """Return the vehicle as the control side knows it.

        Raises:
            InvalidVehicle: it cannot be.
        """
        known = _numbers(self, filed)
        return Vehicle(
            wheelbase=known["wheelbase_m"],
            hitch_offset=known["hitch_offset_m"],
            drawbar_length=known["drawbar_m"],
            trailer_length=known["trailer_m"],
            speed_gain=known["speed_gain_mps"],
            speed_time_constant=known["speed_time_constant_s"],
            steering_lag_t=known["front_lag_s"],
            steering_lag_i=known["trailer_lag_s"],
            steering_limit_t=math.radians(known["front_limit_deg"]),
            steering_limit_i=math.radians(known["trailer_limit_deg"]),
            steering_rate_t=math.radians(known["front_rate_degps"]),
            steering_rate_i=math.radians(known["trailer_rate_degps"]),
            hp_rate=known["hp_rate_per_s"],
        )


@dataclass(frozen=True)
class Difference:
    """A value that is not what the controller believes, or was told, it to be."""

    key: str  # with its unit
    true: float
    believed: float

    def __str__(self) -> str:
        return f"{self.key} {self.believed:g} (true {self.true:g})"


def mismatch(true: TrueVehicle, believed: BelievedVehicle) -> tuple[Difference, ...]:
    """Return where truth and belief differ; of the load the vehicle file is what is believed."""
    filed, really = true.filed(), true.vehicle()
    known = _numbers(TrueVehicle(), filed) | _numbers(believed, filed)
    actual = _numbers(TrueVehicle(), really) | _numbers(BelievedVehicle(), really)
    return tuple(
        Difference(key, actual[key], known[key]) for key in _PLACES if actual[key] != known[key]
    )


def _given(table: TrueVehicle | BelievedVehicle) -> dict[str, float]:
    return {
        key: value for key, value in asdict(table).items() if key in _PLACES and value is not None
    }


def _numbers(table: TrueVehicle | BelievedVehicle, filed: PlantVehicle) -> dict[str, float]:
    """Return every number of a table: those that are given, and those of the file for the rest."""
    keys = [key for key in asdict(table) if key in _PLACES]
    return {
        key: getattr(getattr(filed, _PLACES[key][0]), _PLACES[key][1]) for key in keys
    } | _given(table)
