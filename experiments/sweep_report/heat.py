"""Maps of failure rate, error and its differences over two axes of a sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.patches import Rectangle

from ttempc.types import FloatArray

from ..figures.panel import Panel
from ..figures.style import GREY, GRID, dress, series
from .aggregate import Cell, DifferenceCell
from .axes import Scale
from .curves import ERROR_LABEL, ticks

_DARK_INK: Final = "#1b1f23"
_LIGHT_INK: Final = "#fdfdfd"
_PAPER: Final = "#ffffff"  # becomes the background of a page
_LIGHT_LUMA: Final = 0.55  # of a colour, below which the ink is light
_TEXT_FITS: Final = 12  # columns up to which cells show their number
_OUTLINE_GAP: Final = 0.055  # between outlines of two controllers, in cells
_COLOURS: Final = 31  # of a colour bar; odd: zero has a colour. A bar of 50 becomes a picture


def failure_maps(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> list[Panel]:
    """Return the map of the failure rate [%] of each controller that failed anywhere."""
    norm = Normalize(0.0, 100.0)
    failing = {cell.group.controller for cell in cells if len(cell.group.failed)}
    panels = []
    for number in sorted(failing):
        rates = {
            cell.places: 100.0 * cell.group.failure_rate.value
            for cell in cells
            if cell.group.controller == number
        }
        title = f"{controllers[number]}: failed [%]"
        panels.append(_map_panel(title, across, up, rates, norm, "YlOrBr", "{:.0f}"))
    return panels


def error_maps(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> list[Panel]:
    """Return the map of the error of each controller; hatched where no run completed."""
    errors = [cell.group.error_cm.value for cell in cells if cell.group.error_cm]
    low = max(1e-2, min(errors, default=1.0))
    norm = LogNorm(low, max(1.001 * low, *errors, 0.0))
    panels = []
    for number, name in enumerate(controllers):
        own = {
            cell.places: cell.group.error_cm.value if cell.group.error_cm else None
            for cell in cells
            if cell.group.controller == number
        }
        title = f"{name}: {ERROR_LABEL}"
        panels.append(_map_panel(title, across, up, own, norm, "YlGnBu", "{:.1f}"))
    return panels


def difference_map(
    names: tuple[str, str], across: Scale, up: Scale, cells: Sequence[DifferenceCell]
) -> Panel:
    """Return the map of the difference of the errors of two controllers [cm], run by run.

    Args:
        names: of the controllers; the error of the second is subtracted.
        across: the horizontal axis.
        up: the vertical axis.
        cells: grouped by across and up.
    """
    values = {cell.places: cell.error_cm.value if cell.error_cm else None for cell in cells}
    largest = max((abs(value) for value in values.values() if value is not None), default=0.0)
    norm = Normalize(-(largest or 1.0), largest or 1.0)
    title = f"{names[0]} minus {names[1]}: error [cm]"
    decimals = max(0, -math.floor(math.log10(norm.vmax or 1.0))) + (1.0 <= largest < 10.0)
    return _map_panel(title, across, up, values, norm, "RdBu_r", f"{{:+.{decimals}f}}")


def _map_panel(
    title: str,
    across: Scale,
    up: Scale,
    values: Mapping[tuple[int, ...], float | None],
    norm: Normalize,
    palette: str,
    form: str,
) -> Panel:
    """Return a map with its colour bar.

    Args:
        title: of the panel.
        across: the horizontal axis.
        up: the vertical axis.
        values: by the places on both axes; None is hatched.
        norm: of the colours.
        palette: name of a matplotlib colour map.
        form: of the numbers in the cells.
    """

    def draw(axes: Axes) -> None:
        colours = colormaps[palette].resampled(_COLOURS)
        _draw_cells(axes, (len(across.texts), len(up.texts)), values, norm, colours, form)
        _frame(axes, across, up)
        bar = axes.figure.colorbar(ScalarMappable(norm, colours), ax=axes, aspect=25.0, pad=0.02)
        bar.ax.tick_params(labelsize=7.0, length=2)
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
        if isinstance(norm, LogNorm):
            places = _round_numbers(norm)
            bar.set_ticks(places, labels=[f"{place:.3g}" for place in places])
            bar.minorticks_off()

    return Panel(title, draw)


def _round_numbers(norm: LogNorm) -> list[float]:
    """Return 1, 2 and 5 times powers of ten in the range of a scale, or its ends."""
    low, high = norm.vmin or 0.0, norm.vmax or 0.0
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    numbers = [step * 10.0**power for power in powers for step in (1, 2, 5)]
    inside = [number for number in numbers if low <= number <= high]
    return inside if len(inside) > 1 else [low, high]


def _draw_cells(
    axes: Axes,
    size: tuple[int, int],
    values: Mapping[tuple[int, ...], float | None],
    norm: Normalize,
    colours: Colormap,
    form: str,
) -> None:
    columns, lines = size
    table = np.full((lines, columns), np.nan)
    for (x, y), value in values.items():
        if value is None:
            hatched: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "hatch": "/////"}
            axes.add_patch(Rectangle((x - 0.47, y - 0.47), 0.94, 0.94, linewidth=0.0, **hatched))
            continue
        table[y, x] = value
        if columns <= _TEXT_FITS:
            dark = np.dot(colours(float(norm(value)))[:3], (0.299, 0.587, 0.114)) < _LIGHT_LUMA
            ink = _LIGHT_INK if dark else _DARK_INK
            axes.text(x, y, _short(value, form), ha="center", va="center", fontsize=7.0, color=ink)
    edges = (np.arange(columns + 1) - 0.5, np.arange(lines + 1) - 0.5)
    axes.pcolormesh(
        *edges,
        np.ma.masked_invalid(table),
        norm=norm,
        cmap=colours,
        edgecolor=_PAPER,
        linewidth=1.5,
    )


def boundary_panel(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> Panel:
    """Return the outlines of each controller's failing cells: at least half of the runs fail."""

    def draw(axes: Axes) -> None:
        for number, name in enumerate(controllers):
            own = [cell for cell in cells if cell.group.controller == number]
            fails = {cell.places for cell in own if cell.group.fails}
            inset = _OUTLINE_GAP * (number - 0.5 * (len(controllers) - 1))
            looks = series(number, name) | {"marker": "", "linewidth": 1.5}
            for x, y in fails:
                box = Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, alpha=0.13, linewidth=0)
                box.set_color(looks["color"])
                axes.add_patch(box)
            if fails:
                axes.plot(*(_outline(fails) + inset).T, **looks)
        _frame(axes, across, up)
        axes.spines[:].set(visible=True, color=GRID)

    return Panel("Where at least half of the runs fail", draw, tuple(controllers))


def _outline(places: set[tuple[int, ...]]) -> FloatArray:
    """Return the boundary of a set of cells: sides of cells, rows of NaN between them, (n, 2)."""
    sides = []
    for x, y in sorted(places):
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if (x + dx, y + dy) not in places:
                middle = np.array([x + 0.5 * dx, y + 0.5 * dy])
                along = np.array([0.5 * dy, 0.5 * dx])
                sides += [middle - along, middle + along, np.full(2, np.nan)]
    return np.stack(sides)


def _frame(axes: Axes, across: Scale, up: Scale) -> None:
    dress(axes, across.label, up.label)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    ticks(axes, across, "x")
    ticks(axes, up, "y")
    axes.tick_params(length=0)
    axes.set_xlim(-0.6, len(across.texts) - 0.4)
    axes.set_ylim(-0.6, len(up.texts) - 0.4)


def _short(number: float, form: str) -> str:
    return f"{number:.0f}" if number >= 9.95 else form.format(number)
