"""A report on the disk: rendered as a whole, then each file put in place of the old one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from ..errors import OutputExists
from ..figures import png
from ..figures.panel import together
from .page import page
from .report import Report
from .summary import MARK, summary

PLACE: Final = "report"
"""The folder of a report in the folder of its sweep."""


def write_report(report: Report, folder: Path) -> Path:
    """Write report.html, summary.md and the pictures; return the page's path.

    What an earlier report left is replaced: all of it follows from the rows.

    Args:
        report: what it tells.
        folder: of the sweep.

    Raises:
        OutputExists: the folder cannot be written to; each file is the old one or the new one.
    """
    there = folder / PLACE
    pictures = _pictures(report)
    _replace(
        there,
        {
            **pictures,
            "summary.md": summary(report).encode(),
            "report.html": page(report, folder).encode(),
        },
    )
    optional = {*there.glob("maps*.png"), there / "curves.png", there / "envelope.png"}
    for stale in optional - {there / name for name in pictures}:
        stale.unlink(missing_ok=True)
    return there / "report.html"


def write_docs(report: Report, folder: Path) -> Path:
    """Write the summary as a page NAME.md among others, pictures NAME-*.png; return its path.

    Raises:
        OutputExists: a page of this name was not written by this function, or cannot be written.
    """
    name = report.runs.name
    file = folder / f"{name}.md"
    if file.exists() and not file.read_text(encoding="utf-8").startswith(MARK):
        raise OutputExists(f"output {file}: was not written by `ttempc report`, remove it first")
    pictures = {f"{name}-{stem}": content for stem, content in _pictures(report).items()}
    _replace(folder, {**pictures, file.name: summary(report, f"{name}-").encode()})
    return file


def _pictures(report: Report) -> dict[str, bytes]:
    return {f"{section.name}.png": png(together(section.panels)) for section in report.sections}


def _replace(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files so that each is whole, the old one or the new one, whatever happens."""
    parts = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            part = folder / f".{name}.part"
            parts.append(part)
            part.write_bytes(content)
        for name in files:
            os.replace(folder / f".{name}.part", folder / name)
    except OSError as error:
        for part in parts:
            part.unlink(missing_ok=True)
        raise OutputExists(f"output {folder}: cannot be written: {error.strerror}") from None
