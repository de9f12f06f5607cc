"""Entry into a straight line from beside it, and the hitch angle, over a grid of starts.

The overshoot of a drive is judged against its floor: the largest distance of a point from the line
on the same drive without an offset. Beside the controllers stands a search among feedbacks of the
true state, by drives of the true plant.
"""

import math
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import qmc

from ttempc.types import Command, FloatArray

from ....testbed.errors import PlantDiverged
from ....testbed.recording.record import Record
from ...results.statistics import proportion
from ...results.summary import Summary
from ...results.tracking_errors import tracking_errors
from ...run.assembly import Assembly, assemble
from ...studies.sweep.row import Row
from ...studies.sweep.work import SweepJob, run_job
from ..markdown import Cell, grouped, label, numbers
from ..table import Table, study, variants

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
_SEARCH: Final = "search"
_FLOOR: Final = "floor"
CONTROLLERS: Final = {
    "`ttempc`": (),
    "same, `tube = false`": ("controller.options.tube=false",),
    "`nmpc-rti`": ("controller.name=nmpc-rti", "controller.options.damping_s=2"),
    "`lqr`": ("controller.name=lqr",),
    "`pid`": ("controller.name=pid",),
    _SEARCH: (),
}
_SPARE_M: Final = 0.02  # largest overshoot beyond its floor that counts as at the floor
_HOME_M: Final = 0.25  # largest distance from the line at the end
_LIMIT: Final = math.radians(45.0)
_LOST_M: Final = 5.0  # distance of the tractor from its reference at which a run ends
_SLOW_M: Final = 0.4  # error across beyond which a searched feedback may be slow
_BODIES: Final = ("tractor", "trailer")


def start(kind: str, seed: int) -> tuple[float, float]:
    """Return offset to the left [m] and heading [deg] that a seed draws, spread over the ranges."""
    draw = qmc.Halton(2, scramble=False).fast_forward(seed - _SEEDS[0] + 1).random(1)[0].tolist()
    most, turned = _RANGES[kind]
    side = 2.0 * draw[0] - 1.0
    offset = math.copysign(1.0 + (most - 1.0) * abs(side), side)
    return round(offset, 2), round(turned * (2.0 * draw[1] - 1.0), 1)


def starts(seed: int) -> dict[str, tuple[str, ...]]:
    """Return the starts of a seed by their kind; `_FLOOR` is on the line."""
    drawn = {kind: start(kind, seed) for kind in _RANGES}
    beside = {
        kind: (f"start.offset_m={offset}", f"start.heading_deg={heading}")
        for kind, (offset, heading) in drawn.items()
    }
    return {**beside, _FLOOR: ("start.offset_m=0",)}


# Ranges of a feedback's draws: heading per error across [rad/m], the largest heading [rad], in
# reverse curvature per heading error [1/m] and largest angle of the bodies [rad], curvature of the
# tractor per its error [1/m], drawbar per heading error, share of the speed beyond `_SLOW_M`
_LEAST: Final = np.array([0.1, 0.15, 0.3, 0.15, 0.8, -1.0, 0.2])
_MOST: Final = np.array([1.0, 1.0, 1.5, 0.8, 3.0, 1.0, 1.0])
_DRAWS: Final = 400
_STOPS: Final = np.radians([35.0, 24.0])  # largest angles of front and trailer steering [rad]


def search(job: SweepJob) -> dict[str, float]:
    """Return whether one of `_DRAWS` feedbacks brings the plant home within the hitch limit.

    A feedback sees the true state, asks the point in front for a heading that falls with its error
    across, and turns towards it; in reverse by the angle between the bodies, which the tractor's
    steering sets. It is no optimum: a start that it does not bring home may still have a way home.
    """
    assembly = assemble(job.scenario, job.seed)
    generator = np.random.default_rng(job.seed)
    for _ in range(_DRAWS):
        fold = _attempt(assembly, generator.uniform(_LEAST, _MOST).tolist())
        if fold < math.inf:
            return {"home": 1.0, "extremes.fold_rad": fold}
    return {"home": 0.0}


