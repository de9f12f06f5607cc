"""Scenario: the description of a run without its seed and its folder."""

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import tomli_w
from pydantic.dataclasses import dataclass

from ttempc.errors import InvalidTuning
from ttempc.reference.corridor import Corridor

from ...testbed.actuation.actuators import ActuatorSpecification
from ...testbed.configuration.config_io import STRICT, parse_toml, read_toml, validated
from ...testbed.configuration.resources import ShippedFiles
from ...testbed.errors import InvalidPlant
from ...testbed.faults.kinds import AnyFault
from ...testbed.implement.implement import Implement
from ...testbed.recording.provenance import run_id
from ...testbed.sensing.sensor_specification import SensorSpecification, with_preset
from ...testbed.wheels.soil_law import RADIAL, SoilLaw
from ..errors import InvalidScenario
from ..formats.field import FieldSettings
from .controller import ControllerSettings, NoiseSettings, StageSettings
from .ground import SoilSettings, TerrainSettings
from .path import AnyPath, CorridorSettings, FigureEight, FilePath, Mission, StartSettings
from .plant import ControlSettings, PlantSettings
from .vehicle import Vehicles, fill_in, read_vehicles

_SCENARIOS: Final = ShippedFiles(
    "scenario", "proving_ground.experiments", "scenarios", ".toml", InvalidScenario
)


FILE_KEYS: Final = ("file", "height_map", "tube")
"""Last parts of the keys whose value is a file."""
_SHOWN: Final = 300  # characters of a wrong line
_BARE_WORD: Final = re.compile(r"[A-Za-z_./~][\w.:/-]*")
_TOML_WORDS: Final = ("true", "false", "inf", "nan")


@dataclass(frozen=True, config=STRICT)
class Scenario:
    """Field, path, vehicle, actuators, sensors and controller of a run."""

    description: str = ""
    """One sentence for lists of scenarios."""
    path: AnyPath = FigureEight()
    """Reference path and speed."""
    start: StartSettings = StartSettings()
    """Place of the vehicle beside the beginning of its path."""
    corridor: CorridorSettings | None = None
    """Corridor about the path; absent: free ground."""
    field: FieldSettings = FieldSettings()
    """Place of the field on the earth."""
    terrain: TerrainSettings = TerrainSettings()
    """Shape of the ground."""
    soil: SoilSettings = SoilSettings()
    """Strength of the ground."""
    plant: PlantSettings = PlantSettings()
    """Simulated vehicle."""
    implement: Implement | None = None
    """Soil-working implement on the trailer; absent: none."""
    actuators: ActuatorSpecification = ActuatorSpecification()
    """Command path from controller to servos."""
    sensors: SensorSpecification = SensorSpecification()
    """Rates, errors and delays of the sensors."""
    control: ControlSettings = ControlSettings()
    """Rate of the control loop."""
    controller: ControllerSettings = ControllerSettings()
    """Controller, estimator and their model."""
    faults: tuple[AnyFault, ...] = ()
    """Faults of sensors, actuators, plant and ground, each at its time."""
    stages: tuple[StageSettings, ...] = ()
    """Stages of a user in the simulation loop."""

    def mission(self) -> Mission:
        """Return path, speed and gear.

        In a corridor the speed is that at which the tube of the controller fits into it.
        """
        terrain = self.terrain
        if isinstance(self.path, FilePath):
            # the size of a height map is not known before it is read
            size_m = None if terrain.height_map else (terrain.size_x_m, terrain.size_y_m)
            mission = self.path.mission(self.field, self.vehicles().model, size_m)
        else:
            mission = replace(self.path.mission(), frame=self.field.frame())
        mission.check_size(self.control.period_s)
        if (corridor := self.kept_corridor()) and (tube := self.controller.speed_tube()):
            mission = mission.in_corridor(corridor, tube)
            mission.check_size(self.control.period_s)
        return mission

    def kept_corridor(self) -> Corridor | None:
        """Return the corridor that the vehicle is to keep to, None without one."""
        behind = self.implement.behind_m if self.implement else None
        return self.corridor.corridor(behind) if self.corridor else None

    def vehicles(self) -> Vehicles:
        """Return plant and model of the vehicle; reads the vehicle file."""
        return read_vehicles(self.plant.vehicle, self.controller.vehicle)


def shipped() -> list[str]:
    """Return the names of the scenarios that ship with the project."""
    return _SCENARIOS.names()


@dataclass(frozen=True)
class ScenarioFile:
    """Content of a scenario file before validation."""

    file: Path
    content: dict[str, Any]

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.file.stem

    def scenario(
        self, changes: Mapping[str, Any] | None = None, changed_by: str = "changes"
    ) -> Scenario:
        """Return the validated scenario, every absent key filled in and every path absolute.

        `changes` are tables that replace values of the file; messages name `changed_by`.
        """
        content = copy.deepcopy(self.content)
        _drop_unselected(content, changes or {})
        merge_tables(content, changes or {})
        if isinstance(content.get("sensors"), dict):
            content["sensors"] = with_preset(content["sensors"])
        if isinstance(content.get("path"), dict):
            content["path"].setdefault("kind", FigureEight.kind)
        try:
            scenario = validated(Scenario, content, InvalidScenario, self.file.parent)
            scenario.kept_corridor()
            plant = scenario.plant
            controller = scenario.controller
            plant_vehicle, model_vehicle = fill_in(plant.vehicle, controller.vehicle)
            controller = controller.with_defaults()
        except (InvalidScenario, InvalidPlant, InvalidTuning) as error:
            if changes:
                self.scenario()  # raises where the file itself is not valid
                raise InvalidScenario(f"{changed_by}: {error}") from None
            raise InvalidScenario(f"{self.file}: {error}") from None
        return replace(
            scenario,
            plant=replace(plant, vehicle=plant_vehicle),
            controller=replace(
                controller, vehicle=model_vehicle, noise=controller.noise.filled(scenario.sensors)
            ),
        )


