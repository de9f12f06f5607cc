"""Guidance at working speed: the measure of a field record, the true error, and rivals.

An analysis of 8,047 engagements of seven machines with active implement guidance has the medians of
the standard deviation of the cross-track error that each machine reports of itself, on a pass, with
its own receivers ("Active implement guidance", CNH, doi 10.13031/aim.202500309; abstract alone
read). It has no true error; ours stands beside.
"""

from typing import Final, NamedTuple

import numpy as np
import pandas as pd

from ...studies.sweep.results import WORKING_P95
from ..markdown import lost, markdown, numbers
from ..table import Table, listed, study

SEEDS: Final = range(3321, 3323)
RIVALS: Final = ("nmpc-rti", "romea-predictive", "romea-backstepping", "lqr", "pid")
OURS: Final = "ttempc"


class WorkingPoint(NamedTuple):
    """A speed, and what a field record and we ask of it."""

    scenario: str
    overrides: tuple[str, ...]
    published: str  # median of the standard deviation that machines report
    asked_cm: float | None  # our goal for the true standard deviation


POINTS: Final[dict[str, WorkingPoint]] = {
    "passes, 5 km/h": WorkingPoint("work-passes", ("path.speed_mps=1.4",), "< 1.3 (4-6 km/h)", 1.0),
    "passes, 10 km/h": WorkingPoint("work-passes", (), "< 2.0 (8-10 km/h)", 1.3),
    "passes, 15 km/h": WorkingPoint("fast-passes", (), "3.0 (15.4 km/h)", 1.8),
    "reverse, 4.3 km/h": WorkingPoint("work-reverse", (), "< 3 (1.4-3.8 km/h)", 2.0),
    "eight, 10 km/h": WorkingPoint("work-eight", (), "–", None),
    "eight, 15 km/h": WorkingPoint("fast-eight", (), "–", None),
}
"""Working points, all with good receivers and IMUs."""


def table(runs: pd.DataFrame) -> str:
    """Return standard deviations on passes of `ttempc`, then the p95 of all controllers."""
    spreads = []
    errors = []
    for name, point in POINTS.items():
        here = runs[runs["study"] == name]
        ours = here[here["controller"] == OURS]
        asked = "–" if point.asked_cm is None else f"{point.asked_cm:.1f}"
        figures = (_spread(ours, figure) for figure in ("seen_cross_sd_m", "cross_sd_m"))
        spreads.append((name, point.published, *figures, asked))
        errors.append((name, *(_p95(here[here["controller"] == rival]) for rival in _ALL)))
    heads = (
        "standard deviation on a pass, median [cm]",
        "machines of the record, by themselves",
        "`ttempc`, by itself",
        "`ttempc`, true",
        "goal for the true one",
    )
    columns = ("p95 of the working point [cm]", *(f"`{name}`" for name in _ALL))
    return "\n\n".join((markdown(heads, spreads), markdown(columns, errors)))


_ALL: Final = (OURS, *RIVALS)


def _spread(runs: pd.DataFrame, figure: str) -> str:
    """Return the median over runs of a figure of the working point on passes as text [cm]."""
    tool = numbers(runs, f"passes.tool.{figure}")
    trailer = numbers(runs, f"passes.trailer.{figure}")
    return f"{100.0 * float(np.nanmedian(np.where(np.isfinite(tool), tool, trailer))):.2f}"


def _p95(runs: pd.DataFrame) -> str:
    """Return the mean error of completed runs as text [cm], and what is lost."""
    completed = runs[runs["status"] == "completed"]
    if completed.empty:
        return lost(runs)
    text = f"{100.0 * float(np.mean(numbers(completed, WORKING_P95))):.2f}"
    return text if len(completed) == len(runs) else f"{text}, {lost(runs)} lost"


TABLES: Final = (
    Table(
        name="working-speed",
        studies={
            name: study(point.scenario, SEEDS, point.overrides, listed("controller", *_ALL))
            for name, point in POINTS.items()
        },
        text=table,
        checks=(("work-passes", OURS), ("fast-eight", OURS), ("work-reverse", OURS)),
    ),
)
