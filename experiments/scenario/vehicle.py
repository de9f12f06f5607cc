"""Vehicle of plant and model: one vehicle file, and what a scenario changes of it.

`[plant.vehicle]` and `[controller.vehicle]` start from the same vehicle file. A key of a table
replaces the value of the file; `load` of a scenario fills in the absent keys.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, field, replace
from dataclasses import dataclass as stdlib_dataclass
from typing import Annotated, Final, NamedTuple, TypeVar

from pydantic import Field
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
    NotNegative,
    PlaceM,
    Positive,
    SpeedMps,
    validated,
)
from ...testbed.errors import InvalidPlant
from ...testbed.vehicle.vehicle import (
    DEFAULT_VEHICLE,
    Compliance,
    PlantVehicle,
    read_vehicle,
)


class Parameter(NamedTuple):
    """Where a parameter of a scenario stands in a vehicle file and in `ttempc.vehicle.Vehicle`."""

    table: str  # of the vehicle file
    key: str  # key in the table of the scenario file
    field: str = ""  # of `Vehicle`, in SI units and radians; "": the model has none

    def of(self, vehicle: PlantVehicle) -> float:
        """Return the value of a vehicle, in the unit of its file."""
        return getattr(getattr(vehicle, self.table), self.key)


PARAMETERS: Final[Mapping[str, Parameter]] = {
    "wheelbase_m": Parameter("tractor", "wheelbase_m", "wheelbase"),
    "hitch_offset_m": Parameter("hitch", "offset_m", "hitch_offset"),
    "drawbar_m": Parameter("drawbar", "length_m", "drawbar_length"),
    "trailer_m": Parameter("trailer", "length_m", "trailer_length"),
    "tractor_axle_height_m": Parameter("rear_wheel", "radius_m", "axle_height_t"),
    "trailer_axle_height_m": Parameter("trailer_wheel", "radius_m", "axle_height_i"),
    "load_kg": Parameter("load", "mass_kg"),
    "load_height_m": Parameter("load", "height_m"),
    "load_forward_m": Parameter("load", "forward_m"),
    "tractor_compliance_s2pm": Parameter("tractor", "compliance_s2pm", "compliance_t"),
    "trailer_compliance_s2pm": Parameter("trailer", "compliance_s2pm", "compliance_i"),
    "speed_gain_mps": Parameter("hydrostat", "speed_gain_mps", "speed_gain"),
    "speed_time_constant_s": Parameter("hydrostat", "time_constant_s", "speed_time_constant"),
    "hp_rate_per_s": Parameter("hydrostat", "rate_per_s", "hp_rate"),
    "front_limit_deg": Parameter("front_steering", "limit_deg", "steering_limit_t"),
    "front_rate_degps": Parameter("front_steering", "rate_degps", "steering_rate_t"),
    "front_lag_s": Parameter("front_steering", "lag_s", "steering_lag_t"),
    "trailer_limit_deg": Parameter("trailer_steering", "limit_deg", "steering_limit_i"),
    "trailer_rate_degps": Parameter("trailer_steering", "rate_degps", "steering_rate_i"),
    "trailer_lag_s": Parameter("trailer_steering", "lag_s", "steering_lag_i"),
}
"""Every parameter of `[plant.vehicle]` and `[controller.vehicle]` by its key there."""

LENGTH_KEYS: Final[Mapping[str, str]] = {
    PARAMETERS[key].field: key
    for key in ("wheelbase_m", "hitch_offset_m", "drawbar_m", "trailer_m")
}
"""Key of a scenario for each length of `ttempc.vehicle.Vehicle`."""


@dataclass(frozen=True, config=STRICT)
class PlantVehicleSettings:
    """Vehicle file, and parameters of the plant that differ from it; absent: as in the file."""

    file: NameOrFile = DEFAULT_VEHICLE
    """Name of a shipped vehicle, or path of a TOML file relative to the scenario."""
    hitch_offset_m: PlaceM | None = None
    """Hitch point RJ1 behind the rear axle; 0: on it, below 0: before it."""
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

    def plant_vehicle(self, nominal: PlantVehicle) -> PlantVehicle:
        """Return the vehicle of the plant, given the vehicle of the file."""
        content = asdict(nominal)
        for key, value in _given(self).items():
            content[PARAMETERS[key].table][PARAMETERS[key].key] = value
        own_keys = {place[:2]: key for key, place in PARAMETERS.items() if hasattr(self, key)}
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


@dataclass(frozen=True, config=STRICT)
class ModelVehicleSettings:
    """Parameters of the model that controller and estimator use; absent: as in the vehicle file."""

    wheelbase_m: LengthM | None = None
    """Distance from the rear to the front axle."""
    hitch_offset_m: PlaceM | None = None
    """Hitch point RJ1 behind the rear axle; 0: on it, below 0: before it."""
    drawbar_m: LengthM | None = None
    """Distance from RJ1 to the pivot RJ2 of the trailer."""
    trailer_m: LengthM | None = None
    """Distance from RJ2 to the trailer axle."""
    tractor_axle_height_m: NotNegative | None = None
    """Tractor's axle point above the ground about which the tractor rolls, for the IMU's roll."""
    trailer_axle_height_m: NotNegative | None = None
    """The same of the trailer; a tool in the soil makes it 0."""
    tractor_compliance_s2pm: Compliance | None = None
    """Side slip of the rear axle by the lateral acceleration [rad s^2/m]; 0: not known."""
    trailer_compliance_s2pm: Compliance | None = None
    """The same of the trailer axle."""
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
    trailer_limit_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    """Largest trailer steering angle to each side; 0: a plain trailer."""
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
    """Plant and model of one vehicle file; the model's load is always the file's."""

    nominal: PlantVehicle  # as its file says
    plant: PlantVehicle  # with what the scenario changes
    model: Vehicle
    plant_values: Mapping[str, float]  # by the keys of `PARAMETERS`
    model_values: Mapping[str, float]

    @property
    def mismatch(self) -> tuple[ParameterMismatch, ...]:
        """Parameters whose values in plant and model differ."""
        return tuple(
            ParameterMismatch(key, plant, self.model_values[key])
            for key, plant in self.plant_values.items()
            if plant != self.model_values[key]
        )

    @property
    def plant_lengths(self) -> dict[str, float]:
        """Lengths of the plant [m] by their fields of `ttempc.vehicle.Vehicle`."""
        return {name: self.plant_values[key] for name, key in LENGTH_KEYS.items()}


def read_vehicles(plant: PlantVehicleSettings, model: ModelVehicleSettings) -> Vehicles:
    """Return plant and model; the vehicle file is read once.

    Raises:
        InvalidPlant: the file is missing or not understood, or the parts of the plant do not fit
            together.
        InvalidVehicle: the parameters of the model do not fit together.
    """
    nominal = read_vehicle(plant.file)
    vehicle = plant.plant_vehicle(nominal)
    values = _values(nominal) | _given(model)
    fields = {
        item.field: math.radians(values[key]) if "_deg" in key else values[key]
        for key, item in PARAMETERS.items()
        if item.field
    }
    model_vehicle = Vehicle(
        **fields,
        dead_time_t=model.front_dead_time_s,
        dead_time_i=model.trailer_dead_time_s,
        dead_time_hp=model.hydrostat_dead_time_s,
        reverse=False,
    )
    return Vehicles(nominal, vehicle, model_vehicle, _values(vehicle), values)


def fill_in(
    plant: PlantVehicleSettings, model: ModelVehicleSettings
) -> tuple[PlantVehicleSettings, ModelVehicleSettings]:
    """Return both tables with the absent keys filled in from the vehicle file."""
    nominal = read_vehicle(plant.file)
    plant_values = _values(plant.plant_vehicle(nominal))
    return _filled(plant, plant_values), _filled(model, _values(nominal) | _given(model))


_Settings = TypeVar("_Settings", PlantVehicleSettings, ModelVehicleSettings)


def _filled(table: _Settings, values: Mapping[str, float]) -> _Settings:
    return replace(table, **{key: values[key] for key in asdict(table) if key in values})


def _given(table: PlantVehicleSettings | ModelVehicleSettings) -> dict[str, float]:
    given = asdict(table).items()
    return {key: value for key, value in given if key in PARAMETERS and value is not None}


def _values(vehicle: PlantVehicle) -> dict[str, float]:
    return {key: item.of(vehicle) for key, item in PARAMETERS.items()}
