"""Quantities of a search, their space, and their names on the command line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from ttempc.suggestion import did_you_mean
from ttempc.types import FloatArray

from ..errors import InvalidStudy
from ..scenario.scenario import Scenario, ScenarioFile, merge_tables, without_none
from ..sweep.plan import scenario_value
from ..sweep.study import Scalar

_FREE: Final = "free"
_ENDS: Final = (0.1, 0.9)  # of the path: the vehicle has started, and can still be lost


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A bounded quantity of a scenario.

    Its position is a number from 0 (`low`) to 1 (`high`), on a logarithmic scale if so spaced.
    """

    keys: tuple[str, ...]  # of the scenario: all have the value
    low: float
    high: float
    nominal: float | None = None  # None: free, as a place or a direction, which is no severity
    spacing: Literal["linear", "log"] = "linear"
    step: float = 0.0  # values are whole multiples of it; 0: any value
    names: tuple[str, ...] = ()  # values of which `low` to `high` are the indices
    unit: str = ""
    tolerance: float = 0.0  # width at which a bisection ends; 0: 1/40 of the range

    def position(self, value: float) -> float:
        """Return the position of a value."""
        if self.spacing == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    @property
    def nominal_position(self) -> float:
        """Return the position of the nominal value, of a free parameter the middle."""
        return 0.5 if self.nominal is None else self.position(self.nominal)

    def number(self, position: float) -> float:
        """Return the value at a position; of a named parameter the index of its name."""
        if self.spacing == "log":
            value = self.low * (self.high / self.low) ** position
        else:
            value = self.low + position * (self.high - self.low)
        step = 1.0 if self.names else self.step
        # Six digits, so that a scenario file shows 812.25, not 812.2495170431.
        value = round(round(value / step) * step, 12) if step else float(f"{value:.6g}")
        return min(max(value, self.low), self.high)

    def named(self, number: float) -> float | str:
        """Return the value that the scenario gets for a number."""
        return self.names[int(number)] if self.names else number

    def severity(self, position: float) -> float:
        """Return the distance from the nominal value over that of the farther bound, 0 to 1."""
        nominal = self.nominal_position
        distance = abs(self.position(self.number(position)) - nominal)
        return distance / max(nominal, 1.0 - nominal)


@dataclass(frozen=True)
class Space:
    """All parameters of a search; a point has a position for each, (n,)."""

    parameters: tuple[Parameter, ...]

    @property
    def nominal(self) -> FloatArray:
        """Return the nominal point, (n,)."""
        return np.array([parameter.nominal_position for parameter in self.parameters])

    @property
    def counted(self) -> FloatArray:
        """Return 1 for a parameter that counts as severity, 0 for a free one, (n,)."""
        return np.array([float(p.nominal is not None) for p in self.parameters])

    def severity(self, point: FloatArray) -> float:
        """Return the root mean square of the severities: 0 nominal, 1 every value at its bound."""
        pairs = zip(self.parameters, point.tolist(), strict=True)
        squares = [p.severity(x) ** 2 for p, x in pairs if p.nominal is not None]
        return math.sqrt(sum(squares) / len(squares))

    def changes(self, point: FloatArray) -> dict[str, Scalar]:
        """Return the values of all scenario keys at a point."""
        pairs = zip(self.parameters, point.tolist(), strict=True)
        return {key: p.named(p.number(position)) for p, position in pairs for key in p.keys}


def _range(
    low: float,
    high: float,
    nominal: Literal["low", "high", "free"] = "low",
    spacing: Literal["linear", "log"] = "linear",
) -> Parameter:
    """Return the range of a key of a fault; its key follows from its place in `FAULTS`."""
    value = {"low": low, "high": high, _FREE: None}[nominal]
    return Parameter(keys=("",), low=low, high=high, nominal=value, spacing=spacing)


QUANTITIES: Final[Mapping[str, Parameter]] = {
    "cone-index": Parameter(
        keys=("soil.cone_index_kpa",),
        unit="kPa",
        low=100.0,
        high=2000.0,
        spacing="log",
        tolerance=20.0,
    ),
    "slope": Parameter(keys=("terrain.slope_rad",), unit="rad", low=0.0, high=0.4, tolerance=0.01),
    "speed": Parameter(keys=("path.speed_mps",), unit="m/s", low=0.4, high=1.35, tolerance=0.05),
    "delay": Parameter(
        keys=tuple(f"actuators.{n}.dead_time_s" for n in ("front", "trailer", "hydrostat")),
        unit="s",
        low=0.0,
        high=1.0,
        step=0.01,  # a dead time is a whole number of physics steps
        tolerance=0.05,
    ),
    "roughness": Parameter(
        keys=("terrain.iso_class",), unit="ISO 8608", low=0.0, high=5.0, names=tuple("ABCDEF")
    ),
}
"""Quantities of a scenario by name; the ranges are assumed."""

