"""A scenario: everything that describes a run except its seed and its folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from experiments.complaint import first_complaint
from experiments.errors import InvalidScenario
from experiments.settings.actuators import ActuatorSettings
from experiments.settings.base import STRICT
from experiments.settings.controller import ControllerSettings
from experiments.settings.path import FigureEight, PathSettings
from experiments.settings.plant import PlantSettings
from experiments.settings.sensors import SensorSettings
from experiments.settings.soil import SoilSettings
from experiments.settings.terrain import TerrainSettings
from testbed.resources import resource


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


_SCENARIO = TypeAdapter(Scenario)


def shipped() -> list[str]:
    """Return the names of the scenarios that ship with the project."""
    return sorted(path.stem for path in resource("experiments", "scenarios").glob("*.toml"))


def load(name: str, overrides: Sequence[str] = ()) -> tuple[str, Scenario]:
    """Return name and content of a scenario.

    Args:
        name: a shipped scenario, or the path of a TOML file.
        overrides: lines `key.key=value`, the value as in TOML, laid over the file.

    Raises:
        InvalidScenario: no such scenario, or one that says something impossible.
    """
    file = _find(name)
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InvalidScenario(f"{file}: cannot be read as TOML: {error}") from None
    for line in overrides:
        _override(content, line)
    if isinstance(content.get("path"), dict):
        content["path"].setdefault("kind", FigureEight.kind)
    scenario = _validate(content, str(file))
    return file.stem, _anchored(scenario, file.parent)


def dump(scenario: Scenario) -> str:
    """Return the scenario with every default written out, as TOML that `load` reads back."""
    return tomli_w.dumps(_plain(asdict(scenario)))


def _find(name: str) -> Path:
    if name in shipped():
        return resource("experiments", f"scenarios/{name}.toml")
    file = Path(name)
    if file.suffix == ".toml" and file.is_file():
        return file
    reason = "no such file" if file.suffix == ".toml" else "no such scenario"
    raise InvalidScenario(
        f"scenario {name!r}: {reason}; shipped are {', '.join(shipped())}, "
        "or give the path of a .toml file"
    )


def _override(content: dict[str, Any], line: str) -> None:
    """Lay one `key.key=value` over the content of a file, in place."""
    try:
        extra = tomllib.loads(line)
    except tomllib.TOMLDecodeError as error:
        raise InvalidScenario(
            f"--set {line}: must be key.key=value with a TOML value "
            f'(numbers 1.5, words "grass"): {error}'
        ) from None
    _merge(content, extra)


def _merge(content: dict[str, Any], extra: Mapping[str, Any]) -> None:
    for key, value in extra.items():
        below = content.get(key)
        if isinstance(value, Mapping) and isinstance(below, dict):
            _merge(below, value)
        else:
            content[key] = value


def _validate(content: Mapping[str, Any], where: str) -> Scenario:
    try:
        # By way of JSON, because only there does the strict mode take tables for dataclasses.
        return _SCENARIO.validate_json(json.dumps(content, default=str))
    except ValidationError as error:
        raise InvalidScenario(f"{where}: {first_complaint(error, Scenario)}") from None


def _plain(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    """Return the value as TOML has it: without what is not there."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _anchored(scenario: Scenario, folder: Path) -> Scenario:
    """Return the scenario with the paths of its files made absolute."""
    return replace(
        scenario,
        terrain=scenario.terrain.anchored(folder),
        soil=scenario.soil.anchored(folder),
    )
