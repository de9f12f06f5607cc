"""Report of a sweep: tables and charts as a page, charts as single figures."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ...testbed.atomic_write import atomic_write
from ..errors import BadOptions, OutputExists
from ..figures import png
from ..report.html import Picture, environment
from ..results.statistics import TAIL, caveat
from ..results.summary import ACTUATOR_USE
from ..sweep.row import unmeasured_text
from .charts import Panel, cost_panel, curve_panels, difference_panel, map_panels, tail_panel
from .format import (
    format_estimate,
    format_numbers,
    format_percent,
    format_value,
    rerun_command,
)
from .runs import Sweep, differences, groups, ranking, tails

PLACE: Final = "report"
"""Name of the report's folder in the folder of its sweep."""

_DPI: Final = 160.0
_MOST_MAPS: Final = 3  # pairs of axes
_MOST_WORST: Final = 4  # runs that are listed of each controller


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table."""

    text: str
    value: float | str | None = None  # to sort by; None: the text
    runs: str = ""  # numbers of the runs that it stands for
    links: tuple[tuple[str, str], ...] = ()  # names and targets


Columns = dict[str, tuple[str, Callable[[Any], Cell]]]
"""Head of a column -> column of the frame, and what makes a cell of its entries."""


@dataclass(frozen=True, slots=True)
class Table:
    """A table of a page."""

    name: str
    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A group of charts."""

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True)
class SweepReport:
    """Content of a report."""

    sweep: Sweep
    against: str  # the controller that the others are compared with
    method: str  # what a reader must know of the figures
    tables: tuple[Table, ...]  # of controllers
    cells: Table | None  # of every combination of values
    sections: tuple[Section, ...]


def make_report(sweep: Sweep, against: str | None = None) -> SweepReport:
    """Compute the content of a report.

    Args:
        sweep: the runs.
        against: the controller that the others are compared with; None: the best of them.

    Raises:
        BadOptions: the study has no such controller.
    """
    if against is not None and against not in sweep.controllers:
        raise BadOptions(f"--against {against}: the study has {', '.join(sweep.controllers)}")
    ranked = ranking(sweep)
    against = against or ranked[0]
    rival = next((name for name in ranked if name != against), "")
    table = groups(sweep).merge(tails(sweep), on="controller")
    paired = differences(sweep, against)
    if len(paired):
        table = table.merge(
            paired[["controller", "error"]].rename(columns={"error": "difference"}),
            on="controller",
            how="left",
        )
    return SweepReport(
        sweep,
        against,
        _method(sweep),
        _controller_tables(sweep, table, paired, against),
        _cells(sweep),
        tuple(_sections(sweep, table, paired, against, rival)),
    )


def write_report(report: SweepReport, folder: Path) -> Path:
    """Write the page into the folder of the sweep, in place of an earlier one; return its path.

    Raises:
        OutputExists: the folder cannot be written to; an earlier page is unchanged.
    """
    target = folder / PLACE
    page = render_page(report, folder).encode()
    try:
        target.mkdir(parents=True, exist_ok=True)
        with atomic_write(target / "report.html") as file:
            file.write(page)
    except OSError as error:
        raise OutputExists(f"output {target}: cannot be written: {error.strerror}") from None
    return target / "report.html"


def panel_figures(report: SweepReport) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the charts of a report, each as a figure of its own, by name."""
    return {
        re.sub(r"[^a-z0-9]+", "-", f"{section.name} {panel.title}".lower()).strip("-"): panel.figure
        for section in report.sections
        for panel in section.panels
    }


def render_page(report: SweepReport, folder: Path) -> str:
    """Return the text of `report.html`, which lies in a subfolder of the sweep's folder."""
    sweep = report.sweep
    charts = [
        (section, [_picture(f"{section.name}-{n}", p) for n, p in enumerate(section.panels)])
        for section in report.sections
    ]
    template = environment().get_template("sweep.html.j2")
    return template.render(
        report=report,
        sweep=sweep,
        state=_state(sweep),
        charts=charts,
        worst=_runs_table("worst", "Worst runs", sweep, _worst(sweep), folder),
        every=_runs_table("every", "All runs", sweep, sweep.rows, folder),
        study_toml=sweep.study.dump(),
    )


def _picture(name: str, panel: Panel) -> Picture:
    figure = panel.figure()
    figure.set_dpi(_DPI)
    return Picture.of(name, panel.title, png(figure, _DPI))


def _state(sweep: Sweep) -> str:
    """Return size and progress of a sweep."""
    state = f"{len(sweep.rows)} of {sweep.planned} runs"
    state += f", {sweep.missing} missing" if sweep.missing else ""
    state += f", {sweep.refused} refused by a scenario or a controller" if sweep.refused else ""
    seeds = format_numbers(sweep.study.point_seeds)
    return f"{state}; seeds {seeds}, the same ground and noise for every controller"


