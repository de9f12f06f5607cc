"""Ablation of `ttempc`: each part switched off alone, in pairs with the controller as shipped.

A part that is added to `ttempc` gets a line in `OFF`, and a trial a line in `TRIALS`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ...results.statistics import mean
from ...studies.sweep.results import WORKING_P95
from ..markdown import markdown, numbers
from ..table import Table, study, variants

_AS_SHIPPED: Final = "`ttempc`"
OFF: Final[dict[str, tuple[str, ...]]] = {
    "tube": ("controller.options.tube=false",),
    "robust action": ("controller.options.robust=false",),
    "tube and robust action": ("controller.options.tube=false", "controller.options.robust=false"),
    "disturbances in the MPC": ("controller.options.disturbances=false",),
    "learning": ("controller.learn=false",),
    "detectors": ("controller.detect=false",),
    "dead-time compensation": ("controller.compensate=false",),
    "curve slip": (
        "controller.vehicle.tractor_compliance_s2pm=0.0",
        "controller.vehicle.trailer_compliance_s2pm=0.0",
    ),
    "roll as input of the filter": (
        "controller.vehicle.tractor_axle_height_m=0.0",
        "controller.vehicle.trailer_axle_height_m=0.0",
    ),
}
"""Changes that switch a part off, as of `--set`."""

_IMU: Final = "sensors.imu.on=true"
_LAP: Final = ("path.laps=1", _IMU)
TRIALS: Final[dict[str, tuple[str, ...]]] = {
    "rough grass": ("grass", 'terrain.iso_class="E"', *_LAP),
    "wet slope": ("wet-slope", *_LAP),
    "tool": ("cultivate", *_LAP),
    "worn valves": ("old-valves", *_LAP),
    "10 km/h": ("work-eight", *_LAP),
}
"""Scenario of each trial and its changes; all with IMUs."""

_SEEDS: Final = range(3001, 3011)
_LOSS_M: Final = 0.5  # error of a run that does not complete


def errors(runs: pd.DataFrame, part: str) -> FloatArray:
    """Return the error of a variant on all trials, (trials, seeds) [m]; of a lost run the loss."""
    completed = runs["status"] == "completed"
    own = runs.assign(error=np.where(completed, numbers(runs, WORKING_P95), _LOSS_M))
    table = own[own["off"] == part].pivot(index="study", columns="seed", values="error")
    return table.loc[[*TRIALS]].to_numpy()


def _difference(change: FloatArray) -> str:
    """Return a mean change over the seeds [cm] with its 95 % interval."""
    found = mean(100.0 * change)
    low, high = found.ends
    return f"{found.value:+.2f} ({low:+.2f} to {high:+.2f})"


def ablation_table(runs: pd.DataFrame) -> str:
    """Return what each part changes where it is off, by trial and over all of them.

    Changes are those of the p95 of the working point in pairs of runs of one seed; the ratio over
    all trials is a geometric mean over trials, with the interval over seeds.
    """
    shipped = errors(runs, _AS_SHIPPED)
    lines = [[_AS_SHIPPED, *(f"{100.0 * row.mean():.2f}" for row in shipped), "1", _lost(runs)]]
    for part in OFF:
        own = errors(runs, part)
        ratio = mean(np.log(own / shipped).mean(axis=0))
        low, high = (math.exp(end) for end in ratio.ends)
        lines.append(
            [
                part,
                *map(_difference, own - shipped),
                f"{math.exp(ratio.value):.3f} ({low:.3f} to {high:.3f})",
                _lost(runs, part),
            ]
        )
    return markdown(("off", *TRIALS, "all: ratio", "lost"), lines)


def _lost(runs: pd.DataFrame, part: str = _AS_SHIPPED) -> str:
    """Return the number of runs of a variant that did not complete, of all."""
    own = runs[runs["off"] == part]
    return f"{(own['status'] != 'completed').sum()}/{len(own)}"


TABLES: Final = (
    Table(
        name="ablation",
        studies={
            name: study(scenario, _SEEDS, changes, variants("off", {_AS_SHIPPED: (), **OFF}))
            for name, (scenario, *changes) in TRIALS.items()
        },
        text=ablation_table,
        checks=(
            *((scenario, "ttempc", *changes) for scenario, *changes in TRIALS.values()),
            *(("wet-slope", "ttempc", *changes) for changes in OFF.values()),
        ),
    ),
)
