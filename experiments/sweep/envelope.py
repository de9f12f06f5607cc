"""Envelope: the value of one quantity above or below which a controller fails.

A scan over the whole range, ends included, finds a bracket and shows whether failure is monotone.
Bisection then narrows the bracket down to the tolerance. Every value is driven under every seed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, cast

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from ..errors import InvalidStudy, SweepStopped
from .engine import Engine
from .failure import ERROR, has_failed, is_unmeasured, mostly_fails, unmeasured_text
from .plan import SweepPlan
from .points import drive_plan
from .row import Row
from .study import ListAxis, Study

_Count = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class Quantity:
    """A quantity whose limit can be searched, with its default range."""

    keys: tuple[str, ...]
    unit: str
    low: float
    high: float
    spacing: Literal["linear", "log"] = "linear"
    names: tuple[str, ...] = ()  # in place of a range
    step: float = 0.0  # all values are whole multiples of it; 0: any value is allowed


QUANTITIES: Final[Mapping[str, Quantity]] = MappingProxyType(
    {
        "cone-index": Quantity(("soil.cone_index_kpa",), "kPa", 100.0, 2000.0, "log"),
        "slope": Quantity(("terrain.slope_rad",), "rad", 0.0, 0.4),
        "speed": Quantity(("path.speed_mps",), "m/s", 0.4, 1.35),
        "delay": Quantity(
            tuple(f"actuators.{name}.dead_time_s" for name in ("front", "trailer", "hydrostat")),
            unit="s",
            low=0.0,
            high=1.0,
            step=0.01,  # a dead time is a whole number of physics steps
        ),
        "roughness": Quantity(("terrain.iso_class",), "ISO 8608", 0.0, 5.0, names=tuple("ABCDEF")),
    }
)


@dataclass(frozen=True, config=STRICT)
class Question:
    """Settings of the search: controller, scenario, quantity, range and criterion of failure."""

    scenario: str
    controller: str
    quantity: str  # one of `QUANTITIES`
    low: float
    high: float
    tolerance: float  # between the value that holds and the value that fails
    limit_m: float | None  # on the trailer's 95 % cross-track error; None: completed runs hold
    seeds: tuple[int, ...]
    scan: int = 5  # values over the range before bisection, ends included
    settings: dict[str, Any] = Field(default_factory=dict)  # override keys of the scenario

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(
                f"quantity must be one of {', '.join(QUANTITIES)}, got {self.quantity!r}"
            )

    def scan_values(self) -> list[float]:
        """Return the values of the scan; those of a named quantity are the indices of its names.

        Raises:
            InvalidStudy: the range or the tolerance is invalid.
        """
        quantity, low, high = QUANTITIES[self.quantity], self.low, self.high
        if quantity.names:
            return [float(number) for number in range(len(quantity.names))]
        if not low < high:
            raise InvalidStudy(f"{self.quantity}: low must be below high, got {low:g}, {high:g}")
        if not self.tolerance > 0.0:
            raise InvalidStudy(f"tolerance must be above 0, got {self.tolerance:g}")
        if self.tolerance < quantity.step:
            raise InvalidStudy(
                f"tolerance must be at least {quantity.step:g} {quantity.unit}, the step of "
                f"{self.quantity}, got {self.tolerance:g}"
            )
        for end in (low, high):
            if not math.isclose(self.snapped(end), end, abs_tol=1e-12):
                raise InvalidStudy(
                    f"{self.quantity}: must be a multiple of {quantity.step:g} {quantity.unit}, "
                    f"got {end:g}"
                )
        if quantity.spacing == "log" and low <= 0.0:
            raise InvalidStudy(f"{self.quantity}: low must be above 0, got {low:g}")
        space = np.geomspace if quantity.spacing == "log" else np.linspace
        between = (self.snapped(number) for number in space(low, high, self.scan)[1:-1].tolist())
        return sorted({low, *between, high})

    def snapped(self, number: float) -> float:
        """Return the nearest allowed value of the quantity."""
        step = QUANTITIES[self.quantity].step
        return round(round(number / step) * step, 12) if step else number

    def value(self, number: float) -> float | str:
        """Return the value that the scenario gets for a number of the scan or of the bisection."""
        names = QUANTITIES[self.quantity].names
        return names[int(number)] if names else number

    def plan(self, values: Sequence[float | str]) -> SweepPlan:
        """Return the plan of all seeds at these values.

        Raises:
            InvalidScenario: no such scenario.
        """
        keys = QUANTITIES[self.quantity].keys
        study = Study(
            scenario=self.scenario,
            seeds=self.seeds,
            set=self.settings,
            axis=(
                ListAxis(kind="list", keys=keys, values=tuple(values)),
                ListAxis(kind="list", key="controller", values=(self.controller,)),
            ),
        )
        return SweepPlan(f"envelope of {self.quantity}", study)

    def check(self) -> None:
        """Check the settings without any run.

        Raises:
            InvalidStudy: the range, the tolerance or a value in the range is invalid.
        """
        self.plan([self.value(number) for number in self.scan_values()]).extent()


@dataclass(frozen=True, config=STRICT)
class Probe:
    """Outcome of the runs at one value."""

    value: float | str
    runs: Annotated[int, Field(ge=1)]
    failed: _Count
    lost: _Count
    cross_p95_m: tuple[float | None, ...]  # of each run; None where it has no error figure
    unmeasured: _Count = 0  # runs that completed without an error figure

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs fail."""
        return mostly_fails(self.failed, self.runs)


