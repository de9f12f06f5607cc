"""Files of a sweep report: rendered first, then each replaced atomically."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ...testbed.atomic_write import atomic_write
from ..errors import OutputExists
from ..figures import png
from ..figures.panel import alone, together
from .page import render_page
from .report import SweepReport
from .summary import render_summary

PLACE: Final = "report"
"""Name of the report's folder in the folder of its sweep."""


def write_report(report: SweepReport, folder: Path) -> Path:
    """Write report.html, summary.md and the pictures; return the page's path.

    The files of an earlier report are replaced; all of them follow from the rows.

    Args:
        report: its content.
        folder: of the sweep.

    Raises:
        OutputExists: the folder cannot be written to; each file is the old or the new one.
    """
    target = folder / PLACE
    pictures = _pictures(report)
    _replace(
        target,
        {
            **pictures,
            "summary.md": render_summary(report).encode(),
            "report.html": render_page(report, folder).encode(),
        },
    )
    optional = {*target.glob("maps*.png"), target / "curves.png", target / "envelope.png"}
    for stale in optional - {target / name for name in pictures}:
        stale.unlink(missing_ok=True)
    return target / "report.html"


def docs_page(report: SweepReport) -> tuple[str, dict[str, bytes]]:
    """Return the summary for docs/, and its pictures by file name; their names start with NAME-."""
    prefix = f"{report.runs.name}-"
    pictures = {f"{prefix}{file}": content for file, content in _pictures(report).items()}
    return render_summary(report, prefix), pictures


def panel_figures(report: SweepReport) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the charts of a report, each as a figure of its own, by name."""
    return {
        re.sub(r"[^a-z0-9]+", "-", f"{section.name} {panel.title}".lower()).strip("-"): partial(
            alone, panel
        )
        for section in report.sections
        for panel in section.panels
    }


def _pictures(report: SweepReport) -> dict[str, bytes]:
    return {f"{section.name}.png": png(together(section.panels)) for section in report.sections}


def _replace(folder: Path, files: Mapping[str, bytes]) -> None:
    """Replace files, all written before the first takes its place; each is the old or the new."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            for name, content in files.items():
                stack.enter_context(atomic_write(folder / name)).write(content)
    except OSError as error:
        raise OutputExists(f"output {folder}: cannot be written: {error.strerror}") from None
