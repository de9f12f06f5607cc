"""Worst cases of all shipped controllers, found by search.

    python -m experiments.studies.failures.worst_cases [BUDGET]      (default: 30 runs a search)

Prints the Markdown tables of docs/worst-cases.md. Each row is one `ttempc falsify`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ttempc.guidance.controllers import CONTROLLERS

from ...scenario.scenario import merge_tables, parse_overrides, read_scenario
from ...search.quantities import read_subject
from ...search.search import Report, Search
from ...seeds import report_seeds
from ...sweep.engine import engine
from ..batch import run_tasks


@dataclass(frozen=True, slots=True)
class Question:
    """What is searched for."""

    words: tuple[str, ...]  # of `ttempc falsify`
    limit_m: float | None = None  # of the trailer's 95 % cross-track error


SCENARIO: Final = "grass"
PATH: Final = "path={kind='headland', length_m=10.0, passes=2, width_m=14.0}"
SEEDS: Final = report_seeds(1)
BUDGET: Final = 30
LIMIT_M: Final = 0.3  # of the trailer's 95 % cross-track error, where a question has it
QUESTIONS: Final = {
    "Gust on the trailer": Question(("gust",)),
    "Soft patch on a slope": Question(("soil-patch", "slope", "terrain.uphill_deg=0:360:free")),
    "Late commands": Question(("late-commands",), LIMIT_M),
}
RARE: Final = ("ttempc", "pid")
RARE_WORDS: Final = ("gust", "faults.gust.force_n=10:3900")
SAMPLES: Final = 100


@dataclass(frozen=True)
class Task:
    """A search of the tables."""

    controller: str
    question: Question
    budget: int
    seed: int
    samples: int = 0  # per level, of the probability of failure; 0: none


def search(task: Task) -> Report:
    """Return the report of a search in this process."""
    settings = parse_overrides([PATH])
    merge_tables(settings, {"controller": {"name": task.controller}})
    question = task.question
    subject = read_subject(read_scenario(SCENARIO), SCENARIO, settings, question.words)
    with engine(workers=0) as here:
        found = Search(subject, here, task.seed, question.limit_m)
        found.falsify(task.budget)
        return found.report(found.probability(task.samples) if task.samples else None)


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
    rare = [name for name in RARE if name in controllers]
    tasks += [Task(name, Question(RARE_WORDS), 1, seed, SAMPLES) for name in rare]
    reports = iter(run_tasks(search, tasks, "searches"))
    for title, question in QUESTIONS.items():
        limit = f" --limit {question.limit_m:g}" if question.limit_m else ""
        print(f"**{title}**: `{' '.join(question.words)}{limit}`\n")
        _print_worst([next(reports) for _ in controllers])
    bounds = RARE_WORDS[1].partition("=")[2].replace(":", " to ")
    print(f"**Probability of failure** of gusts with bounds of {bounds} N\n")
    print("| controller | estimate | 95 % interval | runs |\n|---|---|---|---|")
    for name in rare:
        print(f"| `{name}` | {_probability(next(reports))} |")


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


def _probability(report: Report) -> str:
    found = report.probability
    if found is None:
        return "the nominal run fails | - | 1"
    interval = f"{found.low:.1g} to {found.high:.1g}"
    return f"{found.estimate or 0.0:.1g} | {interval} | {found.samples}"


if __name__ == "__main__":
    main(int((sys.argv[1:] or [str(BUDGET)])[0]))