def _method(sweep: Sweep) -> str:
    limit = ""
    if sweep.limit_m is not None:
        limit = f", or where that error exceeds {100.0 * sweep.limit_m:g} cm"
    sentences = (
        "Errors are the 95th percentile of the unsigned cross-track error of the "
        f"{sweep.point} in a run, of runs that completed; sd is its standard deviation.",
        f"A run fails where it does not complete (lost, invalid, failed, crashed){limit}.",
        unmeasured_text(sweep.unmeasured, sweep.limit_m),
        "In brackets: 95 % intervals; failure rates by Clopper and Pearson, means and "
        f"differences by Student's t over whole {sweep.units}, tails by bootstrap over them.",
        caveat(sweep.rows["unit"].nunique(), sweep.units, tails=True),
        "Simulation.",
    )
    return " ".join(filter(None, sentences))


def _controller_tables(
    sweep: Sweep, table: pd.DataFrame, paired: pd.DataFrame, against: str
) -> tuple[Table, ...]:
    """Return failures and errors of the controllers, differences, and tails and costs."""
    errors: Columns = {
        "controller": ("controller", Cell),
        "runs": ("runs", _picked),
        "failed": ("failed", _picked),
        "failed [%]": ("rate", _percent),
        f"{sweep.point} p95 [cm]": ("error", _estimated),
        f"minus {against} [cm]": ("difference", _signed),
        f"{sweep.point} sd [cm]": ("sd_cm", _estimated),
        "tractor p95 [cm]": ("tractor_cm", _estimated),
    }
    of_pairs: Columns = {
        "controller": ("controller", Cell),
        "paired runs": ("runs", _picked),
        "both completed": ("pairs", lambda count: Cell(str(count))),
        "difference [cm]": ("error", _signed),
        "it alone failed": ("alone", _picked),
        f"{against} alone failed": ("other", _picked),
    }
    if not sweep.rows["failed"].any():
        errors = {head: column for head, column in errors.items() if "failed" not in head}
        of_pairs = {head: column for head, column in of_pairs.items() if "failed" not in head}
    of_tails: Columns = {
        "controller": ("controller", Cell),
        "95 % of runs below [cm]": ("quantile95", _estimated),
        "mean of worst 5 % [cm]": ("cvar95", _estimated),
        "control step [µs]": ("step_us", partial(_estimated, decimals=0)),
        **{head: (head, _estimated) for head, _, _ in ACTUATOR_USE},
    }
    first = _table("controllers", "Controllers", table, errors, "Means over the runs.")
    last = "Tails, computation time, use of the actuators"
    tables = [first, _table("tails", last, table, of_tails)]
    if len(paired):
        title = f"Differences to {against}, run by run"
        note = f"Below zero: better than {against} under the same points and seeds."
        tables.insert(1, _table("differences", title, paired, of_pairs, note))
    return tuple(tables)


def _sections(
    sweep: Sweep, table: pd.DataFrame, paired: pd.DataFrame, against: str, rival: str
) -> list[Section]:
    """Return the groups of charts; maps show the difference of `rival` to `against`."""
    overview = [tail_panel(sweep), cost_panel(sweep, table)]
    overview += [difference_panel(sweep, against, paired)] if len(paired) else []
    scales = [scale for scale in sweep.scales if len(scale.texts) > 1]
    pooled = " All other axes are pooled."
    sections = [
        Section(
            "overview",
            "Tail of the error, computation time, differences",
            "Tails: share of all runs with a larger error; a run that did not complete counts as "
            "larger than any. Dashed: the worst 5 %. Bars: 95 % intervals.",
            tuple(overview),
        )
    ]
    pairs = itertools.combinations([scale for scale in scales if not scale.binned], 2)
    for number, pair in enumerate([*pairs][:_MOST_MAPS], 1):
        # The axis with more values is horizontal, where a page is wider.
        up, across = sorted(pair, key=lambda scale: len(scale.texts))
        caption = "Mean error of the runs that completed; hatched where none did."
        of_rival = pd.DataFrame()
        if rival:
            of_rival = differences(sweep, against, [across, up])
            of_rival = of_rival[of_rival["controller"] == rival] if len(of_rival) else of_rival
            caption += (
                f" First, of pairs that completed, the error of {rival} less that of {against}: "
                f"blue where {rival} is better."
            )
        caption += " Last, the share of runs that failed." if sweep.rows["failed"].any() else ""
        maps = map_panels(sweep, across, up, groups(sweep, [across, up]), of_rival, against)
        sections.append(
            Section(
                f"maps-{number}" if number > 1 else "maps",
                f"{up.label} against {across.label}",
                caption + (pooled if len(scales) > 2 else ""),
                tuple(maps),
            )
        )
    if scales:
        panels = [curve_panels(sweep, scale, groups(sweep, [scale])) for scale in scales]
        caption = (
            "Bands: 95 % intervals. Errors are those of completed runs: where many fail, they "
            "are a selection of the best runs."
        ) + (pooled if len(scales) > 1 else "")
        flat = tuple(itertools.chain.from_iterable(panels))
        sections.append(Section("curves", "One axis at a time", caption, flat))
    return sections


