"""Figures as files for a paper."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ....testbed.recording.record import Record
from .run_figures import FIGURES, shown_figures
from .style import DPI, figure_width

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
_PALETTE: Final = 256  # colours of an exported PNG


def run_figures(record: Record) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the figures of a run, by name."""
    return {name: partial(FIGURES[name], record) for name in shown_figures(record)}


def export_figures(
    figures: Mapping[str, Callable[[], Figure]],
    formats: Sequence[str],
    width_cm: float | None = None,
    dpi: float = 300.0,
) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of the files: each figure in each format.

    Args:
        figures: functions that draw them, by name; `run_figures` has those of a run.
        formats: of `FORMATS`.
        width_cm: width of the figures [cm]; None keeps that of the report.
        dpi: of pictures in PNG.
    """
    width_in = None if width_cm is None else width_cm / _CM_PER_IN
    with figure_width(width_in), mpl.rc_context(_EDITABLE):
        for name, draw in figures.items():
            figure = draw()
            for form in formats:
                yield f"{name}.{form}", _content(figure, form, dpi)


def _content(figure: Figure, form: str, dpi: float) -> bytes:
    if form == "png":
        figure.set_dpi(dpi)
        return png(figure, dpi)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=form, metadata=_NO_DATE[form])
    return buffer.getvalue()


def png(figure: Figure, dpi: float = DPI) -> bytes:
    """Return the content of a PNG file of a figure. Equal figures give equal bytes."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    # A palette makes the file three times smaller, invisibly in a plot of a few colours.
    # `optimize` takes eight times as long to write and makes it 8 % smaller.
    picture.quantize(_PALETTE, Image.Quantize.MAXCOVERAGE).save(
        buffer, format="png", dpi=(dpi, dpi)
    )
    return buffer.getvalue()
