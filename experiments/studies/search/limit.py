"""Limit of one quantity: the value above or below which a controller fails.

A scan over the whole range, ends included, finds a bracket and shows whether failure is monotone.
Bisection then narrows the bracket down to the tolerance. Every value is driven under every seed.
"""

import itertools
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ....testbed.recording.provenance import versions
from ...errors import InvalidStudy, SweepStopped
from ...output import write_file
from ...scenario.scenario import ScenarioFile
from ..sweep.engine import Engine
from ..sweep.plan import SweepPlan
from ..sweep.row import has_failed, mostly_fails, working_error
from ..sweep.study import ListAxis, Study
from ..sweep.sweep import drive_plan
from .quantities import Parameter, read_quantity


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

    def scan_numbers(self) -> list[float]:
        """Return the values of the scan; a named quantity has the indices of its names.

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


def read_question(
    draft: ScenarioFile,
    scenario: str,
    settings: dict[str, Any],
    word: str,
    seeds: tuple[int, ...],
    limit_m: float | None = None,
) -> Question:
    """Return the question of a command line, checked without a run.

    Raises:
        InvalidStudy: there is no such quantity, or a value in the range is invalid.
        InvalidScenario: the settings are invalid.
    """
    parameter, _ = read_quantity(word)
    width = parameter.tolerance or (parameter.high - parameter.low) / 40.0
    controller = draft.scenario(settings, "--set").controller.name
    name = word.partition("=")[0]
    question = Question(
        scenario, controller, name, parameter, width, limit_m, seeds, settings=settings
    )
    question.plan(question.scan_numbers()).extent()
    return question


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
    probes: tuple[Probe, ...]  # ordered by increasing value

    def __str__(self) -> str:
        question = self.question
        tested = f"from {_text(self.probes[0].value)} to {_text(self.probes[-1].value)}"
        result = f"holds at {_text(self.holds_at)}, fails at {_text(self.fails_at)}"
        if self.outcome != "found":
            result = f"{self.outcome} {tested}, nothing to bisect"
        elif not self.monotone:
            result += f"; not monotone: failure comes and goes {tested}"
        if question.limit_m and any(None in p.cross_p95_m for p in self.probes if not p.failed):
            result += "; runs without an error figure, to which the limit does not apply"
        unit = f" [{question.parameter.unit}]" if question.parameter.unit else ""
        return f"{question.controller} on {question.scenario}, {question.quantity}{unit}: {result}"


def limit_file(
    questions: Sequence[Question], engine: Engine, file: Path, show: Callable[[Limit], object]
) -> None:
    """Answer questions, and write the answers so far after each of them.

    Raises:
        OutputExists, InvalidStudy, SweepStopped: as `write_file` and `find_limit`.
    """
    answers = []
    for question in questions:
        answers.append(find_limit(question, engine))
        show(answers[-1])
        content = {"versions": versions(), "limits": list(map(asdict, answers))}
        write_file(file, json.dumps(content, indent=2, allow_nan=False) + "\n")


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
            value = parameter.named(number)
            for row in rows:
                if row["status"] in ("failed", "crashed"):
                    raise SweepStopped(
                        f"{question.quantity} at {_text(value)}, {question.controller}, seed "
                        f"{row['seed']}: {row['failure']}"
                    )
            failed = sum(has_failed(row, question.limit_m) for row in rows)
            probes[number] = Probe(value, len(rows), failed, tuple(map(working_error, rows)))

    def brackets() -> list[tuple[float, float]]:
        """Pairs of neighbouring values of which one holds and one fails."""
        pairs = itertools.pairwise(sorted(probes))
        return [pair for pair in pairs if probes[pair[0]].fails != probes[pair[1]].fails]

    drive(question.scan_numbers())
    while (found := brackets()) and not parameter.names:
        low, high = found[0]
        if high - low <= question.tolerance * (1.0 + 1e-9):
            break
        drive([parameter.number(0.5 * (parameter.position(low) + parameter.position(high)))])
    ordered = tuple(probes[number] for number in sorted(probes))
    if not found:
        outcome = "fails" if ordered[0].fails else "holds"
        return Limit(question, outcome, True, None, None, ordered)
    holds, fails = sorted((probes[number] for number in found[0]), key=lambda probe: probe.fails)
    return Limit(question, "found", len(found) == 1, holds.value, fails.value, ordered)


def _text(value: float | str | None) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