def _cells(sweep: Sweep) -> Table | None:
    """Return failures and errors at every combination of values, None without such an axis."""
    scales = [scale for scale in sweep.scales if not scale.binned]
    if not scales:
        return None
    columns: Columns = {
        scale.label: (scale.label, lambda place, texts=scale.texts: Cell(texts[place], place))
        for scale in scales
    }
    columns["controller"] = "controller", Cell
    if sweep.rows["failed"].any():
        columns["failed [%]"] = "rate", _percent
    columns[f"{sweep.point} p95 [cm]"] = "error", _estimated
    columns["runs"] = (
        "runs",
        lambda runs: Cell(format_numbers(runs), len(runs), format_numbers(runs)),
    )
    return _table("cells", "Points", groups(sweep, scales), columns)


def _worst(sweep: Sweep) -> pd.DataFrame:
    """Return the worst runs of each controller: those not completed, with a log first; by error.

    They are the failed ones and the worst 5 %, one run at least and `_MOST_WORST` at most.
    """
    rows = sweep.rows
    without = np.where(rows["status"].eq("completed"), -np.inf, np.inf)
    ordered = rows.assign(
        severity=rows["error_cm"].fillna(pd.Series(without, rows.index)), bare=rows["log"].eq("")
    ).sort_values(["severity", "bare", "run"], ascending=[False, True, True])
    worst = []
    for _, own in ordered.groupby("controller", observed=True):
        count = max(1, int(own["failed"].sum()), math.ceil(TAIL * len(own)))
        worst.append(own.head(min(_MOST_WORST, count)))
    return pd.concat(worst)


def _runs_table(name: str, title: str, sweep: Sweep, rows: pd.DataFrame, folder: Path) -> Table:
    """Return a table of single runs; of the worst ones, how to drive each again."""

    def links(log: str) -> Cell:
        files = {"log": folder / log, "film": (folder / log).with_suffix(".mp4")} if log else {}
        there = {name: file for name, file in files.items() if file.is_file()}
        relative = {name: file.relative_to(folder).as_posix() for name, file in there.items()}
        return Cell("", links=tuple((name, f"../{path}") for name, path in relative.items()))

    def text(value: Any) -> Cell:  # noqa: ANN401 - any entry of a row
        return Cell(format_value(value))

    columns: Columns = {
        "run": ("run", lambda run: Cell(str(run), run, str(run) if name == "worst" else "")),
        "controller": ("controller", Cell),
        "seed": ("seed", text),
        **{key.rpartition(".")[2]: (key, text) for key in sweep.study.names if key != "controller"},
        "status": ("status", Cell),
        "error [cm]": ("error_cm", _number),
        "files": ("log", links),
    }
    if rows["failure"].ne("").any():
        columns["why"] = "failure", Cell
    if name == "worst":
        commands = [rerun_command(sweep.study, row) for row in rows.to_dict("records")]
        rows = rows.assign(command=commands)
        columns["drive it again"] = "command", Cell
    else:
        columns |= {"point": ("point", text), "run id": ("run_id", Cell)}
        columns["control step [µs]"] = "step_us", partial(_number, decimals=0)
    return _table(name, title, rows, columns)


def _table(name: str, title: str, frame: pd.DataFrame, columns: Columns, note: str = "") -> Table:
    """Return a table of the columns that a frame has."""
    shown = {head: column for head, column in columns.items() if column[0] in frame}
    rows = tuple(
        tuple(cell(row[column]) for column, cell in shown.values())
        for row in frame.to_dict("records")
    )
    return Table(name, title, tuple(shown), rows, note)


def _picked(runs: Sequence[int], text: str = "") -> Cell:
    """Return a cell with the number of runs, or a text, that leads to them."""
    return Cell(text or str(len(runs)), len(runs), format_numbers(runs))


def _percent(rate: Any) -> Cell:  # noqa: ANN401 - a proportion out of a frame
    return Cell(format_percent(rate), rate.value)


def _estimated(estimate: Any, decimals: int = 1, sign: str = "") -> Cell:  # noqa: ANN401
    """Return a cell of an estimate; None or NaN: there is none."""
    known = estimate if estimate is not None and hasattr(estimate, "value") else None
    return Cell(format_estimate(known, decimals, sign), known.value if known else "")


def _signed(estimate: Any) -> Cell:  # noqa: ANN401
    return _estimated(estimate, sign="+")


def _number(value: float, decimals: int = 1) -> Cell:
    return Cell("–", "") if math.isnan(value) else Cell(f"{value:.{decimals}f}", value)
