"""Runs at given points: sets of changes of one scenario, driven by the engine of the sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InvalidStudy
from .engine import Engine
from .folder import Origin, SweepFolder, lock_folder
from .plan import SweepPlan
from .results import rows
from .row import Row
from .study import ListAxis, Scalar, Study
from .sweep import imap_rows, sweep, sweep_job


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
    """Return the plan of all points, see `drive_points`.

    Raises:
        InvalidScenario: there is no such scenario.
        InvalidStudy: a point has other keys than the first.
    """
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
    """Drive all runs of a plan and return the rows of each point in the order of their numbers.

    Raises:
        InvalidStudy, SweepRefused, SweepStopped: as `drive_points`.
    """
    if folder is None:
        here = SweepFolder(Path(), Origin.here(plan.extent().digest, plan.size))
        driven = [*imap_rows(engine, (sweep_job(plan, here, run) for run in plan.runs()))]
    else:
        with lock_folder(folder, plan) as locked:
            sweep(plan, locked, engine)
            driven = [*rows(locked.results)]
    by_run = {row["run"]: row for row in driven}
    per_point = plan.size // plan.points
    numbers = (range(p * per_point, (p + 1) * per_point) for p in range(plan.points))
    return [[by_run[run] for run in runs if run in by_run] for runs in numbers]