def _attempt(assembly: Assembly, draw: list[float]) -> float:
    """Return the largest hitch angle of a drive that comes home within `_LIMIT`, else inf."""
    near, cap, turn, most, rate, drawbar, slow = draw
    plant = assembly.plant
    period_s = assembly.guidance.period_s
    vehicle = assembly.reference.vehicle
    now = plant.restore(assembly.start)
    fold = 0.0
    length = vehicle.trailer_length + vehicle.drawbar_length
    steps = round(period_s / plant.timestep_s)
    path = assembly.reference.at(np.arange(assembly.ticks) * period_s)
    across = np.zeros(2)
    for state, trailer, inputs in zip(path.state, path.trailer_xy, path.inputs, strict=True):
        # Where both points are beside their references
        cos = math.cos(state[2])
        sin = math.sin(state[2])
        x = np.array([now.tractor.x - state[0], now.trailer.x - trailer[0]])
        y = np.array([now.tractor.y - state[1], now.trailer.y - trailer[1]])
        along = cos * x + sin * y
        across = cos * y - sin * x
        yaw_t = math.remainder(now.tractor.yaw - state[2], math.tau)
        yaw_i = math.remainder(now.trailer.yaw - state[3], math.tau)
        fold = max(fold, abs(now.beta))
        if fold > _LIMIT or math.hypot(along[0], across[0]) > _LOST_M:
            return math.inf

        # Forward the tractor comes to the line; in reverse it turns the trailer to it
        if state[6] < 0.0:
            missing = float(np.clip(near * across[1], -cap, cap)) - yaw_i
            folded = float(np.clip(-length * turn * missing, -most, most))
            curvature = math.sin(yaw_t - yaw_i) / length - rate * (folded - yaw_t + yaw_i)
        else:
            curvature = -rate * (float(np.clip(near * across[0], -cap, cap)) + yaw_t)
            missing = yaw_i + near * across[1]
        wanted = (math.atan(vehicle.wheelbase * curvature), drawbar * missing)
        angles = np.clip(wanted, -_STOPS, _STOPS).tolist()
        share = slow if np.abs(across).max() > _SLOW_M else 1.0
        try:
            now = plant.advance(Command(*angles, hp=float(share * inputs[2])), steps)
        except PlantDiverged:
            return math.inf
    return fold if np.abs(across).max() < _HOME_M else math.inf


def enter(job: SweepJob) -> Row:
    """Return the row of a start: of a drive, or of the search; floors are driven forward only."""
    searched = job.axes["variant"] == _SEARCH
    if job.axes["start"] == _FLOOR and (searched or job.scenario.mission().reverse):
        return job.row("completed", None, {}, None)
    if searched:
        return job.row("completed", None, search(job), None)
    return run_job(job, measure)


def measure(job: SweepJob, summary: Summary, record: Record) -> dict[str, float]:
    """Return whether a drive comes home, its overshoot and its largest errors [m]."""
    errors = tracking_errors(record)
    cross = [errors.by_point[body].cross_m for body in _BODIES]
    row = {
        f"{body}_most": float(np.abs(own).max()) for body, own in zip(_BODIES, cross, strict=True)
    }
    home = summary.status == "completed" and max(abs(own[-1]) for own in cross) < _HOME_M
    row["home"] = float(home)
    if home and summary.entry is not None:
        of_bodies = [getattr(summary.entry, body) for body in _BODIES]
        row |= {
            f"{body}_over": own.overshoot_m for body, own in zip(_BODIES, of_bodies, strict=True)
        }
        settled = [own.settled_m for own in of_bodies]
        if None not in settled:
            row["settled"] = max(settled)
    return row


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


def _excess(runs: pd.DataFrame) -> pd.Series:
    """Return by how much overshoots exceed the errors of the same drives on the line; lost: inf."""
    keys = ["ground", "variant", "seed"]
    most = [f"{body}_most" for body in _BODIES]
    floor = runs[runs["start"] == _FLOOR].set_index(keys)[most]
    own = runs[keys].join(floor, on=keys)
    beyond = pd.DataFrame({body: runs[f"{body}_over"] - own[f"{body}_most"] for body in _BODIES})
    return beyond.max(axis=1, skipna=False).where(runs["home"] == 1.0, math.inf)


def _table(runs: pd.DataFrame) -> str:
    """Return how many starts come home, and how well, by ground and controller."""
    keys = ["ground", "start", "seed"]
    over = runs[[f"{body}_over" for body in _BODIES]].max(axis=1)
    runs = runs.assign(over=over, home=runs["home"].fillna(0.0))
    runs = runs.assign(excess=_excess(runs))
    runs = runs[runs["start"] != _FLOOR]
    found = runs[runs["variant"] == _SEARCH].set_index(keys)["home"]
    fails = (runs["home"] < 1.0) | (runs["extremes.fold_rad"] > _LIMIT)
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


TABLES: Final = (
    Table(
        name="entry",
        studies={
            f"entry {seed}": study(
                "line-entry",
                (seed,),
                (),
                variants("ground", GROUNDS),
                variants("variant", CONTROLLERS),
                variants("start", starts(seed)),
            )
            for seed in _SEEDS
        },
        work=enter,
        text=_table,
        checks=(("line-entry", "ttempc"),),
    ),
)
