"""Quantities of a search: those of `ttempc envelope`, disturbances, keys of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

from ttempc.suggestion import did_you_mean

from ..errors import InvalidStudy
from ..scenario.scenario import Scenario, ScenarioFile, merge_tables, without_none
from ..sweep.envelope import QUANTITIES
from ..sweep.plan import scenario_value
from .space import Parameter, Space

_FREE: Final = "free"
_ENDS: Final = (0.1, 0.9)  # of the path: the vehicle has started, and can still be lost


@dataclass(frozen=True)
class Range:
    """Range of one key of a fault."""

    low: float
    high: float
    nominal: Literal["low", "high", "free"] = "low"
    spacing: Literal["linear", "log"] = "linear"


@dataclass(frozen=True)
class Disturbance:
    """A fault that a search adds to a scenario, once, at any place of the path."""

    fault: Mapping[str, str | float]  # keys with one value, see docs/faults.md
    ranges: Mapping[str, Range]  # keys that are searched


DISTURBANCES: Final[Mapping[str, Disturbance]] = MappingProxyType(
    {
        "gust": Disturbance(
            {"kind": "gust", "body": "trailer", "duration_s": 2.0},
            {"force_n": Range(10.0, 6000.0), "direction_deg": Range(0.0, 360.0, "free")},
        ),
        "ditch": Disturbance(
            {"kind": "ditch", "width_m": 1.5},
            {"depth_m": Range(0.01, 0.6)},
        ),
        "soil-patch": Disturbance(
            {"kind": "soil_patch"},
            {
                "radius_m": Range(1.0, 8.0),
                "cone_index_kpa": Range(60.0, 600.0, "high", "log"),
                "left_m": Range(-3.0, 3.0, "free"),
            },
        ),
        "gnss-noise": Disturbance(
            {"kind": "gnss_float", "correlation_time_s": 2.0},
            {"sd_m": Range(0.01, 2.0), "duration_s": Range(0.5, 20.0)},
        ),
        "angle-noise": Disturbance(
            {"kind": "angle_noise", "sensor": "hitch"},
            {"sd_deg": Range(0.1, 20.0), "duration_s": Range(0.5, 20.0)},
        ),
        "gnss-outage": Disturbance({"kind": "gnss_out"}, {"duration_s": Range(0.5, 30.0)}),
        "late-commands": Disturbance(
            {"kind": "commands_late"},
            {"delay_s": Range(0.02, 2.0), "duration_s": Range(0.5, 20.0)},
        ),
        "stuck-front": Disturbance(
            {"kind": "front_steering_stuck"}, {"duration_s": Range(0.5, 20.0)}
        ),
        "stuck-trailer": Disturbance(
            {"kind": "trailer_steering_stuck"}, {"duration_s": Range(0.5, 20.0)}
        ),
    }
)
"""Faults by their names, with ranges from hardly felt to far outside of normal use; assumed."""


@dataclass(frozen=True)
class Subject:
    """What is searched: a scenario with its changes, and the space of its parameters."""

    scenario: str
    settings: dict[str, Any]  # override tables of the scenario, the added faults among them
    space: Space


def read_subject(
    draft: ScenarioFile, name: str, settings: Mapping[str, Any], words: Sequence[str]
) -> Subject:
    """Return the subject of a search.

    Args:
        draft: the scenario.
        name: by which the scenario is read again.
        settings: override tables.
        words: names of `QUANTITIES` and `DISTURBANCES`, or `KEY=LOW:HIGH` for a key of the
            scenario, `KEY=LOW:HIGH:free` for one without severity. A key that a name has, too,
            gets other bounds.

    Raises:
        InvalidScenario: the settings are invalid.
        InvalidStudy: a word is none of these, or the nominal value lies outside of its bounds.
    """
    scenario = draft.scenario(settings, "--set")
    tables: dict[str, Any] = {}
    merge_tables(tables, settings)
    added = [_fault(word) for word in words if word in DISTURBANCES]
    if added:
        tables["faults"] = [*(without_none(asdict(f)) for f in scenario.faults), *added]
        scenario = draft.scenario(tables, "--set")
    parameters: dict[str, Parameter] = {}
    for word in words:
        for parameter in _parameters(word, scenario, draft.name, words):
            parameters[parameter.keys[0]] = parameter
    space = Space(tuple(parameters.values()))
    if not space.counted.any():
        raise InvalidStudy("no quantity has a severity: give one that is not free")
    return Subject(name, tables, space)


def _fault(word: str) -> dict[str, Any]:
    """Return the table of an added fault, with a value for every key that is searched."""
    disturbance = DISTURBANCES[word]
    values = {key: bounds.low for key, bounds in disturbance.ranges.items()}
    return {"name": word, "at_m": 0.0, **disturbance.fault, **values}


def _parameters(
    word: str, scenario: Scenario, name: str, words: Sequence[str]
) -> Iterator[Parameter]:
    if word in DISTURBANCES:
        length_m = scenario.mission().path.length_m
        low, high = (round(share * length_m, 2) for share in _ENDS)
        for key, bounds in (
            *DISTURBANCES[word].ranges.items(),
            ("at_m", Range(low, high, "free")),
        ):
            ends = {"low": bounds.low, "high": bounds.high, "free": None}
            yield Parameter(
                keys=(f"faults.{word}.{key}",),
                low=bounds.low,
                high=bounds.high,
                nominal=ends[bounds.nominal],
                spacing=bounds.spacing,
            )
    elif word in QUANTITIES:
        quantity = QUANTITIES[word]
        names = quantity.names
        nominal = scenario_value(scenario, quantity.keys[0], name)
        yield Parameter(
            keys=quantity.keys,
            low=quantity.low,
            high=quantity.high,
            nominal=_nominal(
                word,
                names.index(str(nominal)) if nominal in names else nominal,
                quantity.low,
                quantity.high,
            ),
            spacing=quantity.spacing,
            step=quantity.step,
            names=names,
        )
    else:
        key, low, high, free = _bounds(word)
        _, fault, last = f"{key}..".split(".")[:3]
        ranges = DISTURBANCES[fault].ranges if fault in words and fault in DISTURBANCES else {}
        if bounds := ranges.get(last):
            free = free or bounds.nominal == _FREE
            nominal = high if bounds.nominal == "high" else low
            spacing = bounds.spacing
        else:
            nominal, spacing = scenario_value(scenario, key, name), "linear"
        yield Parameter(
            keys=(key,),
            low=low,
            high=high,
            nominal=None if free else _nominal(key, nominal, low, high),
            spacing=spacing,
        )


def _nominal(key: str, value: object, low: float, high: float) -> float:
    """Return the nominal value.

    Raises:
        InvalidStudy: it is no number between the bounds.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InvalidStudy(
            f"{key}: the scenario's value must be a number from {low:g} to {high:g}, the bounds, "
            f"got {value!r}; change the bounds (KEY=LOW:HIGH), or make it :free"
        )
    return float(value)


def _bounds(word: str) -> tuple[str, float, float, bool]:
    """Read `KEY=LOW:HIGH` or `KEY=LOW:HIGH:free`.

    Raises:
        InvalidStudy: it is neither, and no name.
    """
    key, equals, text = word.partition("=")
    names = (*QUANTITIES, *DISTURBANCES)
    if not equals:
        raise InvalidStudy(
            f"quantity {word!r}: must be KEY=LOW:HIGH or one of {', '.join(names)}"
            f"{did_you_mean(word, names)}"
        )
    low_text, _, rest = text.partition(":")
    high_text, colon, last = rest.partition(":")
    try:
        low, high = float(low_text), float(high_text)
    except ValueError:
        low = high = math.nan
    if not (math.isfinite(high - low) and low < high) or (colon and last != _FREE):
        raise InvalidStudy(
            f"quantity {word!r}: must be KEY=LOW:HIGH with two numbers, LOW below HIGH, or "
            "KEY=LOW:HIGH:free"
        )
    return key, low, high, bool(colon)
