"""A scenario: everything that describes a run except its seed and its folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

import tomli_w
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from experiments.errors import InvalidScenario
from experiments.settings.actuators import ActuatorSettings
from experiments.settings.base import STRICT
from experiments.settings.controller import ControllerSettings
from experiments.settings.ground import SoilSettings, TerrainSettings
from experiments.settings.path import KINDS, FigureEight, PathSettings
from experiments.settings.plant import PlantSettings
from experiments.settings.sensors import SensorSettings
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
        raise InvalidScenario(f"{where}: {_first_complaint(error)}") from None


def _first_complaint(error: ValidationError) -> str:
    """Return key, what is allowed there and what was given, in the words of the file."""
    first = error.errors()[0]
    # The validator mixes the kinds of a path into its locations; they are no keys of the file.
    keys = ".".join(str(part) for part in first["loc"] if part not in KINDS)
    if first["type"] == "unexpected_keyword_argument":
        allowed = ", ".join(field.name for field in fields(_table(first["loc"])))
        return f"{keys}: unknown key; allowed here: {allowed}"
    given = first["input"]
    said = "" if isinstance(given, Mapping) else f", got {given!r}"
    return f"{keys}: {first['msg']}{said}"


def _table(location: Sequence[str | int]) -> Any:  # noqa: ANN401 - a dataclass type
    """Return the dataclass whose key the last part of a validator's location is."""
    table: Any = Scenario
    for part in location[:-1]:
        if part in KINDS:
            table = KINDS[part]
        elif isinstance(part, str):
            hint = get_type_hints(table)[part]
            table = next((kind for kind in get_args(hint) if is_dataclass(kind)), hint)
    return table


def _plain(value: Any) -> Any:  # noqa: ANN401 - any TOML value
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _anchored(scenario: Scenario, folder: Path) -> Scenario:
    """Return the scenario with the path of its height map made absolute."""
    if not scenario.terrain.height_map:
        return scenario
    file = (folder / scenario.terrain.height_map).resolve()
    return replace(scenario, terrain=replace(scenario.terrain, height_map=str(file)))
