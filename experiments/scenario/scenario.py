"""A scenario: everything that describes a run except its seed and its folder."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import tomli_w
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, read_toml, validated
from proving_ground.testbed.configuration.resources import Shelf
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.recording.provenance import run_id

from ..errors import InvalidScenario
from .actuators import ActuatorSettings
from .controller import ControllerSettings
from .path import FigureEight, PathSettings
from .plant import PlantSettings
from .sensors import SensorSettings
from .soil import SoilSettings
from .terrain import TerrainSettings

_SCENARIOS: Final = Shelf(
    "scenario", "proving_ground.experiments", "scenarios", ".toml", InvalidScenario
)


@dataclass(frozen=True, config=STRICT)
class Scenario:
    """A field, a path over it, the vehicle, its actuators, its sensors and its driver."""

    description: str = ""
    path: PathSettings = FigureEight()
    terrain: TerrainSettings = TerrainSettings()
    soil: SoilSettings = SoilSettings()
    plant: PlantSettings = PlantSettings()
    actuators: ActuatorSettings = ActuatorSettings()
    sensors: SensorSettings = SensorSettings()
    controller: ControllerSettings = ControllerSettings()


def shipped() -> list[str]:
    """Return the names of the scenarios that ship with the project."""
    return _SCENARIOS.names()


@dataclass(frozen=True)
class Draft:
    """The file of a scenario, read but not yet checked."""

    file: Path
    content: dict[str, Any]

    @property
    def name(self) -> str:
        """Return the name of the scenario."""
        return self.file.stem

    def scenario(self, changes: Mapping[str, Any] | None = None) -> Scenario:
        """Return the scenario, checked and with every absent key filled in.

        Args:
            changes: tables laid over the content of the file.

        Raises:
            InvalidScenario: it says something impossible.
        """
        content = copy.deepcopy(self.content)
        merge(content, changes or {})
        if isinstance(content.get("path"), dict):
            content["path"].setdefault("kind", FigureEight.kind)
        try:
            scenario = validated(Scenario, content, InvalidScenario)
            return _resolved(_anchored(scenario, self.file.parent))
        except (InvalidScenario, InvalidPlant) as error:
            raise InvalidScenario(f"{self.file}: {error}") from None


def read(name: str) -> Draft:
    """Return what stands in the file of a scenario.

    Args:
        name: a shipped scenario, or the path of a TOML file.

    Raises:
        InvalidScenario: no such scenario, or its file is no TOML.
    """
    file = _SCENARIOS.find(name)
    return Draft(file, read_toml(file, InvalidScenario))


def load(name: str, overrides: Sequence[str] = ()) -> tuple[str, Scenario]:
    """Return name and content of a scenario.

    Args:
        name: a shipped scenario, or the path of a TOML file.
        overrides: lines `key.key=value`, the value as in TOML, laid over the file.

    Raises:
        InvalidScenario: no such scenario, or one that says something impossible.
    """
    draft = read(name)
    return draft.name, draft.scenario(overridden(overrides))


def overridden(lines: Sequence[str]) -> dict[str, Any]:
    """Return lines `key.key=value` as tables to lay over a scenario.

    Raises:
        InvalidScenario: a line is no TOML.
    """
    changes: dict[str, Any] = {}
    for line in lines:
        merge(changes, _parsed(line))
    return changes


def dump(scenario: Scenario) -> str:
    """Return the scenario with every default written out, as TOML that `load` reads back.

    Of the vehicle, what is not given is left out: TOML has no word for it, and `load` fills it in.
    """
    return tomli_w.dumps(plain(asdict(scenario)))


def identity(scenario_toml: str, seed: int, code: dict[str, str]) -> str:
    """Return the identity of a run of a dumped scenario with a seed under these versions."""
    return run_id(f"{scenario_toml}\nseed = {seed}\n", code)


def _parsed(line: str) -> dict[str, Any]:
    """Return one `key.key=value` as tables."""
    try:
        return tomllib.loads(line)
    except tomllib.TOMLDecodeError as error:
        raise InvalidScenario(
            f"--set {line}: must be key.key=value with a TOML value "
            f'(numbers 1.5, words "grass"): {error}'
        ) from None


def merge(content: dict[str, Any], extra: Mapping[str, Any]) -> None:
    """Lay tables over others, in place."""
    for key, value in extra.items():
        below = content.get(key)
        if isinstance(value, Mapping) and isinstance(below, dict):
            merge(below, value)
        else:
            content[key] = copy.deepcopy(value)


def plain(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    """Return the value as TOML has it: without what is not there."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items() if item is not None}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _anchored(scenario: Scenario, folder: Path) -> Scenario:
    """Return the scenario with the paths of its files made absolute."""
    plant = scenario.plant
    return replace(
        scenario,
        path=scenario.path.anchored(folder),
        terrain=scenario.terrain.anchored(folder),
        soil=scenario.soil.anchored(folder),
        plant=replace(plant, vehicle=plant.vehicle.anchored(folder)),
        controller=scenario.controller.anchored(folder),
    )


def _resolved(scenario: Scenario) -> Scenario:
    """Return the scenario with every value of the vehicle and of the belief filled in."""
    plant, controller = scenario.plant, scenario.controller
    believed = controller.vehicle.resolved(plant.vehicle.filed())
    return replace(
        scenario,
        plant=replace(plant, vehicle=plant.vehicle.resolved()),
        controller=replace(controller, vehicle=believed),
    )
