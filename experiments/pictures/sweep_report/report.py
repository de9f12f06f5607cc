"""Report of a sweep: tables and charts as a page, charts as single figures."""

import itertools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

from ...output import write_file
from ...results.statistics import caveat
from ...results.summary import ACTUATOR_USE, BEYOND, EUCLIDEAN, PARTS
from ...results.tracking_errors import START_UP_S
from ..figures import png
from ..report.html import Picture, environment
from .charts import Panel, curve_panels, tail_panel
from .format import format_estimate, format_numbers, format_value
from .runs import Sweep, best, differences, groups

_DPI: Final = 160.0
_CENTRAL: Final = "nmpc"  # whose step the paper compares its own with
_MOST_WORST: Final = 4  # runs that are listed of each controller, half of its runs at most

Cell = tuple[str, float | str]
"""Text of a cell, and the value to sort by; a text counts as the text of the cell."""

Columns = dict[str, tuple[str, Callable[[Any], Cell]]]
"""Head of a column -> column of the frame, and what makes a cell of its entries."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of a page."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A group of charts."""

    title: str
    caption: str
    panels: list[Panel]


@dataclass(frozen=True, slots=True)
class SweepReport:
    """Content of a report."""

    sweep: Sweep
    method: str  # what a reader must know of the figures
    tables: dict[str, Table]
    sections: list[Section]


def make_report(sweep: Sweep) -> SweepReport:
    """Compute the content of a report."""
    against = best(sweep)
    table = groups(sweep)

    # Tables whose rows are the controllers
    paired = differences(sweep, against)
    tables = {"controllers": _table("Controllers: means over the runs", table, _means(sweep))}
    if len(paired):
        title = f"Differences to {against}, run by run; below zero: better than {against}"
        tables["differences"] = _table(title, paired, _of_pairs(against))
    use: Columns = {"control step [µs]": ("step_us", partial(_estimated, decimals=0))}
    use |= {head: (head, _estimated) for head, _, _ in ACTUATOR_USE}
    tables["use"] = _table("Computation time, use of the actuators", table, _CONTROLLER | use)
    tables["paper"] = _table(
        f"Mean distance to the time-based reference; times beside those of {_CENTRAL}",
        _beside_central(table),
        _as_in_the_paper(),
    )
    tables["worst"] = _table("Worst runs", _worst(sweep), _of_runs(sweep))

    # Figures, and a table of the points of axes that have few
    sections = [
        Section(
            "Tails of the error",
            "A run that did not complete counts as worse than any. Dashed: the worst 5 %.",
            [tail_panel(sweep)],
        )
    ]
    scales = sweep.scales
    listed = [scale for scale in scales if not scale.binned]
    if scales:
        curves = [curve_panels(sweep, scale, groups(sweep, [scale])) for scale in scales]
        caption = "Bands: 95 % intervals. Where many runs fail, those that complete are the best."
        sections.append(Section("One axis at a time", caption, [*itertools.chain(*curves)]))
    if listed:
        places: Columns = {
            scale.label: (scale.column, lambda place, texts=scale.texts: (texts[place], place))
            for scale in listed
        }
        tables["points"] = _table("Points", groups(sweep, listed), places | _means(sweep))
    return SweepReport(sweep, _method(sweep), tables, sections)


def write_report(report: SweepReport, folder: Path) -> Path:
    """Write the page into the folder of the sweep, in place of an earlier one; return its path.

    Raises:
        OutputExists: the folder cannot be written to; an earlier page is unchanged.
    """
    file = folder / "report" / "report.html"
    write_file(file, _render_page(report))
    return file


def plain_cells(table: Table) -> list[list[str]]:
    """Return the cells of a table as text, without links."""
    return [[Markup(cell).striptags() for cell, _ in row] for row in table.rows]


def panel_figures(report: SweepReport) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the charts of a report, each as a figure of its own, by name."""
    return {
        re.sub(r"[^a-z0-9]+", "-", panel.title.lower()).strip("-"): panel.figure
        for section in report.sections
        for panel in section.panels
    }


def _render_page(report: SweepReport) -> str:
    """Return the text of `report.html`, which lies in a subfolder of the sweep's folder."""
    sweep = report.sweep
    charts = [
        (section, [Picture.of(p.title, p.title, png(p.figure(), _DPI)) for p in section.panels])
        for section in report.sections
    ]
    state = f"{len(sweep.rows)} of {sweep.planned} runs"
    state += f", {sweep.missing} missing" if sweep.missing else ""
    state += f", {sweep.refused} refused by a scenario or a controller" if sweep.refused else ""
    seeds = format_numbers(sweep.study.point_seeds)
    state += f"; seeds {seeds}, the same ground and noise for every controller"
    template = environment().get_template("sweep.html.j2")
    return template.render(
        report=report, sweep=sweep, state=state, charts=charts, study_toml=sweep.study.dump()
    )


