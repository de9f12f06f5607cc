"""Widths that whole laps keep to: the corridor of `rows`, and half widths of fields."""

from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...results.statistics import proportion
from ...seeds import FITTING, report_seeds
from ...studies.sweep.study import Study
from ...studies.tubes.calibration import calibrated_widths
from ..markdown import Cell, grouped, groups, label, markdown, numbers, slash
from ..table import Table, listed, study

LAPS: Final = 200
HALF_WIDTH_M: Final = 0.06  # of the corridor of `rows`, which has 0.10 m itself
FULL_SPEED: Final = (f"corridor.half_width_m={HALF_WIDTH_M}", "sensors.imu.on=true")
FAST_STEERING: Final = "controller.options.step_weight=[0.03, 0.01, 0.1]"  # tuned on seeds 11 to 16
OWN_OPTIONS: Final = {
    "ttempc": ("controller.options.corridor=false", FAST_STEERING),
    "pid": ('controller.name="pid"',),
    "lqr": ('controller.name="lqr"', FAST_STEERING),
    "nmpc-rti": ('controller.name="nmpc-rti"', FAST_STEERING),
}
MEANS: Final = {  # laps of each controller, changes
    "": (60, ()),
    ", half the speed": (15, ("path.speed_mps=0.5",)),
    ", true state": (15, ('controller.estimator="truth"',)),
}

FIELDS: Final = ("pavement", "grass", "wet-slope", "patchy", "furrows")
FRESH_LAPS: Final = 100
FITTED_LAPS: Final = 40  # a coverage of 99 % would take 123
JUDGED: Final = (
    "path.laps=1",
    "corridor.half_width_m=1.0",  # the run is compared with it, and `ttempc` is not told
    "controller.options.corridor=false",
)
COVERAGE: Final = 0.95  # of the conformal half widths


def distances(runs: pd.DataFrame) -> FloatArray:
    """Return the largest distances of tractor and trailer point from the path after the first 8 s.

    Returns:
        (n, 2) [m], infinite for a lost run.
    """
    found = numbers(runs, "corridor.tractor.max_m", "corridor.trailer.max_m")
    kept = (runs["status"] == "completed").to_numpy()[:, None] & np.isfinite(found)
    return np.where(kept, found, np.inf)


def _corridor_studies() -> dict[str, Study]:
    """Return the studies by the name of their controller: same filter, sensors and speed."""
    studies = {}
    for with_, (laps, means) in MEANS.items():
        for name, own in OWN_OPTIONS.items():
            seeds = report_seeds(LAPS if name == "ttempc" and not means else laps)
            studies[f"`{name}`{with_}"] = study("rows", seeds, (*FULL_SPEED, *own, *means))
    return studies


def corridor(runs: pd.DataFrame) -> str:
    """Return the laps outside +-6 cm with IMUs, by controller."""

    def point(n: int) -> Cell:
        def cell(own: pd.DataFrame) -> str:
            distance = 100.0 * distances(own)[:, n]
            return f"{np.median(distance):.1f}, {distance.max():.1f}"

        return cell

    cells: dict[str, Cell] = {
        "controller": label("study"),
        "laps outside (95 % interval)": lambda own: share(distances(own) > HALF_WIDTH_M),
        "tractor: median, largest [cm]": point(0),
        "trailer: median, largest [cm]": point(1),
        "time [s]": lambda own: f"{np.median(own['duration_s']):.0f}",
    }
    return grouped(runs, ["study"], cells)


def share(points: NDArray[np.bool_]) -> str:
    """Return how many laps have any of (laps, points) true, with the interval of the share."""
    found = proportion(int(points.any(axis=1).sum()), len(points))
    low, high = (100.0 * end for end in found.ends)
    return f"{found.count} of {found.total} ({low:.1f} to {high:.1f} %)"


def coverage(runs: pd.DataFrame) -> str:
    """Return half widths that 40 laps of each field give, and how many fresh laps leave them."""
    lines = []
    for own in groups(runs, ["scenario"]):
        fitted, fresh = (distances(own[own["study"] == name]) for name in ("fitted", "fresh"))
        lines.append([f"`{own['scenario'].iloc[0]}`", *coverage_cells(fitted, fresh)])
    return markdown(["field", *COVERAGE_HEADS], lines)


COVERAGE_HEADS: Final = (
    "half widths of 95 % [cm]",
    "promised inside",
    "fresh laps outside",
    "largest of them [cm]",
)


def coverage_cells(fitted: FloatArray, fresh: FloatArray) -> list[str]:
    """Return the cells of a field.

    The half widths are those of split-conformal prediction (`ttempc.tube.conformal`), to which the
    next lap keeps with 95 % whatever the distribution.

    Args:
        fitted: largest distances of tractor and trailer point in the fitted laps, (n, 2) [m].
        fresh: those in laps with other seeds, (m, 2); infinite, thus outside, for a lost lap.
    """
    widths, calibration = calibrated_widths(fitted, COVERAGE)
    return [
        slash(widths),
        f"{100.0 * calibration.coverage:.1f} %",
        share(fresh > widths),
        slash(fresh.max(axis=0)),
    ]


TABLES: Final = (
    Table(
        name="corridor",
        studies=_corridor_studies(),
        text=corridor,
        checks=tuple(("rows", name) for name in OWN_OPTIONS),
    ),
    Table(
        name="coverage",
        studies={
            "fitted": study("grass", FITTING[:FITTED_LAPS], JUDGED, listed("scenario", *FIELDS)),
            "fresh": study("grass", report_seeds(FRESH_LAPS), JUDGED, listed("scenario", *FIELDS)),
        },
        seeds=report_seeds(FRESH_LAPS),
        text=coverage,
        checks=tuple((name, "ttempc") for name in FIELDS),
    ),
)
