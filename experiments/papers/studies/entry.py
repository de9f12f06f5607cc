"""Entry into a straight line from beside it, and the hitch angle, over a grid of starts.

The overshoot of a drive is judged against its floor: the largest distance of a point from the line
on the same drive without an offset. Beside the controllers stands a search among feedbacks of the
true state, by drives of the true plant.
"""

import math
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import qmc

from ttempc.types import Command, FloatArray

from ....testbed.errors import PlantDiverged
from ...results.statistics import proportion
from ...results.tracking_errors import tracking_errors
from ...run.assembly import Assembly, assemble
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
    "same, `tube = false`": ("controller.options.tube=false",),
    "`nmpc-rti`": ("controller.name=nmpc-rti", "controller.options.damping_s=2"),
    "`lqr`": ("controller.name=lqr",),
    "`pid`": ("controller.name=pid",),
    "search": (),
}
_SPARE_M: Final = 0.02  # over the floor
_HOME_M: Final = 0.25  # largest distance from the line at the end
_LIMIT: Final = math.radians(45.0)
_LOST_M: Final = 5.0  # distance of the tractor from its reference at which a run ends
_SLOW_M: Final = 0.4  # error across beyond which a searched feedback may be slow
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


# Ranges of a feedback's draws: heading per error across [rad/m], the largest heading [rad], in
# reverse curvature per heading error [1/m] and largest angle of the bodies [rad], curvature of the
# tractor per its error [1/m], drawbar per heading error, share of the speed beyond `_SLOW_M`
_LEAST: Final = np.array([0.1, 0.15, 0.3, 0.15, 0.8, -1.0, 0.2])
_MOST: Final = np.array([1.0, 1.0, 1.5, 0.8, 3.0, 1.0, 1.0])
_DRAWS: Final = 400
_STOPS: Final = np.radians([35.0, 24.0])  # of both steerings


def search(case: Case) -> Row:
    """Return whether one of `_DRAWS` feedbacks brings the plant home within the hitch limit.

    A feedback sees the true state, asks the point in front for a heading that falls with its error
    across, and turns towards it; in reverse by the angle between the bodies, which the tractor's
    steering sets. It is no optimum: a start that it does not bring home may still have a way home.
    """
    assembly = assemble(load(case.scenario, case.overrides)[1], case.seed)
    generator, fold = np.random.default_rng(case.seed), math.inf
    for _ in range(_DRAWS):
        fold = _attempt(assembly, generator.uniform(_LEAST, _MOST).tolist())
        if fold < math.inf:
            break
    return {"home": fold < math.inf, "extremes.fold_rad": fold if fold < math.inf else math.nan}


def _attempt(assembly: Assembly, draw: list[float]) -> float:
    """Return the largest hitch angle of a drive that comes home within `_LIMIT`, else inf."""
    near, cap, turn, most, rate, drawbar, slow = draw
    plant, period_s = assembly.plant, assembly.guidance.period_s
    vehicle, now, fold = assembly.reference.vehicle, plant.restore(assembly.start), 0.0
    length = vehicle.trailer_length + vehicle.drawbar_length
    steps = round(period_s / plant.timestep_s)
    path = assembly.reference.at(np.arange(assembly.ticks) * period_s)
    across = np.zeros(2)
    for state, trailer, inputs in zip(path.state, path.trailer_xy, path.inputs, strict=True):
        cos, sin = math.cos(state[2]), math.sin(state[2])
        x = np.array([now.tractor.x - state[0], now.trailer.x - trailer[0]])
        y = np.array([now.tractor.y - state[1], now.trailer.y - trailer[1]])
        along, across = cos * x + sin * y, cos * y - sin * x
        yaw_t = math.remainder(now.tractor.yaw - state[2], math.tau)
        yaw_i = math.remainder(now.trailer.yaw - state[3], math.tau)
        fold = max(fold, abs(now.beta))
        if fold > _LIMIT or math.hypot(along[0], across[0]) > _LOST_M:
            return math.inf
        if state[6] < 0.0:
            missing = float(np.clip(near * across[1], -cap, cap)) - yaw_i
            wanted = float(np.clip(-length * turn * missing, -most, most))
            curvature = math.sin(yaw_t - yaw_i) / length - rate * (wanted - yaw_t + yaw_i)
        else:
            curvature = -rate * (float(np.clip(near * across[0], -cap, cap)) + yaw_t)
            missing = yaw_i + near * across[1]
        angles = math.atan(vehicle.wheelbase * curvature), drawbar * missing
        angles = np.clip(angles, -_STOPS, _STOPS).tolist()
        share = slow if np.abs(across).max() > _SLOW_M else 1.0
        try:
            now = plant.advance(Command(*angles, hp=float(share * inputs[2])), steps)
        except PlantDiverged:
            return math.inf
    return fold if np.abs(across).max() < _HOME_M else math.inf


