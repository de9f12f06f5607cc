"""Figures as files for a paper, with the data that they show."""

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib import style as styles
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter
from PIL import Image

from ...testbed.recording.record import Record
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
_PALETTE: Final = 256  # colours

_ALWAYS: Final = ("chart", "quantity", "line", "x", "y")
_WHERE_GIVEN: Final = ("x_low", "x_high", "y_low", "y_high")
_UNNAMED: Final = "_child"  # begin of the label that matplotlib gives to a line without one

_Coordinate = float | str


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


def png(figure: Figure, dpi: float = DPI) -> bytes:
    """Return the content of a PNG file of a figure. Equal figures give equal bytes."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    # A palette makes the file three times smaller, invisibly in a plot of a few colours.
    picture.quantize(_PALETTE, Image.Quantize.MAXCOVERAGE).save(
        buffer, format="png", optimize=True, dpi=(dpi, dpi)
    )
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


def figure_csv(figure: Figure) -> str:
    """Return lines, intervals and histograms of a figure as CSV.

    Columns: chart from 0, its quantity, line, x and y; ends of intervals.
    A column that no row needs is left out. Of a bar of a histogram, x is the middle. Lines that
    only mark a place, with two points at most, are left out.
    """
    records = [
        {"chart": chart, "quantity": quantity.replace("\n", " "), **point}
        for chart, axes in enumerate(figure.axes)
        for quantity in [axes.get_title(loc="left") or axes.get_ylabel()]
        for point in _points(axes)
    ]
    used = [name for name in _WHERE_GIVEN if any(name in record for record in records)]
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, [*_ALWAYS, *used], lineterminator="\n")
    writer.writeheader()
    for record in records:
        writer.writerow({name: _text(value) for name, value in record.items()})
    return buffer.getvalue()


def _points(axes: Axes) -> Iterator[dict[str, _Coordinate]]:
    """Yield the points of a chart as columns of the file."""
    bands, in_bars = _bands(axes), set()
    for item in axes.containers:
        if isinstance(item, ErrorbarContainer):
            line, _, bars = item.lines
            in_bars.add(line)
            ways = [way for way, has in (("x", item.has_xerr), ("y", item.has_yerr)) if has]
            ends = {way: bar.get_segments() for way, bar in zip(ways, bars, strict=True)}
            for number, (x, y) in enumerate(np.asarray(line.get_xydata()).tolist()):
                point = _place(axes, str(item.get_label()), x, y)
                for way, segments in ends.items():
                    low, high = np.asarray(segments[number])[:, "xy".index(way)].tolist()
                    point |= {f"{way}_low": low, f"{way}_high": high}
                yield point
        elif isinstance(item, BarContainer) and len(item) > 2:
            for bar in item:
                x = bar.get_x() + 0.5 * bar.get_width()
                yield {"line": "histogram", "x": x, "y": bar.get_height()}
    for number, line in enumerate(axes.get_lines()):
        points, label = np.asarray(line.get_xydata()), str(line.get_label())
        if len(points) > 2 and line not in in_bars:
            name = f"line {number}" if label.startswith(_UNNAMED) else label.removeprefix("_")
            for x, y in points.tolist():
                yield _place(axes, name, x, y) | bands.get((label, x), {})


def _place(axes: Axes, line: str, x: float, y: float) -> dict[str, _Coordinate]:
    return {"line": line, "x": _named(axes.xaxis, x), "y": _named(axes.yaxis, y)}


def _bands(axes: Axes) -> dict[tuple[str, float], dict[str, _Coordinate]]:
    """Return the ends of bands around lines, by the label of both and x."""
    ends: dict[tuple[str, float], dict[str, _Coordinate]] = {}
    for band in axes.collections:
        label = str(band.get_label())
        paths = band.get_paths()  # none, where no end of the band is known
        if isinstance(band, PolyCollection) and paths and not label.startswith("_"):
            vertices = np.array(paths[0].vertices)
            for x in np.unique(vertices[:, 0]):
                y = vertices[vertices[:, 0] == x, 1]
                ends[label, float(x)] = {"y_low": float(y.min()), "y_high": float(y.max())}
    return ends


def _named(axis: Axis, value: float) -> _Coordinate:
    """Return the text of a tick nearest to a value on an axis of texts, else the value."""
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    fixed = isinstance(locator, FixedLocator) and isinstance(formatter, FuncFormatter)
    if not fixed or not math.isfinite(value) or round(value) not in np.asarray(locator()):
        return float(value)
    text = formatter(round(value))
    try:
        float(text)
    except ValueError:
        return text
    # A number beside the tick is itself, one on it is what the tick says.
    return text if value == round(value) else float(value)


def _text(value: _Coordinate) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"
