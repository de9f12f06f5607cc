"""The breaking point of a controller: the value of one quantity from which on it fails.

A scan over the whole range comes first, its ends included: it says whether there is a bracket at
all, and whether failure sets in once or comes and goes. Between the last value that holds and the
first that fails bisection goes on to the tolerance. Every value is driven under every seed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, cast

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT

from ..errors import InvalidStudy, SweepStopped
from .engine import Engine
from .folder import Folder, Origin
from .plan import Plan
from .row import Row
from .study import ListAxis, Study
from .sweep import driven, job

ERROR: Final = "tracking.all.trailer.cross_p95_m"
_Count = Annotated[int, Field(ge=0)]


@dataclass(frozen=True, config=STRICT)
class Quantity:
    """What may be made harder and harder, and over which range by default."""

    keys: tuple[str, ...]
    unit: str
    low: float
    high: float
    spacing: Literal["linear", "log"] = "linear"
    names: tuple[str, ...] = ()  # in place of a range
    step: float = 0.0  # of which all values are whole multiples; 0: any value can be


QUANTITIES: Final[Mapping[str, Quantity]] = MappingProxyType(
    {
        "cone-index": Quantity(("soil.cone_index_kpa",), "kPa", 100.0, 2000.0, "log"),
        "slope": Quantity(("terrain.slope_rad",), "rad", 0.0, 0.4),
        "speed": Quantity(("path.speed_mps",), "m/s", 0.4, 1.35),
        "delay": Quantity(
            tuple(f"actuators.{name}.dead_time_s" for name in ("front", "trailer", "hydrostat")),
            *("s", 0.0, 1.0),
            step=0.01,  # a dead time is a whole number of physics steps
        ),
        "roughness": Quantity(("terrain.iso_class",), "ISO 8608", 0.0, 5.0, names=tuple("ABCDEF")),
    }
)


def mostly(failed: int, runs: int) -> bool:
    """Return whether at least half of the runs fail, which counts as failing at a value."""
    return 2 * failed >= runs


@dataclass(frozen=True, config=STRICT)
class Question:
    """What is asked of a controller."""

    scenario: str
    controller: str
    quantity: str  # one of `QUANTITIES`
    low: float
    high: float
    tolerance: float  # between the values that hold and fail
    limit_m: float | None  # on the trailer's 95 % cross-track error; None: only lost counts
    seeds: tuple[int, ...]
    scan: int = 5  # values over the range before bisection, ends included
    settings: dict[str, Any] = Field(default_factory=dict)  # laid over the scenario

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(
                f"quantity must be one of {', '.join(QUANTITIES)}, got {self.quantity!r}"
            )

    def first_look(self) -> list[float]:
        """Return values over the whole range; those of a named quantity are its numbers.

        Raises:
            InvalidStudy: the range or the tolerance cannot be.
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
        between = (self.snapped(place) for place in space(low, high, self.scan)[1:-1].tolist())
        return sorted({low, *between, high})

    def snapped(self, place: float) -> float:
        """Return the nearest value that the quantity may have."""
        step = QUANTITIES[self.quantity].step
        return round(round(place / step) * step, 12) if step else place

    def value(self, place: float) -> float | str:
        """Return what the scenario has for a value of `first_look`, or one between two."""
        names = QUANTITIES[self.quantity].names
        return names[int(place)] if names else place

    def plan(self, values: Sequence[float | str]) -> Plan:
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
        return Plan(f"envelope of {self.quantity}", study)

    def check(self) -> None:
        """Refuse what cannot be asked, before any run.

        Raises:
            InvalidStudy: the range, the tolerance or a value in the range cannot be.
        """
        self.plan([self.value(place) for place in self.first_look()]).extent()