# Kind of `[[faults]]` -> keys with one value, and ranges of the keys that are searched. From hardly
# felt to far outside of normal use; assumed.
FAULTS: Final[Mapping[str, tuple[dict[str, str | float], dict[str, Parameter]]]] = {
    "gust": (
        {"body": "trailer", "duration_s": 2.0},
        {"force_n": _range(10.0, 6000.0), "direction_deg": _range(0.0, 360.0, _FREE)},
    ),
    "ditch": ({"width_m": 1.5}, {"depth_m": _range(0.01, 0.6)}),
    "soil_patch": (
        {},
        {
            "radius_m": _range(1.0, 8.0),
            "cone_index_kpa": _range(60.0, 600.0, "high", "log"),
            "left_m": _range(-3.0, 3.0, _FREE),
        },
    ),
    "gnss_float": (
        {"correlation_time_s": 2.0},
        {"sd_m": _range(0.01, 2.0), "duration_s": _range(0.5, 20.0)},
    ),
    "angle_noise": (
        {"sensor": "hitch"},
        {"sd_deg": _range(0.1, 20.0), "duration_s": _range(0.5, 20.0)},
    ),
    "gnss_out": ({}, {"duration_s": _range(0.5, 30.0)}),
    "commands_late": ({}, {"delay_s": _range(0.02, 2.0), "duration_s": _range(0.5, 20.0)}),
    "front_steering_stuck": ({}, {"duration_s": _range(0.5, 20.0)}),
    "trailer_steering_stuck": ({}, {"duration_s": _range(0.5, 20.0)}),
}
"""Faults that a search of the worst case adds to a scenario, once, anywhere on the path."""


@dataclass(frozen=True)
class Subject:
    """Scenario with its changes, and the space of its parameters."""

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
        words: names of `QUANTITIES` and `FAULTS`, or `KEY=LOW:HIGH` for a key of the scenario,
            `KEY=LOW:HIGH:free` for one without severity. A key that a name has, too, gets other
            bounds.

    Raises:
        InvalidScenario: the settings are invalid.
        InvalidStudy: a word is none of these, or the nominal value lies outside of its bounds.
    """
    scenario = draft.scenario(settings, "--set")
    tables: dict[str, Any] = {}
    merge_tables(tables, settings)
    added = [
        {"kind": kind, "at_m": 0.0, **FAULTS[kind][0], **{k: p.low for k, p in ranges.items()}}
        for kind in words
        if kind in FAULTS
        for ranges in (FAULTS[kind][1],)
    ]
    if added:
        tables["faults"] = [*(without_none(asdict(f)) for f in scenario.faults), *added]
        scenario = draft.scenario(tables, "--set")
    parameters = {
        parameter.keys[0]: parameter
        for word in words
        for parameter in _parameters(word, scenario, draft.name, words)
    }
    space = Space(tuple(parameters.values()))
    if not space.counted.any():
        raise InvalidStudy("no quantity has a severity: give one that is not free")
    return Subject(name, tables, space)


def _parameters(
    word: str, scenario: Scenario, name: str, words: Sequence[str]
) -> Iterator[Parameter]:
    if word in FAULTS:
        length_m = scenario.mission().path.length_m
        low, high = (round(share * length_m, 2) for share in _ENDS)
        for key, bounds in (*FAULTS[word][1].items(), ("at_m", _range(low, high, _FREE))):
            yield replace(bounds, keys=(f"faults.{word}.{key}",))
        return
    parameter, free = read_quantity(word)
    key = parameter.keys[0]
    _, fault, last = f"{key}..".split(".")[:3]
    known = FAULTS[fault][1].get(last) if fault in words and fault in FAULTS else None
    if known:  # other bounds of an added fault
        ends = {known.low: parameter.low, known.high: parameter.high, None: None}
        nominal, parameter = ends[known.nominal], replace(parameter, spacing=known.spacing)
    else:
        nominal = scenario_value(scenario, key, name)
        if nominal in parameter.names:
            nominal = parameter.names.index(str(nominal))
    yield parameter if free else replace(parameter, nominal=_within(parameter, nominal))


def _within(parameter: Parameter, value: object) -> float | None:
    """Return a nominal value.

    Raises:
        InvalidStudy: it is no number between the bounds.
    """
    low, high = parameter.low, parameter.high
    if value is None and parameter.keys[0].startswith("faults."):
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InvalidStudy(
            f"{parameter.keys[0]}: the scenario's value must be a number from {low:g} to {high:g}, "
            f"the bounds, got {value!r}; change the bounds (KEY=LOW:HIGH), or make it :free"
        )
    return float(value)


def read_quantity(word: str) -> tuple[Parameter, bool]:
    """Return a quantity by its name, or of `KEY=LOW:HIGH` or `KEY=LOW:HIGH:free`; is it free?

    Raises:
        InvalidStudy: it is none of these.
    """
    if word in QUANTITIES:
        return QUANTITIES[word], False
    key, equals, text = word.partition("=")
    names = (*QUANTITIES, *FAULTS)
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
    return Parameter(keys=(key,), low=low, high=high), bool(colon)
