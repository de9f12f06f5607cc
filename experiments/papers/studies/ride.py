"""Short waves of the ground: how they shake the tractor, and what they do to the error."""

from collections.abc import Mapping
from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from ....testbed.recording.channels import STATE
from ....testbed.recording.record import Record
from ...results.statistics import mean
from ...results.summary import Summary
from ...studies.sweep.work import SweepJob, run_job
from ..markdown import label, markdown, numbers
from ..table import Table, listed, study

_SEEDS: Final = range(9721, 9727)
_WAVES_M: Final = (0.5, 0.2)
_SPEEDS: Final = {"grass": "1 m/s", "farm": "1.5 m/s", "work-eight": "2.8 m/s"}
_AFTER_S: Final = 8.0  # the start is not counted
_RIDE: Final = {
    "vertical acceleration [m/s²]": "vertical_mps2",
    "pitch rate [deg/s]": "pitch_degps",
    "roll rate [deg/s]": "roll_degps",
}
_HEADS: Final = ("scenario", "shortest wave [m]", *_RIDE, "trailer, p95 [cm]", "tractor, p95 [cm]")


def ride(job: SweepJob, summary: Summary, record: Record) -> Mapping[str, float]:
    """Return the rms of the motion of the tractor's rear axle, by differences at the log's rate."""
    state = record[STATE]
    period_s = float(np.median(np.diff(state.time_s)))
    after = state.time_s > _AFTER_S
    height, pitch, roll = state.columns("z_t_m", "pitch_t_rad", "roll_t_rad")[after].T
    motions = {
        "vertical_mps2": np.diff(height, 2) / period_s**2,
        "pitch_degps": np.degrees(np.diff(pitch)) / period_s,
        "roll_degps": np.degrees(np.diff(roll)) / period_s,
    }
    return {name: float(np.std(motion)) for name, motion in motions.items()}


def _table(frame: pd.DataFrame) -> str:
    """Return the ride on each shortest wave, and the change of the errors in pairs [cm]."""
    lines = []
    for name in _SPEEDS:
        runs = frame[frame["study"] == name]
        long, short = (
            runs[runs["terrain.shortest_wave_m"] == wave].sort_values("seed") for wave in _WAVES_M
        )
        for wave, group in zip(_WAVES_M, (long, short), strict=True):
            cells = [label("scenario", "`{}`")(group) + f", {_SPEEDS[name]}", f"{wave:g}"]
            cells += [f"{numbers(group, column).mean():.2f}" for column in _RIDE.values()]
            for body in ("trailer", "tractor"):
                errors = 100.0 * numbers(group, f"tracking.all.{body}.cross_p95_m")
                before = 100.0 * numbers(long, f"tracking.all.{body}.cross_p95_m")
                change = mean(errors - before)
                half = change.value - (change.low or 0.0)
                paired = f" ({change.value:+.2f} ± {half:.2f})" if group is short else ""
                cells.append(f"{errors.mean():.2f}{paired}")
            lines.append(cells)
    return markdown(_HEADS, lines)


TABLES: Final = (
    Table(
        name="ride",
        studies={
            name: study(
                name,
                _SEEDS,
                ("path.laps=1", "terrain.spacing_m=0.05"),
                listed("terrain.shortest_wave_m", *_WAVES_M),
            )
            for name in _SPEEDS
        },
        text=_table,
        work=partial(run_job, measure=ride),
        checks=(("grass", "ttempc", "terrain.spacing_m=0.05", "terrain.shortest_wave_m=0.2"),),
    ),
)
