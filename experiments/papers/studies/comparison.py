"""Controllers on shipped scenarios, and over the shipped sweeps.

The error of a run is the 95th percentile of the absolute cross-track error of the working point:
the tool where there is one, else the trailer's axle point.
"""

from functools import cached_property
from typing import Any, Final

import numpy as np
import pandas as pd

from ...pictures.sweep_report.format import format_estimate
from ...results.statistics import IntervalEstimate, caveat, holm, mean, paired_p
from ...results.summary import ACTUATOR_USE
from ...seeds import TUNED_FIELDS
from ...studies.sweep.results import WORKING_P95
from ...studies.sweep.study import DrawnAxis, load_study
from ..markdown import markdown
from ..table import Table

DEFAULT: Final = "ttempc"  # that the others are compared with
LEVEL: Final = 0.05  # of the tests, after Holm's correction
_STEP: Final = "timing.control_step_us.median"


class Comparison:
    """Runs of several controllers on several fields under the same seeds."""

    def __init__(self, rows: pd.DataFrame) -> None:
        self.rows = rows.assign(completed=rows["status"] == "completed")
        self.fields = sorted(rows["scenario"].unique())
        self.controllers = [*rows["controller"].unique()]  # in the order of the sweep
        self.seeds = rows["seed"].nunique()
        self.error_cm = 100.0 * self.column(WORKING_P95)

    def column(self, name: str) -> pd.DataFrame:
        """Return a column of the rows: one line a field and controller, one column a seed.

        NaN where a run did not complete, was refused, or has no such figure.
        """
        known = self.rows.assign(value=self.rows[name].where(self.rows["completed"]))
        return known.pivot(index=["scenario", "controller"], columns="seed", values="value")

    def runs(self, field: str, controller: str) -> pd.DataFrame:
        """Return the runs of a controller on a field; none where they were refused."""
        own = self.rows["scenario"].eq(field) & self.rows["controller"].eq(controller)
        return self.rows[own]

    def lost(self, field: str, controller: str) -> str:
        """Return why a mean over the seeds would say nothing, "" where every run completed."""
        own = self.runs(field, controller)
        if not len(own):
            return "not driven"
        lost = int((~own["completed"]).sum())
        return f"{lost} of {len(own)} lost" if lost else ""

    @cached_property
    def log_ratio(self) -> pd.DataFrame:
        """Logarithm of each error over the default controller's, as `column`.

        Without the fields of a controller on which one of the two lost a run: a mean over the seeds
        that were easy enough would favour the weaker controller.
        """
        logs = self.error_cm.map(np.log)
        own = logs.xs(DEFAULT, level="controller")
        return logs.sub(own, level="scenario").dropna()

    @cached_property
    def ratios(self) -> dict[tuple[str, str], tuple[IntervalEstimate, float]]:
        """Error over the default controller's by field and rival, and its p-value.

        The ratio is the geometric mean over seeds; p of no difference is adjusted after Holm for
        all comparisons, NaN for a single seed.
        """
        logs = self.log_ratio.drop(index=DEFAULT, level="controller")
        order = [(field, name) for field in self.fields for name in self.controllers]
        logs = logs.reindex([key for key in order if key in logs.index])
        p = holm([paired_p(row) for row in logs.to_numpy()])
        means = [_exp(mean(row)) for row in logs.to_numpy()]
        keys = [(str(field), str(name)) for field, name in logs.index]
        return dict(zip(keys, zip(means, p.tolist(), strict=True), strict=True))

    def verdict(self, field: str, controller: str) -> str:
        """Return "better", "worse", or "" where the difference is not significant."""
        ratio, p = self.ratios.get((field, controller), (None, 1.0))
        if ratio is None or not p < LEVEL:
            return ""
        return "better" if ratio.value < 1.0 else "worse"

    def over_fields(self, controller: str) -> tuple[IntervalEstimate | None, int]:
        """Return the geometric mean of a controller's ratios over fields, and their number.

        Each field counts the same, so that none dominates by its size; seeds are the units.
        """
        if controller not in self.log_ratio.index.get_level_values("controller"):
            return None, 0
        logs = self.log_ratio.xs(controller, level="controller").to_numpy()
        return _exp(mean(logs.mean(axis=0))), len(logs)


def _exp(estimate: IntervalEstimate) -> IntervalEstimate:
    """Return an estimate of a logarithm as one of the number."""
    ends = (None if end is None else float(np.exp(end)) for end in (estimate.low, estimate.high))
    return IntervalEstimate(float(np.exp(estimate.value)), *ends)


