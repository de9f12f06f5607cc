"""Figures of a run as files for a paper, and the data that they show as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib import style as styles
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from proving_ground.testbed.recording.record import Record

from . import FIGURES, png, shown_figures
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


def export_figures(
    record: Record,
    formats: Sequence[str],
    width_cm: float | None = None,
    style: str | None = None,
    dpi: float = 300.0,
    only: Collection[str] = FIGURES,
) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of the files: each figure in each format, and its data as CSV.

    Args:
        record: of the run.
        formats: of `FORMATS`.
        width_cm: width of the figures [cm]; None keeps that of the report.
        style: name or file of a matplotlib style, such as one with a font family.
        dpi: of pictures in PNG.
        only: names of figures; others are left out.

    Raises:
        OSError: there is no such style.
    """
    with ExitStack() as context:
        if style is not None:
            context.enter_context(styles.context(style))
        if width_cm is not None:
            context.enter_context(figure_width(width_cm / _CM_PER_IN))
        context.enter_context(mpl.rc_context(_EDITABLE))
        for name in shown_figures(record):
            if name not in only:
                continue
            figure = FIGURES[name](record)
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


def figure_csv(figure: Figure) -> str:
    """Return lines and histograms of a figure as CSV: chart from 0, its label, line, x and y.

    Of a bar of a histogram, x is the middle. Lines that only mark a place, with two points at most,
    are left out.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(("chart", "quantity", "line", "x", "y"))
    for chart, axes in enumerate(figure.axes):
        quantity = (axes.get_title(loc="left") or axes.get_ylabel()).replace("\n", " ")
        for number, line in enumerate(axes.get_lines()):
            points = np.asarray(line.get_xydata())
            label = str(line.get_label())
            label = f"line {number}" if label.startswith("_") else label
            if len(points) > 2:
                writer.writerows(
                    (chart, quantity, label, *_text(point)) for point in points.tolist()
                )
        bars = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
        places = [(bar.get_x() + 0.5 * bar.get_width(), bar.get_height()) for bar in bars]
        if len(places) > 2:
            writer.writerows((chart, quantity, "histogram", *_text(place)) for place in places)
    return buffer.getvalue()


def _text(point: Iterable[float]) -> Iterator[str]:
    return (f"{value:.9g}" for value in point)


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