def _method(sweep: Sweep) -> str:
    limit = ""
    if sweep.limit_m is not None:
        limit = f", or where that error exceeds {100.0 * sweep.limit_m:g} cm"
    rows = sweep.rows
    unmeasured = int((rows["status"].eq("completed") & rows["error_cm"].isna()).sum())
    sentences = (
        "Errors are the 95th percentile of the unsigned cross-track error of the "
        f"{sweep.point} in a run, of runs that completed; sd is its standard deviation.",
        f"A run fails where it does not complete (lost, invalid, failed, crashed){limit}.",
        f"Completed without an error, shorter than {START_UP_S:g} s: {unmeasured} runs."
        if unmeasured
        else "",
        "In brackets: 95 % intervals; failure rates by Clopper and Pearson, means and "
        f"differences by Student's t over whole {sweep.units}.",
        caveat(rows["unit"].nunique(), sweep.units),
        "Simulation.",
    )
    return " ".join(filter(None, sentences))


def _means(sweep: Sweep) -> Columns:
    """Return the columns of controllers, overall or at a point: failures and errors."""
    failures: Columns = {"failed": ("failed", _plain), "failed [%]": ("rate", _percent)}
    return {
        **_CONTROLLER,
        "runs": ("runs", _plain),
        **(failures if sweep.rows["failed"].any() else {}),
        f"{sweep.point} p95 [cm]": ("error_cm", _estimated),
        f"{sweep.point} sd [cm]": ("sd_cm", _estimated),
        "tractor p95 [cm]": ("tractor_cm", _estimated),
    }


def _beside_central(table: pd.DataFrame) -> pd.DataFrame:
    """Return the groups with the share of the central NMPC's step, None where it was not driven."""
    central = table.loc[table["controller"] == _CENTRAL, "step_us"]
    step = central.iloc[0] if len(central) else None
    shares = [own.value / step.value if own and step else None for own in table["step_us"]]
    return table.assign(share=pd.Series(shares, table.index, dtype=object))


def _as_in_the_paper() -> Columns:
    """Return the columns of the paper's table, and what it says of inputs and times."""
    two = partial(_estimated, decimals=2)
    columns: Columns = {head: (head, two) for head, _, _ in (*EUCLIDEAN, *PARTS)}
    columns |= {head: (head, _estimated) for head, _, _ in BEYOND}
    columns["control step [µs]"] = ("step_us", partial(_estimated, decimals=0))
    columns[f"of {_CENTRAL}"] = ("share", _share)
    return _CONTROLLER | columns


def _share(value: Any) -> Cell:  # noqa: ANN401 - an entry of a row
    return ("–", "") if value is None else (f"{value:.2f}", value)


def _of_pairs(against: str) -> Columns:
    return {
        **_CONTROLLER,
        "paired runs": ("runs", _plain),
        "both completed": ("pairs", _plain),
        "difference [cm]": ("difference", partial(_estimated, sign="+")),
        "it alone failed": ("alone", _plain),
        f"{against} alone failed": ("other", _plain),
    }


def _of_runs(sweep: Sweep) -> Columns:
    axes = (key for key in sweep.study.names if key != "controller")
    columns: Columns = {
        "run": ("run", _plain),
        **_CONTROLLER,
        "seed": ("seed", _plain),
        **{key.rpartition(".")[2]: (key, lambda v: (format_value(v), v)) for key in axes},
        "status": ("status", _plain),
        "error [cm]": ("error_cm", lambda cm: ("–", "") if math.isnan(cm) else (f"{cm:.1f}", cm)),
    }
    columns |= {"log": ("log", _link)} if sweep.rows["log"].ne("").any() else {}
    return columns | ({"why": ("failure", _plain)} if sweep.rows["failure"].ne("").any() else {})


def _worst(sweep: Sweep) -> pd.DataFrame:
    """Return the worst runs of each controller; those not completed first, with a log before."""
    rows = sweep.rows
    without = np.where(rows["status"].eq("completed"), -np.inf, np.inf)
    severity = rows["error_cm"].fillna(pd.Series(without, rows.index))
    ordered = rows.assign(severity=severity, bare=rows["log"].eq("")).sort_values(
        ["controller", "severity", "bare", "run"], ascending=[True, False, True, True]
    )
    own = ordered.groupby("controller", observed=True)
    most = (own["run"].transform("size") // 2).clip(1, _MOST_WORST)
    return ordered[own.cumcount() < most]


def _table(title: str, frame: pd.DataFrame, columns: Columns) -> Table:
    rows = tuple(
        tuple(cell(row[column]) for column, cell in columns.values())
        for row in frame.to_dict("records")
    )
    return Table(title, tuple(columns), rows)


def _plain(value: Any) -> Cell:  # noqa: ANN401 - any entry of a row
    return str(value), value


def _link(log: str) -> Cell:
    return Markup('<a href="../{0}">log</a>').format(log) if log else "", log


def _percent(rate: Any) -> Cell:  # noqa: ANN401 - a proportion out of a frame
    low, high = rate.ends
    return f"{100 * rate.value:.0f} ({100 * low:.0f} to {100 * high:.0f})", rate.value


def _estimated(estimate: Any, decimals: int = 1, sign: str = "") -> Cell:  # noqa: ANN401
    """Return a cell of an estimate; None: there is none."""
    return format_estimate(estimate, decimals, sign), estimate.value if estimate else ""


_CONTROLLER: Final[Columns] = {"controller": ("controller", _plain)}