def enter(case: Case) -> Row:
    """Return the figures of a drive, its end and by how much its overshoot exceeds its floor."""
    offset, heading = start(case["start"], case.seed)
    turned = (f"start.offset_m={offset}", f"start.heading_deg={heading}")
    own = replace(case, overrides=(*case.overrides, *turned))
    if case["variant"] == "search":
        return search(own)
    summary, record = simulate(*load(case.scenario, own.overrides), case.seed)
    row, errors, floor = summary_row(summary), tracking_errors(record), (math.nan, math.nan)
    if case["start"] == "entry" and "path.reverse=true" not in case.overrides:
        floor = _floor((*case.overrides, "start.offset_m=0"), case.seed)
    last = [float(getattr(errors, body).cross_m[-1]) for body in _BODIES]
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


def _share(values: FloatArray) -> str:
    if not len(values):
        return "-"
    share = proportion(int(values.sum()), len(values))
    return f"{100 * share.value:.0f} ({100 * share.low:.0f} to {100 * share.high:.0f})"


def _of(kind: str, column: str, where: str = "") -> Cell:
    """Return the cell of a share of the starts of a kind, of those alone that a column marks."""

    def cell(runs: pd.DataFrame) -> str:
        own = runs[runs["start"] == kind]
        return _share(numbers(own[own[where].astype(bool)] if where else own, column))

    return cell


def _at_floor(runs: pd.DataFrame) -> str:
    excess = numbers(runs[runs["start"] == "entry"], "excess")
    return _share((excess <= _SPARE_M).astype(float)) if np.isfinite(excess).any() else "-"


def _quantiles(column: str, factor: float) -> Cell:
    def cell(runs: pd.DataFrame) -> str:
        values = factor * numbers(runs[runs["start"] == "entry"], column)
        if np.isnan(values).all():
            return "-"
        middle, most = np.nanquantile(values, (0.5, 0.95))
        return f"{middle:.1f}, {most:.1f}"

    return cell


def _hitch(runs: pd.DataFrame) -> str:
    fold = np.degrees(np.nan_to_num(numbers(runs, "extremes.fold_rad")))
    return f"{fold.max():.0f}, {(fold > math.degrees(_LIMIT)).sum()}"


def _table(runs: pd.DataFrame) -> str:
    keys = ["ground", "start", "seed"]
    found = runs[runs["variant"] == "search"].set_index(keys)["home"].astype(float)
    fails = ~runs["home"].astype(bool) | (runs["extremes.fold_rad"] > _LIMIT)
    cells = {
        "ground": label("ground"),
        "controller": label("variant"),
        "home [%]": _of("entry", "home"),
        "at the floor [%]": _at_floor,
        "overshoot [cm]": _quantiles("over", 100.0),
        "settled [m]": _quantiles("settled", 1.0),
        "wide: home [%]": _of("wide", "home"),
        "of those that the search brings home": _of("wide", "home", "found"),
        "lost or beyond 45 deg": _of("wide", "fails"),
        "largest angle [deg], runs beyond 45": _hitch,
    }
    own = runs.join(found.rename("found"), on=keys).assign(fails=fails)
    return grouped(own, ["ground", "variant"], cells)


STUDIES: Final = (
    Study(
        name="entry",
        scenarios=("line-entry",),
        axes={"ground": GROUNDS, "variant": CONTROLLERS, "start": tuple(_RANGES)},
        seeds=_SEEDS,
        overrides=(),
        drive=enter,
        table=_table,
        checks=(("line-entry", "ttempc"),),
    ),
)
