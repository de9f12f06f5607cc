"""Sweep report as one self-contained HTML page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from ..figures.panel import Panel, alone, svg
from ..report.html import environment
from ..results.statistics import caveat
from ..results.summary import ACTUATOR_USE
from ..sweep.failure import ERROR, unmeasured_text
from ..sweep.row import Row
from .format import (
    format_estimate,
    format_numbers,
    format_percent,
    format_value,
    rerun_command,
)
from .report import SweepReport
from .runs import COST


@dataclass(frozen=True, slots=True)
class Chart:
    """A panel as SVG."""

    name: str
    title: str
    svg: Markup


def render_page(report: SweepReport, folder: Path) -> str:
    """Return the text of `report.html`.

    Args:
        report: its content.
        folder: of the sweep; the page lies in a subfolder of it.
    """
    templates = environment()
    templates.filters |= {
        "estimate": format_estimate,
        "percent": format_percent,
        "numbers": format_numbers,
        "value": format_value,
    }
    runs = report.runs
    return templates.get_template("sweep.html.j2").render(
        report=report,
        runs=runs,
        failures=bool(runs.failed.any()),
        caveat=caveat(runs.unit_count, runs.units, tails=True),
        unmeasured=unmeasured_text(runs.unmeasured, runs.limit_m),
        study_toml=runs.study.dump(),
        sections=[
            (section, [_chart(f"{section.name}-{n}", p) for n, p in enumerate(section.panels)])
            for section in report.sections
        ],
        axes=[name for name in runs.study.names if name != "controller"],
        worst=[(row, rerun_command(runs.study, row)) for rows in report.worst for row in rows],
        links=lambda row: links(row, folder),
        ERROR=ERROR,
        actuator_use=ACTUATOR_USE,
        COST=COST,
    )


def links(row: Row, folder: Path) -> list[tuple[str, str]]:
    """Return names and targets of the log of a run and of its film, if they exist."""
    if not row["log"]:
        return []
    log = folder / str(row["log"])
    files = {"log": log, "film": log.with_suffix(".mp4")}
    return [
        (name, f"../{file.relative_to(folder).as_posix()}")
        for name, file in files.items()
        if file.is_file()
    ]


def _chart(name: str, panel: Panel) -> Chart:
    return Chart(name, panel.title, Markup(svg(alone(panel), name)))
