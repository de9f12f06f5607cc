"""Limit of one quantity: the value above or below which a controller fails.

A scan over the whole range, ends included, finds a bracket and shows whether failure is monotone.
Bisection then narrows the bracket down to the tolerance. Every value is driven under every seed.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from ...testbed.recording.provenance import versions
from ..errors import InvalidStudy, SweepStopped
from ..output import create_partial, write_file
from ..scenario.scenario import ScenarioFile
from ..sweep.engine import Engine
from ..sweep.plan import SweepPlan
from ..sweep.row import Row, has_failed, mostly_fails, unmeasured_text, working_error
from ..sweep.study import ListAxis, Study
from ..sweep.sweep import drive_plan
from .quantities import FAULTS, Parameter, read_quantity

_SHARE: Final = 1.0 / 40.0  # of the range: tolerance of a quantity without one


@dataclass(frozen=True)
class Question:
    """Settings of the search: controller, scenario, quantity, range and criterion of failure."""

    scenario: str
    controller: str
    quantity: str  # its name, or its key
    parameter: Parameter
    tolerance: float  # between the value that holds and the value that fails
    limit_m: float | None  # on the 95 % cross-track error; None: completed runs hold
    seeds: tuple[int, ...]
    scan: int = 5  # values over the range before bisection, ends included
    settings: dict[str, Any] = field(default_factory=dict)  # override keys of the scenario

    @classmethod
    def of(
        cls,
        draft: ScenarioFile,
        scenario: str,
        settings: dict[str, Any],
        word: str,
        *,
        seeds: tuple[int, ...],
        limit_m: float | None = None,
        tolerance: float | None = None,
    ) -> Question:
        """Return the question of a command line; `settings` may name the controller.

        Raises:
            InvalidStudy: there is no such quantity.
            InvalidScenario: the settings are invalid.
        """
        if word in FAULTS:
            raise InvalidStudy(
                f"quantity {word!r}: is of `search worst`; for a limit put the fault into the "
                "scenario and give KEY=LOW:HIGH, such as faults.gust.force_n=100:4000"
            )
        parameter, _ = read_quantity(word)
        default = parameter.tolerance or _SHARE * (parameter.high - parameter.low)
        controller = draft.scenario(settings, "--set").controller.name
        name = word.partition("=")[0]
        width = default if tolerance is None else tolerance
        return cls(scenario, controller, name, parameter, width, limit_m, seeds, settings=settings)

    def scan_numbers(self) -> list[float]:
        """Return the values of the scan; those of a named quantity are the indices of its names.

        Raises:
            InvalidStudy: the tolerance is below the step of the quantity.
        """
        parameter = self.parameter
        if parameter.names:
            return [float(number) for number in range(len(parameter.names))]
        if self.tolerance < parameter.step:
            raise InvalidStudy(
                f"tolerance must be at least {parameter.step:g}, the step of {self.quantity}, "
                f"got {self.tolerance:g}"
            )
        return sorted({parameter.number(p) for p in np.linspace(0.0, 1.0, self.scan).tolist()})

    def plan(self, numbers: Sequence[float]) -> SweepPlan:
        """Return the plan of all seeds at these values.

        Raises:
            InvalidScenario: no such scenario.
        """
        values = tuple(map(self.parameter.named, numbers))
        axes = (
            ListAxis(kind="list", keys=self.parameter.keys, values=values),
            ListAxis(kind="list", key="controller", values=(self.controller,)),
        )
        study = Study(scenario=self.scenario, seeds=self.seeds, set=self.settings, axis=axes)
        return SweepPlan(f"limit of {self.quantity}", study)

    def check(self) -> None:
        """Check the settings without any run.

        Raises:
            InvalidStudy: the tolerance or a value in the range is invalid.
        """
        self.plan(self.scan_numbers()).extent()


@dataclass(frozen=True)
class Probe:
    """Outcome of the runs at one value."""

    value: float | str
    runs: int
    failed: int
    cross_p95_m: tuple[float | None, ...]  # `working_error` of each run

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs fail."""
        return mostly_fails(self.failed, self.runs)


