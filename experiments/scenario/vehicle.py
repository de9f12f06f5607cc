"""`[plant.vehicle]` and `[controller.vehicle]`: vehicle parameters of the plant and of the model.

Both start from one vehicle file. A key of a table replaces the value of the file; `load` of a
scenario fills in the absent keys.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, field, replace
from dataclasses import dataclass as stdlib_dataclass
from types import MappingProxyType
from typing import Final, TypeVar

from pydantic.dataclasses import dataclass

from ttempc.vehicle import Vehicle

from ...testbed.actuation.actuators import DeadTime
from ...testbed.configuration.config_io import (
    STRICT,
    AngleDeg,
    DurationS,
    LengthM,
    MassKg,
    NameOrFile,
    PlaceM,
    Positive,
    SpeedMps,
    validated,
)
from ...testbed.errors import InvalidPlant
from ...testbed.vehicle.vehicle import PlantVehicle
from ...testbed.vehicle.vehicle_file import DEFAULT_VEHICLE, find_vehicle, read_vehicle

# Table and key of a vehicle file for each key of a scenario.
_VEHICLE_FILE_KEYS: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
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


LENGTH_KEYS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "wheelbase": "wheelbase_m",
        "hitch_offset": "hitch_offset_m",
        "drawbar_length": "drawbar_m",
        "trailer_length": "trailer_m",
    }
)
"""Key of a scenario for each length of `ttempc.vehicle.Vehicle`."""


@dataclass(frozen=True, config=STRICT)
class PlantVehicleSettings:
    """Vehicle file, and parameters of the plant that differ from it; absent: as in the file."""

    file: NameOrFile = DEFAULT_VEHICLE
    """Name of a shipped vehicle, or path of a TOML file relative to the scenario."""
    hitch_offset_m: LengthM | None = None
    """Distance from the rear axle to the hitch point RJ1."""
    drawbar_m: LengthM | None = None
    """Distance from RJ1 to the pivot RJ2 of the trailer."""
    trailer_m: LengthM | None = None
    """Distance from RJ2 to the trailer axle."""
    load_kg: MassKg | None = None
    """Load of the trailer, without the mass of the trailer."""
    load_height_m: LengthM | None = None
    """Centre of the load above the ground."""
    load_forward_m: PlaceM | None = None
    """Centre of the load ahead of the trailer axle."""
    speed_gain_mps: SpeedMps | None = None
    """Steady speed at hydrostat position 1, K."""
    speed_time_constant_s: DurationS | None = None
    """Time constant of the speed, tau."""
    parts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Other numbers of the plant that differ from the vehicle file, by its tables and keys."""

    def nominal_vehicle(self) -> PlantVehicle:
        """Return the vehicle of the file.

        Raises:
            InvalidPlant: the file is missing or not understood, or its parts do not fit together.
        """
        return read_vehicle(self.file)

    def plant_vehicle(self, nominal: PlantVehicle) -> PlantVehicle:
        """Return the vehicle of the plant, given that of the file.

        Raises:
            InvalidPlant: `parts` has an unknown table or key or one that `[plant.vehicle]` has
                itself, a value is not allowed, or the parts do not fit together.
        """
        content = asdict(nominal)
        for key, value in _given(self).items():
            table, name = _VEHICLE_FILE_KEYS[key]
            content[table][name] = value
        own_keys = {place: key for key, place in _VEHICLE_FILE_KEYS.items() if hasattr(self, key)}
        for table, keys in self.parts.items():
            for name, value in keys.items():
                if (table, name) in own_keys:
                    raise InvalidPlant(
                        f"plant.vehicle.parts.{table}.{name}: give it as "
                        f"plant.vehicle.{own_keys[table, name]}"
                    )
                if not isinstance(content.setdefault(table, {}), dict):
                    raise InvalidPlant(f"plant.vehicle.parts.{table}: not a table of numbers")
                content[table][name] = value
        try:
            return validated(PlantVehicle, content, InvalidPlant)
        except InvalidPlant as error:
            raise InvalidPlant(f"plant.vehicle over {self.file}: {error}") from None

    def file_text(self) -> str:
        """Return the text of the vehicle file."""
        return find_vehicle(self.file).read_text(encoding="utf-8")


