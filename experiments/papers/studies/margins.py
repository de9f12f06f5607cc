"""Margins: the longest dead time that nobody told a law and that it bears, over the speed."""

import math
from typing import Final

import numpy as np
import pandas as pd

from ..markdown import markdown, numbers
from ..table import Table, listed, study, variants

_SEEDS: Final = range(3101, 3104)
_SPEEDS: Final = (1.0, 2.0, 3.0, 4.0)
_LAWS: Final = ("ttempc", "ttempc-nominal", "nmpc-rti", "lqr", "pid")
_STEP_S: Final = 0.05
_MOST_S: Final = 0.4
_BORNE: Final = 3.0  # times the error without a dead time, up to which one is borne

# A wide eight of the farm machine whose drive reaches 4 m/s; nothing is learnt or compensated
_SETS: Final = (
    "path.radius_m=25.0",
    "path.centre_distance_m=75.0",
    "path.blend_m=10.0",
    "path.laps=1",
    "terrain.size_x_m=150.0",
    "terrain.size_y_m=80.0",
    "plant.vehicle.speed_gain_mps=6.0",
    "controller.vehicle.speed_gain_mps=6.0",
    "controller.learn=false",
    "controller.compensate=false",
)
_ESTIMATES: Final = {
    "filter": (),
    "true state": ('controller.estimator="truth"',),
}


def _dead_times() -> dict[str, tuple[str, ...]]:
    """Return the changes of a scenario by the dead time of both valves."""
    count = round(_MOST_S / _STEP_S)
    values = [round(_STEP_S * n, 2) for n in range(count + 1)]
    return {
        f"{value:.2f}": tuple(
            f"actuators.{axis}.dead_time_s={value}" for axis in ("front", "trailer")
        )
        for value in values
    }


def borne_s(runs: pd.DataFrame) -> float:
    """Return the longest dead time up to which all shorter ones are borne, NaN where none is [s].

    One is borne where every run completes and the mean p95 of the trailer's cross-track error is
    below three times that without a dead time.
    """
    undisturbed = math.nan
    longest = math.nan
    for value, group in sorted(runs.groupby("dead_time"), key=lambda item: float(str(item[0]))):
        completed = bool((group["status"] == "completed").all())
        error = float(np.mean(numbers(group, "tracking.all.trailer.cross_p95_m")))
        if math.isnan(undisturbed):
            undisturbed = error
        if not completed or not error < _BORNE * undisturbed:
            break
        longest = float(str(value))
    return longest


def _text(runs: pd.DataFrame) -> str:
    """Return a line a law and estimate, with a column a speed."""
    heads = ["controller", "state", *(f"{speed:g} m/s" for speed in _SPEEDS)]
    lines: list[list[str]] = []
    for law in _LAWS:
        for estimate in _ESTIMATES:
            own = runs[(runs["controller"] == law) & (runs["state"] == estimate)]
            cells = [borne_s(own[own["path.speed_mps"] == speed]) for speed in _SPEEDS]
            shown = ["lost" if math.isnan(cell) else f"{cell:.2f}" for cell in cells]
            lines.append([f"`{law}`", estimate, *shown])
    return markdown(heads, lines)


TABLES: Final = (
    Table(
        name="margins",
        studies={
            "margins": study(
                "farm",
                _SEEDS,
                _SETS,
                listed("controller", *_LAWS),
                variants("state", _ESTIMATES),
                listed("path.speed_mps", *_SPEEDS),
                variants("dead_time", _dead_times()),
            )
        },
        text=_text,
    ),
)
