"""Second lap on the same line, with and without a map of disturbances by place."""

from collections.abc import Mapping
from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from ....testbed.recording.record import Record
from ...results.summary import Summary
from ...results.tracking_errors import tracking_errors
from ...studies.sweep.work import SweepJob, run_job
from ..markdown import Cell, grouped, label, lost, numbers
from ..table import Table, listed, study, variants

_SEEDS: Final = range(3001, 3006)
_ALL: Final = ("path.laps=2", "sensors.imu.on=true")
_FIELD: Final = "controller.learn_field=true"
_VARIANTS: Final[dict[str, tuple[str, ...]]] = {
    "`ttempc`": (),
    "`ttempc`, `learn_field`": (_FIELD,),
    "`nmpc-rti`, `learn_field`": ("controller.name=nmpc-rti", _FIELD),
}
_FULL_SPEED: Final = "controller.options.corridor=false"  # of `ttempc` between rows
_IN_ROWS: Final = {
    name: (*changes, _FULL_SPEED) if "`ttempc`" in name else changes
    for name, changes in _VARIANTS.items()
}
_BETWEEN_ROWS: Final = ((6.0, 34.0), (88.0, 114.0))  # of a lap of `rows` [m]


def second_lap(job: SweepJob, summary: Summary, record: Record) -> Mapping[str, float]:
    """Return the cross-track figures of the second lap [m]: p95 and largest of each point.

    A tool counts where it is lowered.
    """
    errors = tracking_errors(record)
    along = errors.time_s - job.scenario.mission().path.lap_m  # at 1 m/s a second is a metre
    counted = along > 0.0
    if job.name == "rows":
        counted &= np.any([(a < along) & (along < b) for a, b in _BETWEEN_ROWS], axis=0)
    row: dict[str, float] = {}
    for point, error in errors.by_point.items():
        across = np.abs(error.cross_m[counted])
        across = across[np.isfinite(across)]
        if across.size:
            row[f"{point}_p95"] = float(np.quantile(across, 0.95))
        row[f"{point}_largest"] = float(across.max(initial=0.0))
    return row


def _p95(point: str) -> Cell:
    """Return the cell of the mean of a point, empty where no run has it."""

    def text(runs: pd.DataFrame) -> str:
        column = f"{point}_p95"
        found = numbers(runs, column) if column in runs else np.array([np.nan])
        return "" if np.isnan(found).all() else f"{100.0 * np.nanmean(found):.2f}"

    return text


def _largest(runs: pd.DataFrame) -> str:
    most = np.maximum(numbers(runs, "tractor_largest"), numbers(runs, "trailer_largest"))
    return f"{100.0 * np.median(most):.1f}, {100.0 * most.max():.1f}"


_CELLS: Final = {
    "scenario": label("scenario"),
    "controller": label("variant", "{}"),
    "tractor, p95": _p95("tractor"),
    "trailer, p95": _p95("trailer"),
    "tool, p95": _p95("tool"),
    "largest of both: median, most": _largest,
    "lost": lost,
}

TABLES: Final = (
    Table(
        name="second-pass",
        studies={
            "rows": study("rows", _SEEDS, _ALL, variants("variant", _IN_ROWS)),
            "others": study(
                "grass",
                _SEEDS,
                _ALL,
                listed("scenario", "wet-slope", "patchy", "cultivate"),
                variants("variant", _VARIANTS),
            ),
        },
        work=partial(run_job, measure=second_lap),
        text=lambda runs: grouped(runs, ["scenario", "variant"], _CELLS),
        checks=(("rows", "ttempc", "controller.learn_field=true", "path.laps=2"),),
    ),
)
