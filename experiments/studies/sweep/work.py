"""Execution of one run in a worker."""

import contextlib
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Final, Literal

from ....testbed.atomic_write import partial_path
from ....testbed.errors import LogError
from ....testbed.recording.provenance import code_digest
from ....testbed.recording.record import Record
from ...errors import SweepStopped
from ...results.summary import Summary
from ...run.shared_parts import SharedParts
from ...run.simulate import simulate
from ...scenario.scenario import Scenario
from .row import Row, RowStatus, Value, figures, no_figures

# Of this process. A plan counts controllers fastest, then seeds: the last terrains and the
# controllers of a comparison.
_PARTS: Final = SharedParts(terrains=2, controllers=4)


@dataclass(frozen=True, slots=True)
class SweepJob:
    """A run of a sweep, with everything that a worker needs."""

    run: int
    point: int
    run_id: str
    name: str  # name of the scenario
    scenario: Scenario
    seed: int
    axes: Mapping[str, Value]
    code: str  # digest of the driver's code; a worker with other code refuses
    folder: Path  # of the sweep, shared by driver and workers; logs are written there
    keep: Literal["none", "all", "failed"]

    def row(
        self,
        status: RowStatus,
        failure: str | None,
        numbers: Mapping[str, float | None],
        wall_s: float | None,
        log: str = "",
    ) -> Row:
        """Return the row of the run."""
        return {
            "run": self.run,
            "point": self.point,
            "run_id": self.run_id,
            "scenario": self.name,
            "controller": self.scenario.controller.name,
            "seed": self.seed,
            **{key: self.axes[key] for key in self.axes if key not in ("scenario", "controller")},
            "status": status,
            "failure": failure or "",
            **numbers,
            "wall_s": wall_s,
            "attempts": 1,
            "log": log,
            "code": self.code,
        }

    def crashed(self) -> Row:
        """Return the row of the run after every process that drove it has died."""
        return self.row("crashed", "every process that drove it died", no_figures(), None)


Measure = Callable[[SweepJob, Summary, Record], Mapping[str, Value]]
"""Further columns of a row, from the job of a run, its summary and its record."""


def run_job(job: SweepJob, measure: Measure | None = None) -> Row:
    """Drive a run and return its row; an error in the run becomes a row, too.

    Args:
        job: of the run.
        measure: makes further columns of the row.

    Raises:
        SweepStopped: this process has other code than the driver, or the log cannot be written.
    """
    if code_digest() != job.code:
        raise SweepStopped(f"a worker has other code than the driver: {code_digest()}, {job.code}")
    start = perf_counter()
    log = job.folder / "logs" / f"{job.run_id}.mcap"  # the number changes where a study grows
    # Hidden until complete: the run is driven twice if its first worker seems to be dead.
    part = log.with_name(f".{job.run}-{uuid.uuid4().hex[:8]}.mcap")
    try:
        summary, record = simulate(
            job.name,
            job.scenario,
            job.seed,
            log=None if job.keep == "none" else part,
            parts=_PARTS,
        )
        kept = job.keep == "all" or (job.keep == "failed" and summary.status != "completed")
        if kept:
            part.replace(log)
        measured = measure(job, summary, record) if measure else {}
    except LogError as error:
        raise SweepStopped(f"run {job.run}: {error}") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a run may fail in any way, a controller's own included
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        return job.row("failed", reason, no_figures(), perf_counter() - start)
    finally:
        if job.keep != "none":
            for file in (part, partial_path(part)):
                with contextlib.suppress(OSError):
                    file.unlink(missing_ok=True)
    wall_s = perf_counter() - start
    name = log.relative_to(job.folder).as_posix() if kept else ""
    row = job.row(summary.status, summary.failure, figures(summary), wall_s, name)
    return {**row, **measured}
