"""A sweep's report as one HTML page that needs nothing else to be read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from ..figures.panel import Panel, alone, svg
from ..report.html import environment
from ..sweep.row import Row
from .format import command, estimate_text, numbers_text, percent_text, value_text
from .report import Report
from .runs import COST, ERROR


@dataclass(frozen=True, slots=True)
class Chart:
    """A panel as the page holds it."""

    name: str
    title: str
    svg: Markup


def page(report: Report, folder: Path) -> str:
    """Return the text of `report.html`.

    Args:
        report: what it tells.
        folder: of the sweep; the page lies in a folder of its own in it.
    """
    made = environment()
    made.filters |= {
        "estimate": estimate_text,
        "percent": percent_text,
        "numbers": numbers_text,
        "value": value_text,
    }
    runs = report.runs
    return made.get_template("sweep.html.j2").render(
        report=report,
        runs=runs,
        study_toml=runs.study.dump(),
        sections=[
            (section, [_chart(f"{section.name}-{n}", p) for n, p in enumerate(section.panels)])
            for section in report.sections
        ],
        axes=[name for name in runs.study.names if name != "controller"],
        worst=[(row, command(runs.study, row)) for rows in report.worst for row in rows],
        links=lambda row: links(row, folder),
        ERROR=ERROR,
        COST=COST,
    )


def links(row: Row, folder: Path) -> list[tuple[str, str]]:
    """Return names and targets of a run's log, and of a film beside it, where they exist."""
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