def controllers(rows: pd.DataFrame) -> str:
    """Return cost, error and use of actuators of every controller, and errors by field.

    The use of the actuators is the median of the runs that completed. Errors by field have < where
    they are significantly less than those of the default one, > where more.
    """
    comparison = Comparison(rows)
    done = comparison.rows[comparison.rows["completed"]]
    keys = [_STEP, *(key for _, key, _ in ACTUATOR_USE)]
    medians: Any = done.groupby("controller")[keys].median().T.to_dict()
    lines = []
    for name in comparison.controllers:
        ratio, fields = comparison.over_fields(name)
        verdicts = [comparison.verdict(field, name) for field in comparison.fields]
        own = rows[rows["controller"] == name]
        cost = medians[name][_STEP]
        lines.append(
            (
                f"`{name}`",
                f"{cost:.0f}",
                f"{cost / medians[DEFAULT][_STEP]:.2f}",
                "1" if name == DEFAULT else format_estimate(ratio, 3),
                str(fields),
                f"{verdicts.count('better')} / {verdicts.count('worse')}",
                f"{(own['status'] != 'completed').sum()} of {len(own)}",
                *(f"{factor * medians[name][key]:.1f}" for _, key, factor in ACTUATOR_USE),
            )
        )
    heads = ("controller", "step [µs]", f"/ `{DEFAULT}`", f"error / that of `{DEFAULT}`", "fields")
    heads = (*heads, "better / worse", "lost", *(head for head, _, _ in ACTUATOR_USE))
    signs = {"better": " <", "worse": " >", "": ""}

    def cell(field: str, name: str) -> str:
        error = comparison.runs(field, name)[WORKING_P95].mean()
        text = f"{100.0 * error:.2f}{signs[comparison.verdict(field, name)]}"
        return comparison.lost(field, name) or text

    names = comparison.controllers
    by_field = [
        (
            f"`{field}`",
            ", ".join(what for what, fields in TUNED_FIELDS.items() if field in fields) or "–",
            *(cell(field, name) for name in names),
        )
        for field in comparison.fields
    ]
    head = ("field", "tuned here", *(f"`{name}`" for name in names))
    tables = (markdown(heads, lines), markdown(head, by_field), caveat(comparison.seeds))
    return "\n\n".join(filter(None, tables))


SWEEPS: Final = ("terrain-slip", "delay", "noise", "speed-radius", "mismatch")
"""Sweeps side by side; `ttempc report` makes a page of each."""


def side_by_side(rows: pd.DataFrame) -> str:
    """Return the errors of all sweeps, with the paired differences of the rivals."""
    lines = []
    shown = [DEFAULT, *(name for name in rows["controller"].unique() if name != DEFAULT)]
    for name, own in rows.groupby("study", sort=False):
        _, study = load_study(str(name))
        drawn = any(isinstance(axis, DrawnAxis) for axis in study.axis)
        unit = "point" if drawn else "seed"
        done = own[own["status"] == "completed"]
        cells = []
        for controller in shown:
            driven = done[done["controller"] == controller].dropna(subset=[WORKING_P95])
            error = mean(100.0 * driven[WORKING_P95].to_numpy(float), driven[unit].to_numpy())
            count = (own["controller"] == controller).sum()
            lost = count - (done["controller"] == controller).sum()
            cells.append(format_estimate(error) + (f", {lost} of {count} lost" if lost else ""))
        pairs = done.pivot(index=["point", "seed"], columns="controller", values=WORKING_P95)
        for rival in shown[1:]:
            gap = 100.0 * (pairs[rival] - pairs[DEFAULT]).dropna()
            estimate = mean(gap.to_numpy(float), gap.index.get_level_values(unit).to_numpy())
            cells.append(f"{format_estimate(estimate, sign='+')} of {len(gap)}")
        lines.append((f"`{name}`", str(len(own)), study.description, *cells))
    heads = ("study", "runs", "varied", *(f"`{name}`" for name in shown))
    pairs = (f"`{rival}` - `{DEFAULT}`, pairs" for rival in shown[1:])
    return markdown((*heads, *pairs), lines)


TABLES: Final = (
    Table(name="compare", text=controllers, sweeps=("compare",)),
    Table(name="studies", text=side_by_side, sweeps=SWEEPS),
)
