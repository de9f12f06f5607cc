"""Worst cases of all shipped controllers, found by search.

    python -m experiments.studies.failures.worst_cases [BUDGET]      (default: 30 runs a search)

Prints the Markdown tables of docs/worst-cases.md. Each row is one `ttempc search worst`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ttempc.guidance.controllers import CONTROLLERS

from ...scenario.scenario import merge_tables, parse_overrides, read_scenario
from ...search.quantities import read_subject
from ...search.worst_case import Report, Search
from ...seeds import report_seeds
from ...sweep.engine import engine
from ..batch import run_tasks


@dataclass(frozen=True, slots=True)
class Question:
    """What is searched for."""

    words: tuple[str, ...]  # of `ttempc search worst`
    limit_m: float | None = None  # of the trailer's 95 % cross-track error


SCENARIO: Final = "grass"
PATH: Final = "path={kind='headland', length_m=10.0, passes=2, width_m=14.0}"
SEEDS: Final = report_seeds(1)
BUDGET: Final = 30
LIMIT_M: Final = 0.3  # of the trailer's 95 % cross-track error, where a question has it
QUESTIONS: Final = {
    "Gust on the trailer": Question(("gust",)),
    "Soft patch on a slope": Question(("soil_patch", "slope", "terrain.uphill_deg=0:360:free")),
    "Late commands": Question(("commands_late",), LIMIT_M),
}


@dataclass(frozen=True)
class Task:
    """A search of the tables."""

    controller: str
    question: Question
    budget: int
    seed: int


def search(task: Task) -> Report:
    """Return the report of a search in this process."""
    settings = parse_overrides([PATH])
    merge_tables(settings, {"controller": {"name": task.controller}})
    question = task.question
    subject = read_subject(read_scenario(SCENARIO), SCENARIO, settings, question.words)
    with engine(workers=0) as here:
        found = Search(subject, here, task.seed, question.limit_m)
        found.falsify(task.budget)
        return found.report()


def main(
    budget: int = BUDGET,
    seeds: tuple[int, ...] = SEEDS,
    controllers: Sequence[str] = tuple(CONTROLLERS),
) -> None:
    """Make all searches under the first of the seeds and print the tables."""
    seed = seeds[0]
    tasks = [
        Task(name, question, budget, seed)
        for question in QUESTIONS.values()
        for name in controllers
    ]
    reports = iter(run_tasks(search, tasks, "searches"))
    for title, question in QUESTIONS.items():
        limit = f" --limit {question.limit_m:g}" if question.limit_m else ""
        print(f"**{title}**: `{' '.join(question.words)}{limit}`\n")
        _print_worst([next(reports) for _ in controllers])


def _print_worst(reports: Sequence[Report]) -> None:
    keys = [key.rpartition(".")[2] for key in reports[0].cases[0].values]
    print(f"| controller | failed | severity | {' | '.join(f'`{k}`' for k in keys)} | end |")
    print("|---" * (4 + len(keys)) + "|")
    for report in reports:
        worst = report.cases[0]
        failed = f"{report.failed} of {report.runs}"
        severity = f"{worst.severity:.2f}" if worst.failure else "-"
        end = worst.failure or f"holds; least robustness {worst.robustness:.2f}"
        print(
            f"| `{report.controller}` | {failed} | {severity} | {_values(worst.values)} | {end} |"
        )
    print()


def _values(values: Mapping[str, object]) -> str:
    return " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in values.values())


if __name__ == "__main__":
    main(int((sys.argv[1:] or [str(BUDGET)])[0]))
