"""A sweep: the runs of a plan that have no row yet, each to its row, whatever happens to it."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path

from ..errors import SweepStopped
from .engine import Engine, alone, flow
from .folder import Folder
from .plan import Plan
from .results import Results, rows, settle
from .row import Row
from .work import Job, work


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a sweep is."""

    done: int  # rows, those of earlier sweeps in the folder included
    runs: int
    row: Row  # the latest


def sweep(
    plan: Plan,
    folder: Folder,
    engine: Engine,
    on_row: Callable[[Progress], object] = lambda progress: None,
    work: Callable[[Job], Row] = work,
) -> None:
    """Drive what has not been driven.

    Args:
        plan: of the sweep.
        folder: held by this process.
        engine: carries the runs out.
        on_row: is told of every row when it is on the disk.
        work: makes the row of a run.

    Raises:
        SweepStopped: the disk is full, or the scheduler is gone; rows that are there stay.
    """
    folder.logs.mkdir(exist_ok=True)
    for torn in folder.logs.glob(".*"):  # of workers that were killed
        torn.unlink()
    with Results(folder.results, plan.size) as results:
        keeper = _Keeper(plan, folder)
        jobs = (job(plan, folder, run) for run in range(plan.size) if not results.has(run))
        done = results.count
        for row in driven(engine, jobs, work):
            keeper.weigh(row)
            results.append(row)
            done += 1
            on_row(Progress(done, plan.size, row))
    settle(folder.results, keeper.corrected)


def job(plan: Plan, folder: Folder, run: int) -> Job:
    """Return a run of the plan as it is sent to a worker."""
    planned = plan[run]
    setting, keep = planned.setting, plan.study.keep
    return Job(
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


def driven(engine: Engine, jobs: Iterable[Job], work: Callable[[Job], Row] = work) -> Iterator[Row]:
    """Yield the row of every job as it is done.

    Where a worker dies, Dask gives its runs to another. One run that kills its workers takes the
    runs beside it along, so that none is blamed before it has died once more alone.

    Raises:
        SweepStopped: the scheduler is gone, or a worker cannot go on.
    """
    suspects = []
    for job, future in flow(engine, work, jobs):
        try:
            yield future.result()
        except engine.died:
            suspects.append(job)
        except CancelledError:
            raise SweepStopped("the scheduler is gone") from None
    for job, future in flow(alone(engine), work, suspects):
        try:
            row = future.result()
        except engine.died:
            row = job.crashed()
        except CancelledError:
            raise SweepStopped("the scheduler is gone") from None
        yield {**row, "attempts": 2}


class _Keeper:
    """Keeps the logs of the worst runs alone, where the study asks for these."""

    def __init__(self, plan: Plan, folder: Folder) -> None:
        self._count = plan.study.worst if plan.study.keep == "worst" else 0
        self._by, self._folder = plan.study.worst_by, folder
        self._worst: list[tuple[bool, float, int, str]] = []
        if self._count and folder.results.exists():
            for row in rows(folder.results):
                self.weigh(row)

    def weigh(self, row: Row) -> None:
        """Let a row in, and the log of the best one out."""
        if not self._count or not row["log"]:
            return
        figure, run = row[self._by], row["run"]
        assert isinstance(run, int)
        badness = float(figure) if isinstance(figure, float) else float("-inf")
        entry = (row["status"] != "completed", badness, run, str(row["log"]))
        heapq.heappush(self._worst, entry)
        if len(self._worst) > self._count:
            best = heapq.heappop(self._worst)
            self._log(best[-1]).unlink(missing_ok=True)

    def corrected(self, row: Row) -> Row:
        """Return the row without the name of a log that was not kept."""
        kept = not row["log"] or self._log(str(row["log"])).exists()
        return row if kept else {**row, "log": ""}

    def _log(self, name: str) -> Path:
        return self._folder.path / name