@dataclass(frozen=True)
class Limit:
    """Result of the search."""

    question: Question
    outcome: Literal["found", "holds", "fails"]  # the latter two: over the whole range
    monotone: bool  # failure sets in once over the tested values
    holds_at: float | str | None
    fails_at: float | str | None
    probes: tuple[Probe, ...]  # by increasing value

    def __str__(self) -> str:
        question = self.question
        tested = f"from {_text(self.probes[0].value)} to {_text(self.probes[-1].value)}"
        if self.outcome != "found":
            end = "hold" if self.outcome == "holds" else "fail"
            result = f"{self.outcome} {tested}: both ends {end}, there is nothing to bisect"
        else:
            result = f"holds at {_text(self.holds_at)}, fails at {_text(self.fails_at)}"
            if not self.monotone:
                result += f"; not monotone: failure comes and goes {tested}"
        holding = [probe for probe in self.probes if not probe.failed]
        unmeasured = sum(probe.cross_p95_m.count(None) for probe in holding)
        note = unmeasured_text(unmeasured, question.limit_m).rstrip(".")
        unit = f" [{question.parameter.unit}]" if question.parameter.unit else ""
        subject = f"{question.controller} on {question.scenario}, {question.quantity}{unit}"
        return f"{subject}: {result}" + (f"; {note}" if note else "")


def limit_file(
    questions: Sequence[Question],
    engine: Engine,
    file: Path,
    show: Callable[[Limit], object] | None = None,
) -> str:
    """Answer questions and write the file; return its text. The partial file has those answered.

    Raises:
        OutputExists, InvalidStudy, SweepStopped: as `create_partial` and `find_limit`.
    """
    partial, answers, text = create_partial(file), [], ""
    for question in questions:
        answers.append(find_limit(question, engine))
        if show:
            show(answers[-1])
        content = {"versions": versions(), "limits": list(map(asdict, answers))}
        text = json.dumps(content, indent=2, allow_nan=False) + "\n"
        write_file(partial, text)
    partial.rename(file)
    return text


def find_limit(question: Question, engine: Engine) -> Limit:
    """Search the value from which on a controller fails.

    Raises:
        InvalidStudy: the settings are invalid; no run is made.
        SweepStopped: a run raised an error, which is no failure of the controller.
    """
    probes: dict[float, Probe] = {}
    parameter = question.parameter

    def drive(numbers: Sequence[float]) -> None:
        driven = drive_plan(question.plan(numbers), engine)
        for number, rows in zip(numbers, driven, strict=True):
            probes[number] = _probe(question, parameter.named(number), rows)

    def bracket() -> tuple[float, float] | None:
        """First pair of neighbouring values of which one holds and one fails."""
        pairs = itertools.pairwise(sorted(probes))
        return next((p for p in pairs if probes[p[0]].fails != probes[p[1]].fails), None)

    drive(question.scan_numbers())
    while (found := bracket()) and not parameter.names:
        if found[1] - found[0] <= question.tolerance * (1.0 + 1e-9):
            break
        drive([parameter.number(0.5 * sum(map(parameter.position, found)))])
    ordered = tuple(probes[number] for number in sorted(probes))
    if found is None:
        outcome = "fails" if ordered[0].fails else "holds"
        return Limit(question, outcome, True, None, None, ordered)
    changes = sum(one.fails != other.fails for one, other in itertools.pairwise(ordered))
    holds, fails = sorted((probes[number] for number in found), key=lambda probe: probe.fails)
    return Limit(question, "found", changes == 1, holds.value, fails.value, ordered)


def _probe(question: Question, value: float | str, rows: Sequence[Row]) -> Probe:
    for row in rows:
        if row["status"] in ("failed", "crashed"):
            raise SweepStopped(
                f"{question.quantity} at {_text(value)}, {question.controller}, seed "
                f"{row['seed']}: {row['failure']}"
            )
    failed = sum(has_failed(row, question.limit_m) for row in rows)
    return Probe(value, len(rows), failed, tuple(map(working_error, rows)))


def _text(value: float | str | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
