"""Entry into a straight line from beside it, and the hitch angle, over a grid of starts.

The overshoot of a drive is judged against its floor: the largest distance of a point from the line
on the same drive without an offset.
"""

import math
from functools import cache
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import qmc

from ...results.statistics import mean, proportion
from ...results.tracking_errors import tracking_errors
from ...run.simulate import simulate
from ...scenario.scenario import load
from ..study import Case, Row, Study, summary_row
from ..tables import Cell, grouped, label, numbers

_SEEDS: Final = tuple(range(9521, 9541))  # tuned on 1 to 14 and 9601 to 9664
_RANGES: Final = {"entry": (2.0, 35.0), "wide": (2.5, 50.0)}
"""Largest offset, 1 m at least [m], and heading [deg] of the two starts that a seed draws."""
_WET: Final = ('terrain.iso_class="E"', "terrain.slope_rad=0.15", "soil.cone_index_kpa=300")
_PATCHY: Final = "soil.patches=" + str(
    [f"{{x_m={x}, y_m=0.0, radius_m=3.0, cone_index_kpa=180.0}}" for x in (7.0, 17.0)]
).replace("'", "")
GROUNDS: Final = {
    "grass": (),
    "wet slope": _WET,
    "patchy": (_PATCHY,),
    "grass, reverse": ("path.reverse=true",),
    "wet slope, reverse": ("path.reverse=true", *_WET),
    "patchy, reverse": ("path.reverse=true", _PATCHY),
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


def start(kind: str, seed: int) -> tuple[float, float]:
    """Return offset to the left [m] and heading [deg] that a seed draws, spread over the ranges."""
    draw = qmc.Halton(2, scramble=False).fast_forward(seed - _SEEDS[0] + 1).random(1)[0].tolist()
    (most, turned), side = _RANGES[kind], 2.0 * draw[0] - 1.0
    offset = math.copysign(1.0 + (most - 1.0) * abs(side), side)
    return round(offset, 2), round(turned * (2.0 * draw[1] - 1.0), 1)


def enter(case: Case) -> Row:
    """Return the figures of a drive, its end and by how much its overshoot exceeds its floor."""
    offset, heading = start(case["start"], case.seed)
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


def _home(kind: str) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        own = runs[runs["start"] == kind]
        share = proportion(int(own["home"].sum()), len(own))
        return f"{100 * share.value:.0f} ({100 * share.low:.0f} to {100 * share.high:.0f})"

    return cell


def _at_floor(runs: pd.DataFrame) -> str:
    runs = runs[runs["start"] == "entry"]
    within = (numbers(runs, "excess") <= _SPARE_M).astype(float)
    share = mean(100.0 * within, runs["seed"].to_numpy())
    low, high = share.ends
    return f"{share.value:.0f} ({max(low, 0.0):.0f} to {min(high, 100.0):.0f})"


def _quantiles(column: str, factor: float) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        values = factor * numbers(runs[runs["start"] == "entry"], column)
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
        axes={"ground": GROUNDS, "variant": CONTROLLERS, "start": tuple(_RANGES)},
        seeds=_SEEDS,
        overrides=(),
        drive=enter,
        table=lambda runs: grouped(
            runs,
            ["ground", "variant"],
            {
                "ground": label("ground"),
                "controller": label("variant"),
                "home [%]": _home("entry"),
                "home, wide starts [%]": _home("wide"),
                "at the floor [%]": _at_floor,
                "overshoot [cm]": _quantiles("over", 100.0),
                "settled [m]": _quantiles("settled", 1.0),
                "largest angle [deg], runs beyond 45": _hitch,
            },
        ),
        checks=(("line-entry", "ttempc"),),
    ),
)
