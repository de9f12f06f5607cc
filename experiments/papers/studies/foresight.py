"""Foresight of the trailer's side slip on fields of one lap, with and without, by controller.

The working point is the tool where there is one, else the trailer's axle. All columns of a line
drive the same seeds, rivals the first three of them; the change is that of the same seed, with
foresight less without.
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ...results.statistics import mean
from ...studies.sweep.study import Study
from ..markdown import groups, lost, markdown, numbers
from ..table import Table, study, variants

_SEEDS: Final = range(3001, 3011)
_RIVALS_SEEDS: Final = range(3001, 3004)
_LAP: Final = ("path.laps=1", "sensors.angle_resolution_deg=0.0")
_TOOL_AT_WORK: Final = (
    'implement={type="field-cultivator-second",width_m=1.2,depth_m=0.05,work_m=[[3.0,130.0]]}'
)
_TRIALS: Final[Mapping[str, tuple[str, ...]]] = {
    "rough-grass": (
        "grass",
        *_LAP,
        'terrain.iso_class="E"',
        "soil.cone_index_kpa=500.0",
        "soil.random={coefficient_of_variation=0.2,correlation_m=5.0}",
    ),
    "ruts": ("soft-passes", *_LAP, "path.laps=2"),
    "wet-slope": ("wet-slope", *_LAP),
    "tool": ("side-slope", *_LAP, _TOOL_AT_WORK),
}
"""Scenario of each field and its changes; receivers with 3 cm of white noise."""

_GOOD_ON: Final = ("rough-grass", "wet-slope")
_GOOD: Final = ("sensors.gnss_sd_m=0.008", "sensors.angle_sd_deg=0.3")
_NO_IMU: Final = "no IMU"
_IMU: Final = "IMU"
_FORESEES: Final = "IMU + foresight"
_TRUE: Final = "true state"
_WAYS: Final[Mapping[str, tuple[str, ...]]] = {
    _NO_IMU: ("sensors.imu.on=false", "controller.foresee=false"),
    _IMU: ("sensors.imu.on=true", "controller.foresee=false"),
    _FORESEES: ("sensors.imu.on=true", "controller.foresee=true"),
    _TRUE: ("sensors.imu.on=true", "controller.foresee=false", "controller.estimator=truth"),
}
_OWN: Final = "ttempc"
_RIVALS: Final = ("nmpc-rti", "lqr")
_TRACTOR: Final = "tracking.all.tractor.cross_p95_m"
_TRAILER: Final = "tracking.all.trailer.cross_p95_m"
_TOOL: Final = "tracking.all.tool.cross_p95_m"


def working_point(runs: pd.DataFrame) -> FloatArray:
    """Return the p95 of the working point of runs (n,) [cm]."""
    trailer = numbers(runs, _TRAILER)
    if _TOOL not in runs:
        return 100.0 * trailer
    tool = numbers(runs, _TOOL)
    return 100.0 * np.where(np.isnan(tool), trailer, tool)


def _cases(controllers: Sequence[str], *ways: str) -> dict[str, tuple[str, ...]]:
    """Return the changes of controllers in some ways."""
    return {
        f"{controller}: {way}": (f"controller.name={controller}", *_WAYS[way])
        for controller in controllers
        for way in ways
    }


def _studies() -> dict[str, Study]:
    """Return two studies for each trial, of `ttempc` and its rivals; some with good receivers."""
    every = variants("case", _cases((_OWN,), _NO_IMU, _IMU, _FORESEES, _TRUE))
    some = variants("case", _cases((_OWN,), _IMU, _FORESEES))
    rivals = variants("case", _cases(_RIVALS, _IMU, _FORESEES))
    studies: dict[str, Study] = {}
    for trial, (scenario, *changes) in _TRIALS.items():
        studies[trial] = study(scenario, _SEEDS, changes, every)
        studies[f"{trial}: rivals"] = study(scenario, _RIVALS_SEEDS, changes, rivals)
    for trial in _GOOD_ON:
        scenario, *changes = _TRIALS[trial]
        good = (*changes, *_GOOD)
        studies[f"{trial}, 0.8 cm"] = study(scenario, _SEEDS, good, some)
        studies[f"{trial}, 0.8 cm: rivals"] = study(scenario, _RIVALS_SEEDS, good, rivals)
    return studies


def format_table(runs: pd.DataFrame) -> str:
    """Return a line for each study and controller."""
    cases = runs["case"].str.split(": ", n=1, expand=True)
    runs = runs.assign(controller=cases[0], way=cases[1]).sort_values("seed", kind="stable")
    lines = []
    for group in groups(runs, ("study", "controller")):
        ways = {way: group[group["way"] == way] for way in _WAYS}
        means = [
            f"{np.mean(working_point(found)):.2f}" if len(found) else "" for found in ways.values()
        ]
        change = mean(working_point(ways[_FORESEES]) - working_point(ways[_IMU]))
        low, high = change.ends
        both = (ways[_IMU], ways[_FORESEES])
        tractor = [100.0 * float(np.mean(numbers(found, _TRACTOR))) for found in both]
        first = group.iloc[0]
        lines.append(
            (
                first["study"],
                f"`{first['controller']}`",
                *means,
                f"{change.value:+.2f} ({low:+.2f} to {high:+.2f})",
                " / ".join(f"{value:.2f}" for value in tractor),
                lost(group),
            )
        )
    heads = (
        "trial",
        "controller",
        *_WAYS,
        "change by foresight",
        "tractor with IMU, and foresight",
        "lost",
    )
    return markdown(heads, lines)


TABLES: Final = (
    Table(
        name="foresight",
        studies=_studies(),
        text=format_table,
        checks=(("grass", "ttempc", "controller.foresee=true", "sensors.imu.on=true"),),
    ),
)