@dataclass(frozen=True, config=STRICT)
class Probe:
    """What happened at one value."""

    value: float | str
    runs: Annotated[int, Field(ge=1)]
    failed: _Count
    lost: _Count
    cross_p95_m: tuple[float | None, ...]

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs fail."""
        return mostly(self.failed, self.runs)


@dataclass(frozen=True, config=STRICT)
class Envelope:
    """The answer."""

    question: Question
    outcome: Literal["found", "holds", "fails"]  # throughout, the latter two
    monotone: bool  # failure sets in once over the values that were tried
    holds_at: float | str | None
    fails_at: float | str | None
    probes: Annotated[tuple[Probe, ...], Field(min_length=1)]  # in the order of the values

    def __str__(self) -> str:
        asked = self.question
        quantity = QUANTITIES[asked.quantity]
        what = f"{asked.controller} on {asked.scenario}, {asked.quantity} [{quantity.unit}]"
        tried = f"from {_text(self.probes[0].value)} to {_text(self.probes[-1].value)}"
        if self.outcome != "found":
            end = "hold" if self.outcome == "holds" else "fail"
            return f"{what}: {self.outcome} {tried}: both ends {end}, there is nothing to bisect"
        comes_and_goes = "" if self.monotone else f"; not monotone: failure comes and goes {tried}"
        return (
            f"{what}: holds at {_text(self.holds_at)}, fails at {_text(self.fails_at)}"
            f"{comes_and_goes}"
        )


@dataclass(frozen=True, config=STRICT)
class EnvelopeFile:
    """What `ttempc envelope` writes, as JSON."""

    versions: dict[str, str]
    envelopes: tuple[Envelope, ...]  # of a controller each


def envelope(
    question: Question, engine: Engine, on_probe: Callable[[Probe], object] = lambda probe: None
) -> Envelope:
    """Find where a controller fails.

    Args:
        question: what is asked.
        engine: carries the runs out.
        on_probe: is told of every value as it is done.

    Raises:
        InvalidStudy: the question cannot be asked; no run is made.
        SweepStopped: a run raised an error, which says nothing of the controller.
    """
    places = question.first_look()
    probes: dict[float, Probe] = {}

    def probe(wanted: Sequence[float]) -> None:
        for place, found in zip(wanted, probed(question, wanted, engine), strict=True):
            probes[place] = found
            on_probe(found)

    probe(places)
    while (bracket := _bracket(probes)) and not _close(question, *bracket):
        probe([_middle(question, *bracket)])
    ordered = [probes[place] for place in sorted(probes)]
    changes = sum(one.fails != other.fails for one, other in itertools.pairwise(ordered))
    if bracket is None:
        outcome = "fails" if ordered[0].fails else "holds"
        return Envelope(question, outcome, True, None, None, tuple(ordered))
    holds, fails = sorted((probes[place] for place in bracket), key=lambda probe: probe.fails)
    return Envelope(question, "found", changes == 1, holds.value, fails.value, tuple(ordered))


def probed(question: Question, places: Sequence[float], engine: Engine) -> Iterator[Probe]:
    """Drive all seeds of these values; return a probe each, in their order.

    Raises:
        InvalidStudy: a value cannot be.
        SweepStopped: a run raised an error.
    """
    values = [question.value(place) for place in places]
    plan = question.plan(values)
    folder = Folder(Path(), Origin.here(plan.extent().digest, plan.size))
    rows = driven(engine, (job(plan, folder, run) for run in range(plan.size)))
    ordered = sorted(rows, key=lambda row: cast(int, row["run"]))
    repeats = len(question.seeds)
    for number, value in enumerate(values):
        yield _judged(question, value, ordered[number * repeats : (number + 1) * repeats])


def _judged(question: Question, value: float | str, rows: Sequence[Row]) -> Probe:
    for row in rows:
        if row["status"] in ("failed", "crashed"):
            raise SweepStopped(
                f"{question.quantity} at {_text(value)}, {question.controller}, seed "
                f"{row['seed']}: {row['failure']}"
            )
    errors = tuple(cast("float | None", row[ERROR]) for row in rows)
    lost = [row["status"] != "completed" for row in rows]
    limit = math.inf if question.limit_m is None else question.limit_m
    failed = [
        gone or (limit < math.inf and (error is None or error > limit))
        for gone, error in zip(lost, errors, strict=True)
    ]
    return Probe(value, len(rows), sum(failed), sum(lost), errors)


def _bracket(probes: Mapping[float, Probe]) -> tuple[float, float] | None:
    """Return the first two neighbours of which one holds and one fails."""
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
