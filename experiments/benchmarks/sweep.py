"""Overhead, scaling and memory of a sweep.

    python -m experiments.benchmarks.sweep runs [RUNS]      speed, overhead, two workers against one
    python -m experiments.benchmarks.sweep rows [ROWS [WORKERS]]    memory of the driver

`runs` drives one lap of `grass` RUNS times (8) on one worker, then on two, after a first run per
worker that loads all modules. Overhead is the time in which a worker has no run. Parallel
efficiency is the time on one worker over twice the time on two; other processes reduce it.
`rows` passes 1e3 and then ROWS (1e5) synthetic rows through planning, WORKERS (0: this process),
appending and syncing.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from ..sweep.engine import engine
from ..sweep.folder import Origin, SweepFolder
from ..sweep.plan import SweepPlan
from ..sweep.results import rows
from ..sweep.row import Row, no_figures
from ..sweep.study import ListAxis, Study
from ..sweep.sweep import sweep
from ..sweep.work import SweepJob

LARGEST_OVERHEAD: Final = 0.05
LEAST_EFFICIENCY: Final = 0.9
FEW_ROWS: Final = 1_000
LEAST_SPEED: Final = 60.0  # simulated seconds per wall second and core


def _plan(seeds: int) -> SweepPlan:
    controllers = ListAxis(kind="list", key="controller", values=("ttempc-nominal", "paper"))
    return SweepPlan(
        "benchmark", Study(seeds=seeds, set={"path": {"laps": 1}}, axis=(controllers,))
    )


def _sweep(plan: SweepPlan, workers: int, parent: Path) -> tuple[float, list[Row]]:
    """Return the time of a sweep on warm workers and its rows."""
    with engine(workers) as cores:
        for seeds in (workers, 0):
            part = _plan(seeds) if seeds else plan
            folder = SweepFolder(parent / f"{workers}-{part.size}", Origin.here("", part.size))
            folder.path.mkdir()
            begin = time.perf_counter()
            sweep(part, folder, cores)
            taken = time.perf_counter() - begin
    return taken, list(rows(folder.results))


def measure_runs(count: int) -> None:
    """Print speed, overhead and parallel efficiency."""
    plan = _plan(count // 2)
    taken = {}
    with tempfile.TemporaryDirectory() as parent:
        for workers in (1, 2):
            taken[workers], driven = _sweep(plan, workers, Path(parent))
            busy = sum(float(row["wall_s"] or 0.0) for row in driven)
            simulated = sum(float(row["duration_s"] or 0.0) for row in driven)
            overhead = workers * taken[workers] / busy - 1.0
            print(
                f"{workers} workers: {len(driven)} runs in {taken[workers]:.1f} s, "
                f"{simulated / busy:.0f} simulated s a wall s and core (at least {LEAST_SPEED:g}), "
                f"overhead {overhead:.1%} (at most {LARGEST_OVERHEAD:.0%})"
            )
    efficiency = taken[1] / (2.0 * taken[2])
    print(f"parallel efficiency {efficiency:.2f} (at least {LEAST_EFFICIENCY})")


def synthetic_row(job: SweepJob) -> Row:
    """Return a row without a run."""
    return job.row("completed", None, dict.fromkeys(no_figures(), 0.5), 0.0)


def measure_rows(most: int, workers: int) -> None:
    """Print time and peak memory of the driver after `FEW_ROWS` and after `most`."""
    with tempfile.TemporaryDirectory() as parent, engine(workers) as cores:
        for number, count in enumerate((FEW_ROWS, most)):
            plan = _plan(count // 2)
            folder = SweepFolder(Path(parent) / str(number), Origin.here("", plan.size))
            folder.path.mkdir()
            begin = time.perf_counter()
            sweep(plan, folder, cores, work=synthetic_row)
            taken = time.perf_counter() - begin
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            size = folder.results.stat().st_size
            print(
                f"{count} rows: peak {peak:.0f} MB, {1e3 * taken / count:.2f} ms a row, "
                f"{size / count:.0f} bytes a row",
                flush=True,
            )


def main(what: str = "runs", count: str = "", workers: str = "0") -> None:
    """Print the figures."""
    if what == "rows":
        measure_rows(int(count or 100_000), int(workers))
    else:
        measure_runs(int(count or 8))


if __name__ == "__main__":
    main(*sys.argv[1:])
