"""Parallel runs of a study on the engine of the sweeps, with results in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from tqdm import tqdm

from ttempc.guidance.guidance import ControllerFactory

from ..results.published import compare
from ..results.summary import Summary
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..sweep.engine import Engine, engine, imap_bounded

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class StudyRun:
    """A run of a study."""

    scenario: str
    seed: int
    overrides: tuple[str, ...] = ()
    factory: ControllerFactory | None = None  # None: the controller that the scenario names


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    label: str = "",
    started: Engine | None = None,
) -> Iterator[Result]:
    """Yield the result of every task in the order of the tasks, computed on all cores.

    Args:
        function: executed in a worker process; what it raises is raised here.
        tasks: its arguments, picklable.
        label: of the progress bar.
        started: the workers, if they run already.
    """
    waiting: dict[int, Result] = {}
    due = 0
    of_call = nullcontext(started) if started else engine()
    with of_call as workers, tqdm(total=len(tasks), desc=label or None) as bar:
        numbered = enumerate(tasks)
        for (number, _), future in imap_bounded(workers, partial(_apply, function), numbered):
            waiting[number] = future.result()
            bar.update()
            while due in waiting:
                yield waiting.pop(due)
                due += 1


def simulate_runs(runs: Sequence[StudyRun]) -> list[Summary]:
    """Return the summaries of runs in the order of the runs, computed on all cores."""
    return list(run_tasks(simulate_run, runs))


def mean_errors_cm(summary: Summary) -> list[float]:
    """Return the four mean Euclidean errors of the paper's table [cm], NaN where there is none."""
    measured = (item.measured_m for item in compare(summary))
    return [float("nan") if error is None else 100.0 * error for error in measured]


def lost_count(runs: Sequence[Summary]) -> int:
    """Return the number of runs that did not complete."""
    return sum(run.status != "completed" for run in runs)


def _apply(function: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return function(numbered[1])


def simulate_run(run: StudyRun) -> Summary:
    """Return the summary of a run."""
    return simulate(*load(run.scenario, run.overrides), run.seed, run.factory)[0]
