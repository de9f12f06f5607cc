"""Sweep: execution of all runs of a plan that have no row yet."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...errors import InvalidStudy, SweepStopped
from .engine import Engine, imap_bounded
from .folder import Origin, SweepFolder, lock_folder
from .merge import WHOLE, Shard
from .plan import SweepPlan
from .results import Results, rows
from .row import Row
from .study import ListAxis, Scalar, Study
from .work import SweepJob, run_job


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a sweep."""

    done: int  # rows, those of earlier calls in the folder included
    runs: int
    row: Row  # row that was written last


def sweep(
    plan: SweepPlan,
    folder: SweepFolder,
    engine: Engine,
    on_row: Callable[[Progress], object] = lambda progress: None,
    work: Callable[[SweepJob], Row] = run_job,
    shard: Shard = WHOLE,
) -> None:
    """Drive the runs that have no row.

    Args:
        plan: of the sweep.
        folder: locked by this process.
        engine: executes the runs.
        on_row: called after a row is on the disk.
        work: makes the row of a run.
        shard: share of the sweep to drive.

    Raises:
        SweepStopped: the disk is full, or the scheduler is gone; written rows remain.
    """
    folder.logs.mkdir(exist_ok=True)
    for partial in folder.logs.glob(".*"):  # of workers that were killed
        partial.unlink()
    with Results(folder.results, plan.size) as results:
        jobs = (sweep_job(plan, folder, run) for run in shard.runs(plan) if not results.has(run))
        done = results.count
        for row in imap_rows(engine, jobs, work):
            results.append(row)
            done += 1
            on_row(Progress(done, plan.run_count, row))


def sweep_job(plan: SweepPlan, folder: SweepFolder, run: int) -> SweepJob:
    """Return the job of a run, as it is sent to a worker."""
    planned = plan[run]
    return SweepJob(
        run=run,
        point=planned.point,
        run_id=plan.identity(planned, folder.origin.versions),
        name=planned.setting.name,
        scenario=planned.setting.scenario,
        seed=planned.seed,
        axes=planned.setting.axes,
        code=folder.origin.code,
        folder=folder.path.resolve(),
        keep=plan.study.keep,
    )


def imap_rows(
    engine: Engine, jobs: Iterable[SweepJob], work: Callable[[SweepJob], Row] = run_job
) -> Iterator[Row]:
    """Yield the row of every job as it completes.

    A run that kills its worker can take down runs beside it; each suspect is repeated alone, once,
    before its row says crashed.

    Raises:
        SweepStopped: the scheduler is gone, or a worker cannot continue.
    """
    suspects: list[SweepJob] = []
    alone = replace(engine, width=lambda: 1)
    for repeated in (False, True):
        tasks = [*suspects] if repeated else jobs
        for job, future in imap_bounded(alone if repeated else engine, work, tasks):
            try:
                row = future.result()
            except engine.worker_died:
                suspects.append(job)
                if not repeated:
                    continue
                row = job.crashed()
            except CancelledError:
                raise SweepStopped("the scheduler is gone") from None
            yield {**row, "attempts": 2} if repeated else row


def drive_points(
    scenario: str,
    points: Sequence[Mapping[str, Scalar]],
    engine: Engine,
    *,
    settings: Mapping[str, Any] | None = None,
    seeds: Sequence[int] = (1,),
    folder: Path | None = None,
) -> list[list[Row]]:
    """Drive a scenario at every point and return the rows of each point, one per seed.

    The order of the rows and their numbers do not depend on the number of workers, the columns on
    time and cost apart.

    Args:
        scenario: name of a shipped scenario, or path of a TOML file.
        points: values of scenario keys (`soil.cone_index_kpa`, `faults.gust.force_n`), the same
            keys in each.
        engine: executes the runs, see `engine.engine`.
        settings: nested tables that all points share, such as `{"controller": {"name": "pid"}}`.
        seeds: draw terrain and noise.
        folder: to keep the rows in; the same call with the same folder goes on after an
            interruption and drives nothing twice. None: rows are not kept.

    Returns:
        Rows in the order of the points; those of a point that the scenario refuses are missing.

    Raises:
        InvalidScenario: there is no such scenario.
        InvalidStudy: a point has other keys than the first, or all points are refused.
        SweepRefused: the folder has other content.
        SweepStopped: the workers are gone, or the folder cannot be written to.
    """
    return drive_plan(points_plan(scenario, points, settings, seeds), engine, folder)


def points_plan(
    scenario: str,
    points: Sequence[Mapping[str, Scalar]],
    settings: Mapping[str, Any] | None = None,
    seeds: Sequence[int] = (1,),
) -> SweepPlan:
    """Return the plan of all points, see `drive_points`."""
    keys = tuple(points[0]) if points else ()
    if not keys or any(point.keys() != points[0].keys() for point in points):
        raise InvalidStudy("points: must be one or more, each with a value for the same keys")
    values = tuple(tuple(point[key] for key in keys) for point in points)
    study = Study(
        scenario=scenario,
        seeds=tuple(seeds),
        skip_refused=True,
        set=dict(settings or {}),
        axis=(ListAxis(kind="list", keys=keys, values=values),),
    )
    return SweepPlan("points", study)


def drive_plan(plan: SweepPlan, engine: Engine, folder: Path | None = None) -> list[list[Row]]:
    """Drive all runs of a plan and return the rows of each point, see `drive_points`."""
    if folder is None:
        here = SweepFolder(Path(), Origin.here(plan.extent().digest, plan.size))
        driven = [*imap_rows(engine, (sweep_job(plan, here, run) for run in plan.runs()))]
    else:
        with lock_folder(folder, plan) as locked:
            sweep(plan, locked, engine)
            driven = [*rows(locked.results)]
    result: list[list[Row]] = [[] for _ in range(plan.points)]
    for row in sorted(driven, key=lambda row: int(str(row["run"]))):
        result[int(str(row["point"]))].append(row)
    return result
