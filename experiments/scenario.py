"""A scenario: everything that describes a run except its seed and its folder."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import tomli_w
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from experiments.errors import InvalidScenario
from testbed.resources import resource

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=_STRICT)
class FigureEight:
    """Two circles joined by two crossing straights; the long axis lies east-west."""

    kind: Literal["figure-eight"] = "figure-eight"
    radius_m: Positive = 10.0
    centre_distance_m: Positive = 30.0
    blend_m: Positive = 2.0  # length over which curvature goes from 0 to that of the circle
    laps: Annotated[int, Field(ge=1, le=100)] = 2
    speed_mps: Positive = 1.0


@dataclass(frozen=True, config=_STRICT)
class Straight:
    """A straight line to the east through the middle of the field."""

    kind: Literal["straight"]
    length_m: Positive = 40.0
    speed_mps: Positive = 1.0


@dataclass(frozen=True, config=_STRICT)
class TerrainSettings:
    """Roughness and slope of the ground, or a height map from a file instead of the roughness."""

    iso_class: Literal["A", "B", "C", "D", "E", "F", "flat"] = "D"  # ISO 8608, geometric mean
    slope_rad: Annotated[float, Field(ge=0, le=0.6)] = 0.0
    uphill_deg: float = 90.0  # direction in which the slope rises, counter-clockwise from east
    size_x_m: Annotated[float, Field(gt=0, le=400)] = 80.0
    size_y_m: Annotated[float, Field(gt=0, le=400)] = 50.0
    spacing_m: Annotated[float, Field(ge=0.02, le=1.0)] = 0.1
    height_map: str = ""  # file of heights [m] (.npy, .csv, .txt), centred on the origin


@dataclass(frozen=True, config=_STRICT)
class PatchSettings:
    """A round patch of soil of another strength."""

    x_m: float
    y_m: float
    radius_m: Positive
    cone_index_kpa: Positive


@dataclass(frozen=True, config=_STRICT)
class SoilSettings:
    """Cone index of the soil, with patches laid over it; a later patch covers an earlier one."""

    cone_index_kpa: Positive = 600.0
    patches: tuple[PatchSettings, ...] = ()


@dataclass(frozen=True, config=_STRICT)
class TrueVehicle:
    """What the vehicle really is, where it may differ from what the controller believes."""

    hitch_offset_m: float = 0.3  # rear axle to RJ1
    drawbar_m: Positive = 0.8  # RJ1 to RJ2
    load_kg: NotNegative = 0.0  # in the trailer, on top of its own mass
    load_height_m: Positive = 0.55  # centre of the load above the trailer axle
    load_forward_m: float = 0.0  # centre of the load ahead of the trailer axle


@dataclass(frozen=True, config=_STRICT)
class PlantSettings:
    """How the vehicle is simulated."""

    wheels: Literal["soil", "contact"] = "soil"
    timestep_s: Annotated[float, Field(ge=0.0005, le=0.008)] = 0.002
    vehicle: TrueVehicle = TrueVehicle()


@dataclass(frozen=True, config=_STRICT)
class SensorSettings:
    """Rates and noise of the paper's sensors."""

    gnss_rate_hz: Positive = 5.0
    gnss_sd_m: NotNegative = 0.03
    angle_rate_hz: Positive = 25.0
    angle_sd_deg: NotNegative = 1.0
    encoder_rate_hz: Positive = 25.0
    encoder_sd_mps: NotNegative = 0.1


@dataclass(frozen=True, config=_STRICT)
class BelievedVehicle:
    """What the controller and its estimator believe the vehicle to be."""

    wheelbase_m: Positive = 1.4
    hitch_offset_m: float = 0.3
    drawbar_m: Positive = 0.8
    trailer_m: Positive = 1.3
    speed_gain_mps: Positive = 1.4
    speed_time_constant_s: Positive = 2.05


@dataclass(frozen=True, config=_STRICT)
class ControllerSettings:
    """Who drives."""

    name: str = "paper"
    estimator: Literal["ekf", "truth"] = "ekf"
    vehicle: BelievedVehicle = BelievedVehicle()


@dataclass(frozen=True, config=_STRICT)
class Scenario:
    """A field, a path over it, the vehicle, its sensors and its driver."""

    description: str = ""
    path: Annotated[FigureEight | Straight, Field(discriminator="kind")] = FigureEight()
    terrain: TerrainSettings = TerrainSettings()
    soil: SoilSettings = SoilSettings()
    plant: PlantSettings = PlantSettings()
    sensors: SensorSettings = SensorSettings()
    controller: ControllerSettings = ControllerSettings()


_SCENARIO = TypeAdapter(Scenario)
_PATHS: Mapping[str | int, Any] = {"figure-eight": FigureEight, "straight": Straight}


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
    keys = ".".join(str(part) for part in first["loc"] if part not in _PATHS)
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
        if part in _PATHS:
            table = _PATHS[part]
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
