"""Data that a figure shows, as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

_Coordinate = float | str | None
_COLOUR_BAR = "<colorbar>"  # label that matplotlib gives to its axes
_UNNAMED = "_child"  # begin of the label that matplotlib gives to a line without one


@dataclass(frozen=True, slots=True)
class _Point:
    chart: int  # from 0
    quantity: str
    line: str
    x: _Coordinate
    y: _Coordinate
    value: float | None = None  # of a cell of a map
    x_low: float | None = None  # ends of intervals
    x_high: float | None = None
    y_low: float | None = None
    y_high: float | None = None


def figure_csv(figure: Figure) -> str:
    """Return lines, intervals, histograms and maps of a figure as CSV.

    Columns: chart from 0, its quantity, line, x and y; value of a cell of a map; ends of intervals.
    A column that no row needs is left out. Of a bar of a histogram, x is the middle. Lines that
    only mark a place, with two points at most, are left out.
    """
    points = [
        point
        for chart, axes in enumerate(figure.axes)
        if axes.get_label() != _COLOUR_BAR
        for point in _points(chart, axes)
    ]
    names = [field.name for field in fields(_Point)]
    rows = [astuple(point) for point in points]
    used = [
        place
        for place in range(len(names))
        if place < 5 or any(row[place] is not None for row in rows)
    ]
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([names[place] for place in used])
    writer.writerows([_text(row[place]) for place in used] for row in rows)
    return buffer.getvalue()


def _points(chart: int, axes: Axes) -> Iterator[_Point]:
    quantity = (axes.get_title(loc="left") or axes.get_ylabel()).replace("\n", " ")
    bands = _bands(axes)
    in_bars = set()
    for item in axes.containers:
        if isinstance(item, ErrorbarContainer):
            in_bars.add(item.lines[0])
            for x, y, x_ends, y_ends in _error_bars(item):
                place = _named(axes.xaxis, x), _named(axes.yaxis, y)
                yield _Point(chart, quantity, str(item.get_label()), *place, None, *x_ends, *y_ends)
    for number, line in enumerate(axes.get_lines()):
        points = np.asarray(line.get_xydata())
        label = str(line.get_label())
        if len(points) <= 2 or line in in_bars:
            continue
        for x, y in points.tolist():
            name = f"line {number}" if label.startswith(_UNNAMED) else label.removeprefix("_")
            place = _named(axes.xaxis, x), _named(axes.yaxis, y)
            ends = bands.get((label, x), (None, None))
            yield _Point(chart, quantity, name, *place, y_low=ends[0], y_high=ends[1])
    for item in axes.containers:
        if isinstance(item, BarContainer) and len(item) > 2:
            for bar in item:
                x = bar.get_x() + 0.5 * bar.get_width()
                yield _Point(chart, quantity, "histogram", x, bar.get_height())
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            cells = np.ma.filled(np.ma.asarray(mesh.get_array()), np.nan)
            for (up, across), value in np.ndenumerate(cells):
                place = _tick(axes.xaxis, across), _tick(axes.yaxis, up)
                yield _Point(chart, quantity, "map", *place, float(value))


def _bands(axes: Axes) -> dict[tuple[str, float], tuple[float, float]]:
    """Return the ends of bands around lines, by the label of both and x."""
    ends: dict[tuple[str, float], tuple[float, float]] = {}
    for band in axes.collections:
        label = str(band.get_label())
        if isinstance(band, PolyCollection) and not label.startswith("_"):
            vertices = np.array(band.get_paths()[0].vertices)
            for x in np.unique(vertices[:, 0]):
                y = vertices[vertices[:, 0] == x, 1]
                ends[label, float(x)] = float(y.min()), float(y.max())
    return ends


def _error_bars(
    item: ErrorbarContainer,
) -> Iterator[tuple[float, float, tuple[float | None, ...], tuple[float | None, ...]]]:
    """Yield x, y and the ends of the bars in both directions."""
    line, _, bars = item.lines
    directions = [name for name, has in (("x", item.has_xerr), ("y", item.has_yerr)) if has]
    segments = {name: bar.get_segments() for name, bar in zip(directions, bars, strict=True)}
    for number, (x, y) in enumerate(np.asarray(line.get_xydata()).tolist()):
        ends = {
            name: tuple(np.asarray(segments[name][number])[:, column].tolist())
            if name in segments
            else (None, None)
            for column, name in enumerate(("x", "y"))
        }
        yield x, y, ends["x"], ends["y"]


def _named(axis: Axis, value: float) -> _Coordinate:
    """Return the text of a tick nearest to a value on an axis of texts, else the value."""
    text = _tick(axis, round(value)) if math.isfinite(value) else value
    if isinstance(text, float):
        return value
    try:
        float(text)
    except ValueError:
        return text
    return value


def _tick(axis: Axis, value: float) -> float | str:
    """Return the text of the tick at a value, the value where the ticks have no texts."""
    locator, formatter = axis.get_major_locator(), axis.get_major_formatter()
    fixed = isinstance(locator, FixedLocator) and isinstance(formatter, FuncFormatter)
    if fixed and value in np.asarray(locator()):
        return formatter(value)
    return float(value)


def _text(value: _Coordinate) -> str:
    return "" if value is None else value if isinstance(value, str) else f"{value:.9g}"
