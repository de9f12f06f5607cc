"""Maps of failure rate, error and failing points over two axes of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import Rectangle

from ..figures.panel import Panel
from ..figures.style import GREY, GRID, dress, note, series
from .aggregate import Cell
from .axes import Scale
from .curves import ERROR_LABEL, ticks

_DARK_INK: Final = "#1b1f23"
_LIGHT_INK: Final = "#fdfdfd"
_LIGHT_LUMA: Final = 0.55  # of a colour, below which the ink is light
_TEXT_FITS: Final = 12  # columns up to which cells show their number
_OUTLINE_GAP: Final = 0.055  # between outlines of two controllers, in cells


def failure_maps(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> list[Panel]:
    """Return the map of the failure rate of each controller; cells are grouped by across and up."""
    return _maps(controllers, across, up, cells, Normalize(0.0, 1.0), True)


def error_maps(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> list[Panel]:
    """Return the map of the error of each controller; hatched where no run completed."""
    errors = [cell.group.error_cm.value for cell in cells if cell.group.error_cm]
    low = max(1e-2, min(errors, default=1.0))
    norm = LogNorm(low, max(1.001 * low, *errors, 0.0))
    return _maps(controllers, across, up, cells, norm, False)


def _maps(
    controllers: Sequence[str],
    across: Scale,
    up: Scale,
    cells: Sequence[Cell],
    norm: Normalize,
    failures: bool,
) -> list[Panel]:
    def panel(number: int, name: str) -> Panel:
        own = [cell for cell in cells if cell.group.controller == number]
        title = f"{name}: failed [%]" if failures else f"{name}: {ERROR_LABEL}"

        def draw(axes: Axes) -> None:
            _map(axes, across, own, norm, failures)
            _frame(axes, across, up)

        return Panel(title, draw)

    return [panel(number, name) for number, name in enumerate(controllers)]


def _map(axes: Axes, across: Scale, cells: Sequence[Cell], norm: Normalize, failures: bool) -> None:
    palette = colormaps["YlOrBr" if failures else "YlGnBu"]
    for cell in cells:
        x, y = cell.places
        estimate = cell.group.failure_rate if failures else cell.group.error_cm
        if estimate is None:
            looks: dict[str, Any] = {"facecolor": "none", "edgecolor": GREY, "hatch": "/////"}
            axes.add_patch(Rectangle((x - 0.47, y - 0.47), 0.94, 0.94, linewidth=0.0, **looks))
            continue
        colour = palette(float(norm(estimate.value)))
        axes.add_patch(Rectangle((x - 0.48, y - 0.48), 0.96, 0.96, color=colour, linewidth=0.0))
        if len(across.texts) <= _TEXT_FITS:
            text = f"{100 * estimate.value:.0f}" if failures else _short(estimate.value)
            dark = np.dot(colour[:3], (0.299, 0.587, 0.114)) < _LIGHT_LUMA
            ink = _LIGHT_INK if dark else _DARK_INK
            axes.text(x, y, text, ha="center", va="center", fontsize=7.0, color=ink)


def boundary_panel(
    controllers: Sequence[str], across: Scale, up: Scale, cells: Sequence[Cell]
) -> Panel:
    """Return the outlines of each controller's failing cells: at least half of the runs fail."""

    def draw(axes: Axes) -> None:
        for number in range(len(controllers)):
            own = [cell for cell in cells if cell.group.controller == number]
            fails = {cell.places for cell in own if cell.group.fails}
            inset = _OUTLINE_GAP * (number - 0.5 * (len(controllers) - 1))
            looks = series(number) | {"marker": "", "linewidth": 1.5}
            colour = looks["color"]
            for x, y in fails:
                box = Rectangle((x - 0.5, y - 0.5), 1.0, 1.0, color=colour, alpha=0.13, linewidth=0)
                axes.add_patch(box)
            for line in _outline(fails):
                axes.plot(*(line + inset).T, **looks)
        if not any(cell.group.fails for cell in cells):
            note(axes, 0.5, 0.5, "nowhere", ha="center", color=GREY)
        _frame(axes, across, up)
        axes.spines[:].set(visible=True, color=GRID)

    return Panel("Where at least half of the runs fail", draw, tuple(controllers))


def _outline(places: set[tuple[int, ...]]) -> list[np.ndarray]:
    """Return the boundary of a set of cells as sides of cells, (2, 2) each."""
    sides = []
    for x, y in places:
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if (x + dx, y + dy) not in places:
                middle = np.array([x + 0.5 * dx, y + 0.5 * dy])
                along = np.array([0.5 * dy, 0.5 * dx])
                sides.append(np.stack([middle - along, middle + along]))
    return sides


def _frame(axes: Axes, across: Scale, up: Scale) -> None:
    dress(axes, across.label, up.label)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    ticks(axes, across, "x")
    ticks(axes, up, "y")
    axes.tick_params(length=0)
    axes.set_xlim(-0.6, len(across.texts) - 0.4)
    axes.set_ylim(-0.6, len(up.texts) - 0.4)


def _short(number: float) -> str:
    return f"{number:.1f}" if number < 9.95 else f"{number:.0f}"
