"""Entry into a straight line from beside it, and the hitch angle, over a grid of starts.

The overshoot of a drive is judged against its floor: the largest distance of a point from the line
on the same drive without an offset.
"""

import math
from functools import cache
from typing import Final

import numpy as np
import pandas as pd

from ...results.statistics import mean, proportion
from ...results.tracking_errors import tracking_errors
from ...run.simulate import simulate
from ...scenario.scenario import load
from ..study import Case, Row, Study, summary_row
from ..tables import Cell, grouped, label, numbers

_SEEDS: Final = tuple(range(9501, 9503))  # tuned on 1 to 14
STARTS: Final = (
    *((-1, 0), (2, 0), (2, -35), (-1.5, 20)),  # along the line, towards it
    *((1, 35), (-1.5, -35), (2, 20), (-2, -35)),  # away from it
    *((2.5, 50), (-2.5, -50)),
)
"""Offset to the left [m], heading counter-clockwise [deg]."""
_ENTRIES: Final = 8  # starts that are judged by their overshoot
_WET: Final = ('terrain.iso_class="E"', "terrain.slope_rad=0.15", "soil.cone_index_kpa=300")
GROUNDS: Final = {
    "grass": (),
    "wet slope": _WET,
    "grass, reverse": ("path.reverse=true",),
    "wet slope, reverse": ("path.reverse=true", *_WET),
}
CONTROLLERS: Final = {
    "`ttempc`": (),
    "same, `tightening = none`": ("controller.options.tightening=none",),
    "same, `damping_s = 2`": (
        "controller.options.tightening=none",
        "controller.options.damping_s=2",
    ),
    "`nmpc-rti`": ("controller.name=nmpc-rti", "controller.options.damping_s=2"),
    "`lqr`": ("controller.name=lqr",),
    "`pid`": ("controller.name=pid",),
}
_SPARE_M: Final = 0.02  # over the floor
_HOME_M: Final = 0.25  # largest distance from the line at the end
_LIMIT: Final = math.radians(45.0)
_BODIES: Final = ("tractor", "trailer")


@cache
def _floor(overrides: tuple[str, ...], seed: int) -> tuple[float, float]:
    errors = tracking_errors(simulate(*load("line-entry", overrides), seed)[1])
    return tuple(float(np.abs(getattr(errors, body).cross_m).max()) for body in _BODIES)  # pyright: ignore


def enter(case: Case) -> Row:
    """Return the figures of a drive, its end and by how much its overshoot exceeds its floor."""
    offset, heading = case["start"]
    summary, record = simulate(
        *load(
            case.scenario,
            (*case.overrides, f"start.offset_m={offset}", f"start.heading_deg={heading}"),
        ),
        case.seed,
    )
    row, floor = summary_row(summary), _floor((*case.overrides, "start.offset_m=0"), case.seed)
    last = [float(getattr(tracking_errors(record), body).cross_m[-1]) for body in _BODIES]
    home = summary.status == "completed" and max(map(abs, last)) < _HOME_M
    over = [row[f"entry.{body}.overshoot_m"] for body in _BODIES]
    settled = [row[f"entry.{body}.settled_m"] for body in _BODIES]
    return {
        **row,
        "home": home,
        "over": max(over) if home else math.nan,
        "excess": max(o - f for o, f in zip(over, floor, strict=True)) if home else math.inf,
        "settled": max(settled) if home and None not in settled else math.nan,
    }


def _entries(runs: pd.DataFrame) -> pd.DataFrame:
    return runs[runs["start"].isin(STARTS[:_ENTRIES])]


def _home(runs: pd.DataFrame) -> str:
    share = proportion(int(runs["home"].sum()), len(runs))
    return f"{100 * share.value:.0f} ({100 * share.low:.0f} to {100 * share.high:.0f})"


def _at_floor(runs: pd.DataFrame) -> str:
    runs = _entries(runs)
    within = (numbers(runs, "excess") <= _SPARE_M).astype(float)
    share = mean(100.0 * within, runs["seed"].to_numpy())
    low, high = share.ends
    return f"{share.value:.0f} ({max(low, 0.0):.0f} to {min(high, 100.0):.0f})"


def _quantiles(column: str, factor: float) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        values = factor * numbers(_entries(runs), column)
        if np.isnan(values).all():
            return "-"
        middle, most = np.nanquantile(values, (0.5, 0.95))
        return f"{middle:.1f}, {most:.1f}"

    return cell


def _hitch(runs: pd.DataFrame) -> str:
    fold = np.degrees(numbers(runs, "extremes.fold_rad"))
    return f"{fold.max():.0f}, {(fold > math.degrees(_LIMIT)).sum()}"


STUDIES: Final = (
    Study(
        name="entry",
        scenarios=("line-entry",),
        axes={"ground": GROUNDS, "variant": CONTROLLERS, "start": STARTS},
        seeds=_SEEDS,
        overrides=(),
        drive=enter,
        table=lambda runs: grouped(
            runs,
            ["ground", "variant"],
            {
                "ground": label("ground"),
                "controller": label("variant"),
                "home [%]": _home,
                "at the floor [%]": _at_floor,
                "overshoot [cm]": _quantiles("over", 100.0),
                "settled [m]": _quantiles("settled", 1.0),
                "largest angle [deg], runs beyond 45": _hitch,
            },
        ),
        checks=(("line-entry", "ttempc"),),
    ),
)
