"""Sweep: execution of all runs of a plan that have no row yet."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path

from ..errors import SweepStopped
from .engine import Engine, imap_bounded, one_at_a_time
from .folder import SweepFolder
from .plan import SweepPlan
from .results import Results, rows, settle
from .row import Row
from .work import SweepJob, run_job


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a sweep."""

    done: int  # rows, those of earlier calls in the folder included
    runs: int
    row: Row  # the latest one


def sweep(
    plan: SweepPlan,
    folder: SweepFolder,
    engine: Engine,
    on_row: Callable[[Progress], object] = lambda progress: None,
    work: Callable[[SweepJob], Row] = run_job,
) -> None:
    """Drive the runs that have no row.

    Args:
        plan: of the sweep.
        folder: locked by this process.
        engine: executes the runs.
        on_row: called after a row is on the disk.
        work: makes the row of a run.

    Raises:
        SweepStopped: the disk is full, or the scheduler is gone; written rows remain.
    """
    folder.logs.mkdir(exist_ok=True)
    for partial in folder.logs.glob(".*"):  # of workers that were killed
        partial.unlink()
    with Results(folder.results, plan.size) as results:
        worst = WorstLogs(plan, folder)
        jobs = (sweep_job(plan, folder, run) for run in plan.runs() if not results.has(run))
        done = results.count
        for row in imap_rows(engine, jobs, work):
            worst.add(row)
            results.append(row)
            done += 1
            on_row(Progress(done, plan.run_count, row))
    settle(folder.results, worst.without_removed_log)


def sweep_job(plan: SweepPlan, folder: SweepFolder, run: int) -> SweepJob:
    """Return the job of a run, as it is sent to a worker."""
    planned = plan[run]
    setting, keep = planned.setting, plan.study.keep
    return SweepJob(
        run=run,
        point=planned.point,
        run_id=plan.identity(planned, folder.origin.versions),
        name=setting.name,
        scenario=setting.scenario,
        seed=planned.seed,
        axes=setting.axes,
        code=folder.origin.code,
        folder=folder.path.resolve(),
        keep="all" if keep == "worst" else keep,
    )


def imap_rows(
    engine: Engine, jobs: Iterable[SweepJob], work: Callable[[SweepJob], Row] = run_job
) -> Iterator[Row]:
    """Yield the row of every job as it completes.

    If a worker dies, Dask repeats its runs on another. A run that kills its workers can also take
    down runs beside it; each suspect is therefore repeated alone before its row says crashed.

    Raises:
        SweepStopped: the scheduler is gone, or a worker cannot continue.
    """
    suspects = []
    for job, future in imap_bounded(engine, work, jobs):
        try:
            yield future.result()
        except engine.worker_died:
            suspects.append(job)
        except CancelledError:
            raise SweepStopped("the scheduler is gone") from None
    for job, future in imap_bounded(one_at_a_time(engine), work, suspects):
        try:
            row = future.result()
        except engine.worker_died:
            row = job.crashed()
        except CancelledError:
            raise SweepStopped("the scheduler is gone") from None
        yield {**row, "attempts": 2}


class WorstLogs:
    """Retention of the logs of the worst runs, with `keep = "worst"`; other logs are removed."""

    def __init__(self, plan: SweepPlan, folder: SweepFolder) -> None:
        self._count = plan.study.worst if plan.study.keep == "worst" else 0
        self._by, self._folder = plan.study.worst_by, folder
        self._worst: list[tuple[bool, float, int, str]] = []
        if self._count and folder.results.exists():
            for row in rows(folder.results):
                self.add(row)

    def add(self, row: Row) -> None:
        """Take a row in; of one log too many, remove that of the best run."""
        if not self._count or not row["log"]:
            return
        figure, run = row[self._by], row["run"]
        assert isinstance(run, int)
        severity = float(figure) if isinstance(figure, float) else float("-inf")
        entry = (row["status"] != "completed", severity, run, str(row["log"]))
        heapq.heappush(self._worst, entry)
        if len(self._worst) > self._count:
            best = heapq.heappop(self._worst)
            self._log(best[-1]).unlink(missing_ok=True)

    def without_removed_log(self, row: Row) -> Row:
        """Return the row, without the name of its log if that was removed."""
        kept = not row["log"] or self._log(str(row["log"])).exists()
        return row if kept else {**row, "log": ""}

    def _log(self, name: str) -> Path:
        return self._folder.path / name
