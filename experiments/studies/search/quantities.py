"""Quantities of a search, their space, and their names on the command line."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from ttempc.suggestion import did_you_mean
from ttempc.types import FloatArray

from ...errors import InvalidStudy
from ...scenario.scenario import Scenario, ScenarioFile, merge_tables, without_none
from ..sweep.plan import scenario_value
from ..sweep.study import BY_NAME, Scalar

_FREE: Final = "free"
_ENDS: Final = (0.1, 0.9)  # of the path: the vehicle has started, and can still be lost


@dataclass(frozen=True)
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
        """Return the distance from the nominal value over the farther bound's, 0 to 1."""
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


_DEAD_TIMES: Final = tuple(f"actuators.{n}.dead_time_s" for n in ("front", "trailer", "hydrostat"))
QUANTITIES: Final[Mapping[str, Parameter]] = {
    "cone-index": Parameter(
        ("soil.cone_index_kpa",), 100.0, 2000.0, spacing="log", unit="kPa", tolerance=20.0
    ),
    "slope": Parameter(("terrain.slope_rad",), 0.0, 0.4, unit="rad", tolerance=0.01),
    "speed": Parameter(("path.speed_mps",), 0.4, 1.35, unit="m/s", tolerance=0.05),
    # A dead time is a whole number of physics steps.
    "delay": Parameter(_DEAD_TIMES, 0.0, 1.0, step=0.01, unit="s", tolerance=0.05),
    "roughness": Parameter(
        ("terrain.iso_class",), 0.0, 5.0, names=tuple("ABCDEF"), unit="ISO 8608"
    ),
}
"""Quantities of a scenario by name; the ranges are assumed."""

_SPAN: Final = ("duration_s", 0.5, 20.0, "low")
# Kind of `[[faults]]` -> keys with one value; searched keys, their range, and its nominal end. From
# hardly felt to far outside of normal use; assumed.
_FAULTS: Final[Mapping[str, tuple[dict[str, str | float], tuple[Any, ...]]]] = {
    "gust": (
        {"body": "trailer", "duration_s": 2.0},
        (("force_n", 10.0, 6000.0, "low"), ("direction_deg", 0.0, 360.0, _FREE)),
    ),
    "ditch": ({"width_m": 1.5}, (("depth_m", 0.01, 0.6, "low"),)),
    "soil_patch": (
        {},
        (
            ("radius_m", 1.0, 8.0, "low"),
            ("cone_index_kpa", 60.0, 600.0, "high", "log"),
            ("left_m", -3.0, 3.0, _FREE),
        ),
    ),
    "gnss_float": ({"correlation_time_s": 2.0}, (("sd_m", 0.01, 2.0, "low"), _SPAN)),
    "angle_noise": ({"sensor": "hitch"}, (("sd_deg", 0.1, 20.0, "low"), _SPAN)),
    "gnss_out": ({}, (("duration_s", 0.5, 30.0, "low"),)),
    "commands_late": ({}, (("delay_s", 0.02, 2.0, "low"), _SPAN)),
    "front_steering_stuck": ({}, (_SPAN,)),
    "trailer_steering_stuck": ({}, (_SPAN,)),
}


def _fault_range(
    kind: str,
    key: str,
    low: float,
    high: float,
    nominal: str,
    spacing: Literal["linear", "log"] = "linear",
) -> Parameter:
    value = {"low": low, "high": high}.get(nominal)
    return Parameter((f"faults.{kind}.{key}",), low, high, nominal=value, spacing=spacing)


FAULTS: Final[tuple[str, ...]] = tuple(_FAULTS)
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
            `KEY=LOW:HIGH:free` for one without severity.

    Raises:
        InvalidScenario: the settings are invalid.
        InvalidStudy: a word is none of these, or the nominal value lies outside of its bounds.
    """
    scenario = draft.scenario(settings, "--set")
    tables: dict[str, Any] = {}
    merge_tables(tables, settings)
    added = []
    for kind in filter(FAULTS.__contains__, words):
        fixed, ranges = _FAULTS[kind]
        least = {key: low for key, low, *_ in ranges}
        added.append({"kind": kind, "at_m": 0.0, **fixed, **least})
    if added:
        tables["faults"] = [*(without_none(asdict(f)) for f in scenario.faults), *added]
        scenario = draft.scenario(tables, "--set")
    parameters: dict[str, Parameter] = {}
    for word in words:
        if word in FAULTS:
            length_m = scenario.mission().path.length_m
            ends = (round(share * length_m, 2) for share in _ENDS)
            places: list[Any] = [*_FAULTS[word][1], ("at_m", *ends, _FREE)]
            found = [_fault_range(word, *one) for one in places]
        else:
            parameter, free = read_quantity(word, FAULTS)
            nominal = None if free else _nominal(parameter, scenario, draft.name)
            found = [replace(parameter, nominal=nominal)]
        parameters |= {parameter.keys[0]: parameter for parameter in found}
    space = Space(tuple(parameters.values()))
    if not space.counted.any():
        raise InvalidStudy("no quantity has a severity: give one that is not free")
    return Subject(name, tables, space)


def _nominal(parameter: Parameter, scenario: Scenario, name: str) -> float:
    """Return the value of the scenario.

    Raises:
        InvalidStudy: it is no number between the bounds.
    """
    low = parameter.low
    high = parameter.high
    value = scenario_value(scenario, parameter.keys[0], name)
    if value in parameter.names:
        value = parameter.names.index(str(value))
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InvalidStudy(
            f"{parameter.keys[0]}: the scenario's value must be a number from {low:g} to {high:g}, "
            f"the bounds, got {value!r}; change the bounds (KEY=LOW:HIGH), or make it :free"
        )
    return float(value)


def read_quantity(word: str, more: tuple[str, ...] = ()) -> tuple[Parameter, bool]:
    """Return a quantity by its name, or of `KEY=LOW:HIGH` or `KEY=LOW:HIGH:free`; is it free?

    Raises:
        InvalidStudy: it is none of these.
    """
    if word in QUANTITIES:
        return QUANTITIES[word], False
    key, equals, text = word.partition("=")
    names = (*QUANTITIES, *more)
    if not equals or key in (*BY_NAME, "controller.name"):  # these have no numbers
        raise InvalidStudy(
            f"quantity {word!r}: must be KEY=LOW:HIGH or one of {', '.join(names)}"
            f"{did_you_mean(word, names)}"
        )
    low_text, _, high_text = text.removesuffix(f":{_FREE}").partition(":")
    try:
        low = float(low_text)
        high = float(high_text)
    except ValueError:
        low = high = math.nan
    if not (math.isfinite(high - low) and low < high):
        raise InvalidStudy(
            f"quantity {word!r}: must be KEY=LOW:HIGH with two numbers, LOW below HIGH, or "
            "KEY=LOW:HIGH:free"
        )
    return Parameter((key,), low, high), text.endswith(_FREE)