@dataclass(frozen=True, config=STRICT)
class Envelope:
    """Result of the search."""

    question: Question
    outcome: Literal["found", "holds", "fails"]  # the latter two: over the whole range
    monotone: bool  # failure sets in once over the tested values
    holds_at: float | str | None
    fails_at: float | str | None
    probes: Annotated[tuple[Probe, ...], Field(min_length=1)]  # by increasing value

    def __str__(self) -> str:
        question = self.question
        unit = QUANTITIES[question.quantity].unit
        subject = f"{question.controller} on {question.scenario}, {question.quantity} [{unit}]"
        tested = f"from {_text(self.probes[0].value)} to {_text(self.probes[-1].value)}"
        if self.outcome != "found":
            end = "hold" if self.outcome == "holds" else "fail"
            result = f"{self.outcome} {tested}: both ends {end}, there is nothing to bisect"
        else:
            result = f"holds at {_text(self.holds_at)}, fails at {_text(self.fails_at)}"
            if not self.monotone:
                result += f"; not monotone: failure comes and goes {tested}"
        unmeasured = sum(probe.unmeasured for probe in self.probes)
        note = unmeasured_text(unmeasured, question.limit_m).rstrip(".")
        return f"{subject}: {result}" + (f"; {note}" if note else "")


@dataclass(frozen=True, config=STRICT)
class EnvelopeFile:
    """Content of the JSON file of `ttempc envelope`."""

    versions: dict[str, str]
    envelopes: tuple[Envelope, ...]  # one per controller


def envelope(
    question: Question, engine: Engine, on_probe: Callable[[Probe], object] = lambda probe: None
) -> Envelope:
    """Search the value from which on a controller fails.

    Args:
        question: settings of the search.
        engine: executes the runs.
        on_probe: called with the outcome at every value.

    Raises:
        InvalidStudy: the settings are invalid; no run is made.
        SweepStopped: a run raised an error, which is no failure of the controller.
    """
    probes: dict[float, Probe] = {}

    def add(numbers: Sequence[float]) -> None:
        for number, probe in zip(numbers, drive_probes(question, numbers, engine), strict=True):
            probes[number] = probe
            on_probe(probe)

    add(question.scan_values())
    while (bracket := _bracket(probes)) and not _close(question, *bracket):
        add([_middle(question, *bracket)])
    ordered = [probes[number] for number in sorted(probes)]
    changes = sum(one.fails != other.fails for one, other in itertools.pairwise(ordered))
    if bracket is None:
        outcome = "fails" if ordered[0].fails else "holds"
        return Envelope(question, outcome, True, None, None, tuple(ordered))
    holds, fails = sorted((probes[number] for number in bracket), key=lambda probe: probe.fails)
    return Envelope(question, "found", changes == 1, holds.value, fails.value, tuple(ordered))


def drive_probes(question: Question, numbers: Sequence[float], engine: Engine) -> Iterator[Probe]:
    """Drive these values under all seeds; yield the outcome at each, in the given order.

    Raises:
        InvalidStudy: a value is invalid.
        SweepStopped: a run raised an error.
    """
    values = [question.value(number) for number in numbers]
    driven = drive_plan(question.plan(values), engine)
    for value, rows in zip(values, driven, strict=True):
        yield _probe(question, value, rows)


def _probe(question: Question, value: float | str, rows: Sequence[Row]) -> Probe:
    for row in rows:
        if row["status"] in ("failed", "crashed"):
            raise SweepStopped(
                f"{question.quantity} at {_text(value)}, {question.controller}, seed "
                f"{row['seed']}: {row['failure']}"
            )
    return Probe(
        value,
        runs=len(rows),
        failed=sum(has_failed(row, question.limit_m) for row in rows),
        lost=sum(row["status"] != "completed" for row in rows),
        cross_p95_m=tuple(cast("float | None", row[ERROR]) for row in rows),
        unmeasured=sum(map(is_unmeasured, rows)),
    )


def _bracket(probes: Mapping[float, Probe]) -> tuple[float, float] | None:
    """Return the first pair of neighbouring values of which one holds and one fails."""
    ordered = sorted(probes)
    return next(
        (
            (one, other)
            for one, other in itertools.pairwise(ordered)
            if probes[one].fails != probes[other].fails
        ),
        None,
    )


def _close(question: Question, one: float, other: float) -> bool:
    named = QUANTITIES[question.quantity].names
    return bool(named) or other - one <= question.tolerance * (1.0 + 1e-9)


def _middle(question: Question, one: float, other: float) -> float:
    logarithmic = QUANTITIES[question.quantity].spacing == "log"
    return question.snapped(math.sqrt(one * other) if logarithmic else 0.5 * (one + other))


def _text(value: float | str | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