@dataclass(frozen=True, config=STRICT)
class ModelVehicleSettings:
    """Parameters of the model that controller and estimator use; absent: as in the vehicle file."""

    wheelbase_m: LengthM | None = None
    """Distance from the rear to the front axle."""
    hitch_offset_m: LengthM | None = None
    """Distance from the rear axle to the hitch point RJ1."""
    drawbar_m: LengthM | None = None
    """Distance from RJ1 to the pivot RJ2 of the trailer."""
    trailer_m: LengthM | None = None
    """Distance from RJ2 to the trailer axle."""
    speed_gain_mps: SpeedMps | None = None
    """Steady speed at hydrostat position 1, K."""
    speed_time_constant_s: DurationS | None = None
    """Time constant of the speed, tau."""
    hp_rate_per_s: DurationS | None = None
    """Rate limit of the hydrostat position."""
    front_limit_deg: AngleDeg | None = None
    """Largest front steering angle to each side."""
    front_rate_degps: Positive | None = None
    """Rate limit of the front steering."""
    front_lag_s: DurationS | None = None
    """Time constant of the front steering."""
    trailer_limit_deg: AngleDeg | None = None
    """Largest trailer steering angle to each side."""
    trailer_rate_degps: Positive | None = None
    """Rate limit of the trailer steering."""
    trailer_lag_s: DurationS | None = None
    """Time constant of the trailer steering."""
    front_dead_time_s: DeadTime = 0.0
    """Time from a command to the first movement of the front steering."""
    trailer_dead_time_s: DeadTime = 0.0
    """The same of the trailer steering."""
    hydrostat_dead_time_s: DeadTime = 0.0
    """The same of the hydrostat."""

    def model_vehicle(self, nominal: PlantVehicle) -> Vehicle:
        """Return the vehicle model, given the vehicle of the file.

        Raises:
            InvalidVehicle: the parameters do not fit together.
        """
        values = _values(nominal) | _given(self)
        return Vehicle(
            wheelbase=values["wheelbase_m"],
            hitch_offset=values["hitch_offset_m"],
            drawbar_length=values["drawbar_m"],
            trailer_length=values["trailer_m"],
            speed_gain=values["speed_gain_mps"],
            speed_time_constant=values["speed_time_constant_s"],
            steering_lag_t=values["front_lag_s"],
            steering_lag_i=values["trailer_lag_s"],
            steering_limit_t=math.radians(values["front_limit_deg"]),
            steering_limit_i=math.radians(values["trailer_limit_deg"]),
            steering_rate_t=math.radians(values["front_rate_degps"]),
            steering_rate_i=math.radians(values["trailer_rate_degps"]),
            hp_rate=values["hp_rate_per_s"],
            dead_time_t=self.front_dead_time_s,
            dead_time_i=self.trailer_dead_time_s,
            dead_time_hp=self.hydrostat_dead_time_s,
        )


def edited_file(text: str, values: Mapping[str, float], note: str) -> str:
    """Return the text of a vehicle file with other `values`, by their keys of a scenario.

    Every changed line ends with the comment `note` in place of its own; all else stays.
    """
    places = {_VEHICLE_FILE_KEYS[key]: value for key, value in values.items()}
    table, lines = "", []
    for line in text.splitlines():
        head = line.split("#")[0].strip()
        if head.startswith("["):
            table = head.strip("[] ")
        value = places.get((table, head.partition("=")[0].strip()))
        lines.append(line if value is None else f"{head.split('=')[0]}= {value:.4f}  # {note}")
    return "\n".join(lines) + "\n"


@stdlib_dataclass(frozen=True, slots=True)
class ParameterMismatch:
    """A parameter whose values in plant and model differ."""

    key: str  # of the scenario, with its unit
    plant: float
    model: float

    def __str__(self) -> str:
        return f"{self.key} {self.model:g} (true {self.plant:g})"


@stdlib_dataclass(frozen=True, slots=True)
class Vehicles:
    """Plant and model of one vehicle file."""

    plant: PlantVehicle
    model: Vehicle
    mismatch: tuple[ParameterMismatch, ...]

    def plant_lengths(self) -> dict[str, float]:
        """Return the lengths of the plant [m] by their fields of `ttempc.vehicle.Vehicle`."""
        values = _values(self.plant)
        return {name: values[key] for name, key in LENGTH_KEYS.items()}


def read_vehicles(plant: PlantVehicleSettings, model: ModelVehicleSettings) -> Vehicles:
    """Return plant and model; the vehicle file is read once.

    The model has no load. A load of the plant that differs from that of the file counts as a
    mismatch.

    Raises:
        InvalidPlant: the file is missing or not understood, or the parts of the plant do not fit
            together.
        InvalidVehicle: the parameters of the model do not fit together.
    """
    nominal = plant.nominal_vehicle()
    vehicle = plant.plant_vehicle(nominal)
    plant_values, model_values = _values(vehicle), _values(nominal) | _given(model)
    mismatch = tuple(
        ParameterMismatch(key, plant_values[key], model_values[key])
        for key in _VEHICLE_FILE_KEYS
        if plant_values[key] != model_values[key]
    )
    return Vehicles(vehicle, model.model_vehicle(nominal), mismatch)


def fill_in(
    plant: PlantVehicleSettings, model: ModelVehicleSettings
) -> tuple[PlantVehicleSettings, ModelVehicleSettings]:
    """Return both tables with the absent keys filled in from the vehicle file.

    Raises:
        InvalidPlant: the file is missing or not understood, or the parts of the plant do not fit
            together.
    """
    nominal = plant.nominal_vehicle()
    plant_values = _values(plant.plant_vehicle(nominal))
    model_values = _values(nominal) | _given(model)
    return _filled(plant, plant_values), _filled(model, model_values)


_Settings = TypeVar("_Settings", PlantVehicleSettings, ModelVehicleSettings)


def _filled(table: _Settings, values: Mapping[str, float]) -> _Settings:
    return replace(table, **{key: values[key] for key in asdict(table) if key in values})


def _given(table: PlantVehicleSettings | ModelVehicleSettings) -> dict[str, float]:
    """Return the parameters that a table gives."""
    return {
        key: value
        for key, value in asdict(table).items()
        if key in _VEHICLE_FILE_KEYS and value is not None
    }


def _values(vehicle: PlantVehicle) -> dict[str, float]:
    """Return the parameters of a vehicle under their keys of a scenario."""
    return {
        key: getattr(getattr(vehicle, table), name)
        for key, (table, name) in _VEHICLE_FILE_KEYS.items()
    }
