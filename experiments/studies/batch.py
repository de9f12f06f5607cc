"""Parallel runs of a study on the engine of the sweeps, with results in memory."""

from __future__ import annotations

import contextlib
import hashlib
import pickle
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from tqdm import tqdm

from ttempc.guidance.guidance import ControllerFactory

from ..results.published import compare
from ..results.summary import Summary
from ..run.simulate import simulate
from ..scenario.path import FigureEight
from ..scenario.scenario import Scenario, load
from ..sweep.engine import Engine, engine, imap_bounded

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class BatchSettings:
    """Where tasks are computed and kept."""

    workers: int | None = None  # processes; None: one per core, 0: this process
    results: Path | None = None  # file of finished tasks, which are not computed again


_SETTINGS: Final[ContextVar[BatchSettings | None]] = ContextVar("batch settings", default=None)


@contextlib.contextmanager
def batch_settings(settings: BatchSettings) -> Iterator[None]:
    """Compute and keep the tasks of this block as the settings say."""
    token = _SETTINGS.set(settings)
    try:
        yield
    finally:
        _SETTINGS.reset(token)


@contextlib.contextmanager
def started_workers() -> Iterator[Engine]:
    """Start workers for several batches, as the settings of the block say."""
    with engine((_SETTINGS.get() or BatchSettings()).workers) as workers:
        yield workers


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
    settings = _SETTINGS.get() or BatchSettings()
    keys = [_key(function, task) for task in tasks] if settings.results else []
    kept = _read(settings.results) if settings.results else {}
    waiting: dict[int, Result] = {n: kept[key] for n, key in enumerate(keys) if key in kept}
    missing = [(n, task) for n, task in enumerate(tasks) if n not in waiting]
    due = 0
    with contextlib.ExitStack() as stack:
        bar = stack.enter_context(tqdm(total=len(tasks), initial=len(waiting), desc=label or None))
        finished = iter(())
        if missing:
            workers = started or stack.enter_context(engine(settings.workers))
            finished = imap_bounded(workers, partial(_apply, function), missing)
        while due < len(tasks):
            if due in waiting:
                yield waiting.pop(due)
                due += 1
                continue
            (number, _), future = next(finished)
            waiting[number] = future.result()
            if settings.results:
                _append(settings.results, keys[number], waiting[number])
            bar.update()


def simulate_runs(runs: Sequence[StudyRun]) -> list[Summary]:
    """Return the summaries of runs in the order of the runs, computed on all cores."""
    return list(run_tasks(simulate_run, runs))


def mean_errors_cm(summary: Summary) -> list[float]:
    """Return the four mean Euclidean errors of the paper's table [cm], NaN where there is none."""
    measured = (item.measured_m for item in compare(summary))
    return [float("nan") if error is None else 100.0 * error for error in measured]


def one_lap(scenario: Scenario) -> Scenario:
    """Return a scenario with one lap of its path, if that has laps."""
    if not isinstance(scenario.path, FigureEight):
        return scenario
    return replace(scenario, path=replace(scenario.path, laps=1))


def lost_count(runs: Sequence[Summary]) -> int:
    """Return the number of runs that did not complete."""
    return sum(run.status != "completed" for run in runs)


def _key(function: Callable[..., Any], task: object) -> str:
    """Return a name of a task that is the same in every process."""
    return hashlib.sha256(pickle.dumps((function, task))).hexdigest()


def _read(file: Path) -> dict[str, Any]:
    """Return the kept results, without a torn last one."""
    results: dict[str, Any] = {}
    whole = 0
    if not file.exists():
        return results
    with file.open("rb") as stream, contextlib.suppress(EOFError, pickle.UnpicklingError):
        while True:
            whole = stream.tell()
            key, result = pickle.load(stream)
            results[key] = result
    with file.open("rb+") as stream:
        stream.truncate(whole)
    return results


def _append(file: Path, key: str, result: object) -> None:
    with file.open("ab") as stream:
        stream.write(pickle.dumps((key, result)))


def _apply(function: Callable[[Task], Result], numbered: tuple[int, Task]) -> Result:
    return function(numbered[1])


def simulate_run(run: StudyRun) -> Summary:
    """Return the summary of a run."""
    return simulate(*load(run.scenario, run.overrides), run.seed, run.factory)[0]
