"""Figures as files for a paper, with the data that they show."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib import style as styles
from matplotlib.figure import Figure

from ...testbed.recording.record import Record
from . import FIGURES, png, shown_figures
from .figure_data import figure_csv
from .style import figure_width

FORMATS: Final = ("pdf", "svg", "png")
WIDTHS_CM: Final = {"single": 8.8, "double": 18.1}
"""Widths of one and two columns of an IEEE journal page."""

# Text stays text: TrueType in PDF, <text> in SVG. A date would make equal figures differ.
_EDITABLE: Final[dict[Any, Any]] = {
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "ttempc",
}
_NO_DATE: Final = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
_CM_PER_IN: Final = 2.54


def run_figures(record: Record) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the figures of a run, by name."""
    return {name: partial(FIGURES[name], record) for name in shown_figures(record)}


def export_figures(
    figures: Mapping[str, Callable[[], Figure]],
    formats: Sequence[str],
    width_cm: float | None = None,
    style: str | None = None,
    dpi: float = 300.0,
) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of the files: each figure in each format, and its data as CSV.

    Args:
        figures: functions that draw them, by name; `run_figures` has those of a run.
        formats: of `FORMATS`.
        width_cm: width of the figures [cm]; None keeps that of the report.
        style: name or file of a matplotlib style, such as one with a font family.
        dpi: of pictures in PNG.

    Raises:
        OSError: there is no such style.
    """
    with ExitStack() as context:
        if style is not None:
            context.enter_context(styles.context(style))
        if width_cm is not None:
            context.enter_context(figure_width(width_cm / _CM_PER_IN))
        context.enter_context(mpl.rc_context(_EDITABLE))
        for name, draw in figures.items():
            figure = draw()
            for form in formats:
                yield f"{name}.{form}", _content(figure, form, dpi)
            yield f"{name}.csv", figure_csv(figure).encode()


def _content(figure: Figure, form: str, dpi: float) -> bytes:
    if form == "png":
        figure.set_dpi(dpi)
        return png(figure, dpi)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=form, metadata=_NO_DATE[form])
    return buffer.getvalue()


def style_of(text: str) -> str:
    """Return the name of a matplotlib style, or the absolute path of a style file.

    Raises:
        ValueError: there is neither; the message names the styles.
    """
    if text in styles.available or text == "default":
        return text
    if Path(text).is_file():
        return str(Path(text).resolve())
    known = ", ".join(styles.available)
    raise ValueError(f"{text!r} is no file and no style of matplotlib: {known}")