def read_scenario(name: str) -> ScenarioFile:
    """Return the content of a scenario file, given a shipped name or the path of a TOML file.

    Raises:
        InvalidScenario: there is no such scenario, or its file is no TOML.
    """
    file = _SCENARIOS.find(name)
    return ScenarioFile(file, read_toml(file, InvalidScenario))


def load(name: str, overrides: Sequence[str] = ()) -> tuple[str, Scenario]:
    """Return name and content of a scenario, given a shipped name or the path of a TOML file.

    `overrides` replace values of the file, see `parse_overrides`.

    Raises:
        InvalidScenario: there is no such scenario, or a key or a value is not allowed.
    """
    source = read_scenario(name)
    return source.name, source.scenario(parse_overrides(overrides), changed_by="--set")


def parse_overrides(lines: Sequence[str]) -> dict[str, Any]:
    """Return lines `key.key=value` as tables.

    Values are TOML; a name or a path needs no quotation marks. A path is relative to the present
    folder, not to that of the scenario.

    Raises:
        InvalidScenario: a line is no TOML.
    """
    changes: dict[str, Any] = {}
    for line in lines:
        merge_tables(changes, _parse_override(line))
    return changes


def dump(scenario: Scenario) -> str:
    """Return the scenario with every default written out, as TOML that `load` reads back.

    Keys without a value are left out, since TOML has no null.
    """
    return tomli_w.dumps(without_none(asdict(scenario)))


def identity(scenario_toml: str, seed: int | str, code: dict[str, str]) -> str:
    """Return the identifier of a run, from the dumped scenario, the seed and the versions."""
    return run_id(f"{scenario_toml}\nseed = {seed}\n", code)


def _parse_override(line: str) -> dict[str, Any]:
    key, _, value = line.partition("=")
    if _BARE_WORD.fullmatch(word := value.strip()) and word not in _TOML_WORDS:
        line = f'{key}="{word}"'
    where = f'--set {line[:_SHOWN]}: must be key.key=value with a TOML value (1.5, "grass")'
    return _from_here(parse_toml(line if "=" in line else "=", InvalidScenario, where))


def _from_here(content: Any) -> Any:  # noqa: ANN401 - any TOML value
    if isinstance(content, list):
        return [_from_here(item) for item in content]
    if not isinstance(content, Mapping):
        return content
    return {
        key: str(Path(value).resolve())
        if key in FILE_KEYS and isinstance(value, str) and Path(value).suffix
        else _from_here(value)
        for key, value in content.items()
    }


def merge_tables(content: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Replace values of nested tables in place by the values of other tables.

    A table with the key of a list holds changes of its tables by their numbers or names, see
    `list_index`.
    """
    for key, value in changes.items():
        below = content.get(key)
        if isinstance(value, Mapping) and isinstance(below, list):
            for entry, table in value.items():
                index = list_index(key, below, entry)
                if isinstance(table, Mapping) and isinstance(below[index], dict):
                    merge_tables(below[index], table)
                else:
                    below[index] = copy.deepcopy(table)
        elif isinstance(value, Mapping) and isinstance(below, dict):
            merge_tables(below, value)
        else:
            content[key] = copy.deepcopy(value)


def list_index(key: str, entries: Sequence[Any], entry: str) -> int:
    """Return the place in a list of tables, or objects, that a part of a dotted key means.

    `entry` is a number from 0, the `name` or, where one alone has it, the `kind` of a table.
    """
    names = [_label(item) for item in entries]
    if entry.isdecimal() and int(entry) < len(entries):
        return int(entry)
    if names.count(entry) != 1:
        raise InvalidScenario(
            f"{key}.{entry}: must be a number below {len(entries)} or the name of one table; "
            f"names here: {', '.join(names) or 'none'}"
        )
    return names.index(entry)


def _label(item: Any) -> str:  # noqa: ANN401 - a table or an object
    keys = ("name", "kind")
    values = [item.get(k) if isinstance(item, Mapping) else getattr(item, k, "") for k in keys]
    return str(values[0] or values[1] or "")


def without_none(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    """Return nested tables without the keys whose value is None."""
    if isinstance(value, Mapping):
        return {key: without_none(item) for key, item in value.items() if item is not None}
    return [without_none(item) for item in value] if isinstance(value, (list, tuple)) else value


# Tables with a key that selects the values of other keys: the table, that key with its default, and
# the other keys, None for all.
_SELECTIONS: Final[Sequence[tuple[tuple[str, ...], str, str, tuple[str, ...] | None]]] = (
    (("path",), "kind", FigureEight.kind, None),
    (("controller",), "name", ControllerSettings().name, ("options",)),
    (("controller", "noise"), "assumed", NoiseSettings().assumed, None),
    (("sensors",), "preset", SensorSpecification().preset, None),
    (("plant", "wheel_law"), "tyre", SoilLaw().tyre, tuple(RADIAL)),
)


def _drop_unselected(content: dict[str, Any], changes: Mapping[str, Any]) -> None:
    """Drop the file's values that belong to another selection than the changes do."""
    for tables, key, default, dependent in _SELECTIONS:
        below = _table(content, tables)
        above = _table(changes, tables)
        if below is None or above is None:
            continue
        selected = below.get(key, default)
        if above.get(key, selected) != selected:
            for name in dependent or tuple(below):
                below.pop(name, None)


def _table(content: Any, names: Sequence[str]) -> Any:  # noqa: ANN401 - any TOML value
    for name in names:
        content = content.get(name) if isinstance(content, Mapping) else None
    return content if isinstance(content, Mapping) else None
