"""Speed, overhead, scaling and memory of a sweep.

One lap of `grass` is driven on one worker, then on two, after a first run per worker that loads all
modules. A worker has one core, also for the thread that learns, where the system can bind it to
one. Overhead is the time in which a worker has no run. Parallel efficiency is the time on one
worker over twice the time on two; other processes reduce it. Threads in the place of workers share
one interpreter: a figure says what two of them gain. Synthetic rows without runs pass
through planning, appending and syncing in this process.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

from ..run.simulate import simulate
from ..scenario.scenario import load
from ..sweep.engine import engine
from ..sweep.folder import Origin, SweepFolder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.row import Row, no_figures
from ..sweep.study import ListAxis, Study
from ..sweep.sweep import sweep
from ..sweep.work import SweepJob
from .figure import BenchmarkFigure, Limit
from .memory import peak_mb

RUNS = 8
ROWS = 10_000
PATH: dict[str, object] = {"laps": 1}

LARGEST_OVERHEAD: Final = 0.05
LEAST_EFFICIENCY: Final = 0.95
LEAST_SPEED: Final = 110.0  # simulated seconds per wall second and core
LARGEST_WORKER_MB: Final = 300.0


def _plan(seeds: int) -> SweepPlan:
    controllers = ListAxis(kind="list", key="controller", values=("ttempc-nominal", "paper"))
    return SweepPlan("benchmark", Study(seeds=seeds, set={"path": PATH}, axis=(controllers,)))


@contextlib.contextmanager
def _cores(count: int) -> Iterator[None]:
    """Keep this process and those that it starts on some cores, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _sweep(plan: SweepPlan, workers: int, parent: Path) -> tuple[float, list[Row], float]:
    """Return the time of a sweep on warm workers [s], its rows, and a worker's peak memory [MB]."""
    taken = 0.0
    with _cores(max(1, workers)), engine(workers) as cores:
        for name, part in (("first", _plan(max(1, workers))), ("measured", plan)):
            folder = SweepFolder(parent / f"{name}-{workers}", Origin.here("", part.size))
            folder.path.mkdir()
            begin = time.perf_counter()
            sweep(part, folder, cores)
            taken = time.perf_counter() - begin
        peak = cores.executor.submit(peak_mb).result()
    return taken, list(rows(folder.results)), peak


def synthetic_row(job: SweepJob) -> Row:
    """Return a row without a run."""
    return job.row("completed", None, dict.fromkeys(no_figures(), 0.5), 0.0)


def figures() -> list[BenchmarkFigure]:
    """Return speed, overhead and memory on one worker, parallel efficiency, cost of a row."""
    plan, taken = _plan(RUNS // 2), {}
    result = []
    with tempfile.TemporaryDirectory() as parent:
        for workers in (1, 2):
            taken[workers], driven, peak = _sweep(plan, workers, Path(parent))
            busy = sum(float(row["wall_s"] or 0.0) for row in driven)
            simulated = sum(float(row["duration_s"] or 0.0) for row in driven)
            overhead = 100.0 * (workers * taken[workers] / busy - 1.0)
            on = f"{workers} worker{'s' * (workers > 1)}"
            result += [
                BenchmarkFigure(
                    f"{on}, simulated s a s and core",
                    simulated / busy,
                    "",
                    Limit(LEAST_SPEED, True),
                ),
                BenchmarkFigure(
                    f"{on}, time without a run", overhead, "%", Limit(100.0 * LARGEST_OVERHEAD)
                ),
                BenchmarkFigure(f"{on}, peak memory of one", peak, "MB", Limit(LARGEST_WORKER_MB)),
            ]
        efficiency = taken[1] / (2.0 * taken[2])
        result.append(
            BenchmarkFigure("parallel efficiency", efficiency, "", Limit(LEAST_EFFICIENCY, True))
        )
        return [*result, _threads(), *row_figures(Path(parent))]


def _threads() -> BenchmarkFigure:
    """Return how many runs two threads of this process make in the time of one thread."""
    run = load("grass", ["path.laps=1"])
    simulate(*run, seed=1)
    taken = []
    for count in (1, 2):
        with ThreadPoolExecutor(count) as pool:
            begin = time.perf_counter()
            list(pool.map(lambda seed: simulate(*run, seed=seed), range(2, 2 + count)))
            taken.append(time.perf_counter() - begin)
    return BenchmarkFigure("2 threads of a process, runs beside 1", 2.0 * taken[0] / taken[1], "")


def row_figures(parent: Path) -> list[BenchmarkFigure]:
    """Return time and memory of rows without runs, in this process."""
    plan = _plan(ROWS // 2)
    folder = SweepFolder(parent / "rows", Origin.here("", plan.size))
    folder.path.mkdir()
    before = peak_mb()
    begin = time.perf_counter()
    with engine(0) as here:
        sweep(plan, folder, here, work=synthetic_row)
    row_ms = 1e3 * (time.perf_counter() - begin) / ROWS
    grown_kb = 1024.0 * (peak_mb() - before) / ROWS
    return [
        BenchmarkFigure("a row without a run", row_ms, "ms"),
        BenchmarkFigure("growth of the driver's peak memory a row", grown_kb, "kB"),
    ]
