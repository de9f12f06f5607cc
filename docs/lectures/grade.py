"""Grade a controller of the lab sheet on fields and seeds that its author has not seen.

    python docs/lectures/grade.py mine:Mine --word LECTURERS_WORD

The seeds follow from the word, which the lecturer keeps: nobody can tune on them. It takes less
than a minute.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from dataclasses import dataclass

from proving_ground.experiments.errors import ExperimentError
from proving_ground.testbed.errors import TestbedError

from proving_ground import load, simulate
from ttempc.errors import TtempcError

PATH = "path={kind='headland', passes=2, length_m=10}"
SEEDS = 2


@dataclass(frozen=True)
class Task:
    """A field of the lab sheet."""

    field: str
    good_cm: float  # p95 of the trailer's cross-track error that earns all points
    poor_cm: float  # that earns none
    points: int


TASKS = (
    Task("grass", good_cm=2.0, poor_cm=8.0, points=3),
    Task("side-slope", good_cm=2.5, poor_cm=12.0, points=3),
    Task("wet-slope", good_cm=6.0, poor_cm=20.0, points=4),
)


def seeds_of(word: str, field: str) -> list[int]:
    """Return the seeds of a field, from 10000 to 99999."""
    digest = hashlib.sha256(f"{word}/{field}".encode()).digest()
    return [10000 + int.from_bytes(digest[4 * n : 4 * n + 4]) % 90000 for n in range(SEEDS)]


def error_cm(controller: str, field: str, seed: int) -> float | None:
    """Return the trailer's p95 across [cm], None where the run did not come home."""
    name, scenario = load(field, [PATH, f"controller.name={controller}"])
    summary, _ = simulate(name, scenario, seed)
    if summary.status != "completed":
        print(f"{field}: {summary.status}: {summary.failure}")
        return None
    return 100.0 * summary.tracking.all.trailer.cross_p95_m


def points_of(task: Task, errors_cm: list[float | None]) -> float:
    """Return the points of a task: by the mean error, none where a run did not come home."""
    known = [error for error in errors_cm if error is not None]
    if len(known) < len(errors_cm):
        return 0.0
    mean_cm = sum(known) / len(known)
    share = (task.poor_cm - mean_cm) / (task.poor_cm - task.good_cm)
    return task.points * min(max(share, 0.0), 1.0)


def main() -> int:
    """Drive, print a line for each field and the sum; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "controller", help="module:Class of the folder where you stand, or a name that ships"
    )
    parser.add_argument("--word", required=True, help="the lecturer's word")
    arguments = parser.parse_args()
    total = 0.0
    try:
        for task in TASKS:
            seeds = seeds_of(arguments.word, task.field)
            errors = [error_cm(arguments.controller, task.field, seed) for seed in seeds]
            points = points_of(task, errors)
            total += points
            shown = ", ".join("lost" if error is None else f"{error:.1f}" for error in errors)
            print(f"{task.field}: trailer p95 [cm] {shown}: {points:.1f} of {task.points} points")
    except (ExperimentError, TestbedError, TtempcError) as error:
        print(f"grade: {error}", file=sys.stderr)
        return 2
    print(f"sum: {total:.1f} of {sum(task.points for task in TASKS)} points")
    return 0


if __name__ == "__main__":
    sys.exit(main())
