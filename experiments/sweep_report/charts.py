"""Charts of a sweep: curves, maps, tails, computation time, differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

from ttempc.types import FloatArray

from ..figures.style import BLACK, GREY, blank, dress, note, series
from .runs import Scale, Sweep

_HEIGHT_IN: Final = 2.9
_ASIDE: Final = 0.5  # width of the bars at one text value, as a share of the spacing
_LONG: Final = 34  # characters of all labels of an axis that fit side by side
_WIDE: Final = 6.0  # largest over smallest value from which an axis is logarithmic
_DARK_INK, _LIGHT_INK = "#1b1f23", "#fdfdfd"
_LIGHT_LUMA: Final = 0.55  # of a colour, below which the ink is light
_TEXT_FITS: Final = 12  # columns up to which cells show their number
_COLOURS: Final = 31  # of a colour bar; odd: zero has a colour


@dataclass(frozen=True, slots=True)
class Panel:
    """A chart of half a page's width."""

    title: str
    draw: Callable[[Axes], None]  # onto empty axes
    series: tuple[str, ...] = ()  # names for the legend, in the order of `style.series`

    def figure(self) -> Figure:
        """Return the chart as a figure; its title is left out, since a page shows it as text."""
        figure = blank(_HEIGHT_IN, 0.5)
        self.draw(figure.subplots())
        handles = [
            Line2D([], [], linewidth=1.4, markersize=4.5, label=name, **series(number))
            for number, name in enumerate(self.series)
        ]
        if handles:
            looks: dict[str, Any] = {"frameon": False, "fontsize": 8.0, "handlelength": 1.8}
            figure.legend(handles=handles, loc="outside upper left", ncols=2, **looks)
        return figure


def error_label(sweep: Sweep) -> str:
    """Return the label of axes with the error."""
    return f"{sweep.point} cross-track p95 [cm]"


def curve_panels(sweep: Sweep, scale: Scale, table: pd.DataFrame) -> list[Panel]:
    """Return failure rate, if any run failed, and error over one axis, 95 % intervals as bands.

    Args:
        sweep: the runs.
        scale: the axis.
        table: `groups` by it.
    """

    def draw(column: str, factor: float, label: str, axes: Axes) -> None:
        known = table[table[column].notna()]
        dress(axes, scale.label, label)
        for number, name in enumerate(sweep.controllers):
            own = known[known["controller"] == name]
            if not len(own):
                continue
            x = scale.positions[own[scale.label]]
            y, low, high = factor * np.array([(item.value, *item.ends) for item in own[column]]).T
            looks: dict[str, Any] = series(number, name) | {"markersize": 3.8}
            if scale.numeric:
                band = {"color": looks["color"], "alpha": 0.15, "linewidth": 0.0}
                axes.fill_between(x, low, high, label=name, **band)
                axes.plot(x, y, linewidth=1.3, **looks)
            else:  # text values have nothing between them: no line, and bars side by side
                count = len(sweep.controllers)
                aside = _ASIDE * (number - 0.5 * (count - 1)) / count
                looks["linestyle"] = "none"
                axes.errorbar(x + aside, y, yerr=[y - low, high - y], **looks)
        if not len(known):
            _note(axes, "no run completed")
        if scale.logarithmic:
            axes.set_xscale("log")
        _ticks(axes.xaxis, scale, scale.positions.tolist())
        if not scale.numeric:
            axes.set_xlim(-0.5, len(scale.texts) - 0.5)
        if column == "rate":
            axes.set_ylim(-3.0, 103.0)
        else:
            _logarithmic_where_wide(axes.yaxis, values(known[column]))

    over, names = f"over {scale.label}", sweep.controllers
    error = partial(draw, "error", 1.0, error_label(sweep))
    panels = [Panel(f"Error {over}", error, names)]
    if sweep.rows["failed"].any():
        failed = partial(draw, "rate", 100.0, "failed [%]")
        panels.insert(0, Panel(f"Failed runs {over}", failed, names))
    return panels


def tail_panel(sweep: Sweep) -> Panel:
    """Return the share of the runs with a larger error; a run not completed exceeds any."""

    def draw(axes: Axes) -> None:
        errors = sweep.rows["error_cm"].dropna()
        right = 1.1 * float(errors.max()) if len(errors) else 1.0
        for number, name in enumerate(sweep.controllers):
            own = sweep.rows[sweep.rows["controller"] == name]
            own_errors = own["error_cm"].dropna().to_numpy()
            not_completed = int(own["status"].ne("completed").sum())
            if not len(own_errors) + not_completed:
                continue  # all its runs are too short for an error figure
            count = len(own_errors)
            x = np.sort(own_errors)
            y = (np.arange(count - 1, -1, -1) + not_completed) / (count + not_completed)
            looks = series(number, name) | {"marker": "", "linewidth": 1.4}
            lost = not_completed / (len(own_errors) + not_completed)
            x, y = np.append(x, right), np.append(y, lost)
            axes.step(x, 100.0 * np.where(y > 0.0, y, np.nan), where="post", **looks)
        if not len(errors):
            _note(axes, "no run completed")
        dress(axes, error_label(sweep), "runs that are worse [%]")
        _logarithmic_where_wide(axes.xaxis, errors.to_numpy())
        _make_logarithmic(axes.yaxis)
        axes.set_ylim(min(4.0, 80.0 * len(sweep.controllers) / len(sweep.rows)), 120.0)
        axes.axhline(5.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))

    return Panel("Tails: share of the runs that are worse", draw, sweep.controllers)


def cost_panel(sweep: Sweep, table: pd.DataFrame) -> Panel:
    """Return error over the cost of a control step, a point with intervals for each controller."""

    def draw(axes: Axes) -> None:
        shown = table[table["error"].notna() & table["step_us"].notna()]
        for name, error, cost in shown[["controller", "error", "step_us"]].to_numpy():
            looks: dict[str, Any] = series(sweep.controllers.index(name), name)
            looks |= {"markersize": 7.0, "linestyle": "none"}
            axes.errorbar(cost.value, error.value, xerr=_bar(cost), yerr=_bar(error), **looks)
        if not len(shown):
            _note(axes, "no run completed")
        dress(axes, "control step, median [µs]", error_label(sweep))
        _logarithmic_where_wide(axes.xaxis, values(shown["step_us"]))
        _logarithmic_where_wide(axes.yaxis, values(shown["error"]))
        axes.margins(0.12)

    return Panel("Error against computation time", draw, sweep.controllers)


def difference_panel(sweep: Sweep, against: str, table: pd.DataFrame) -> Panel:
    """Return the paired difference of the error of every other controller to one."""

    def draw(axes: Axes) -> None:
        known = table[table["error"].notna()]
        for place, name, error in zip(
            known.index, known["controller"], known["error"], strict=True
        ):
            looks: dict[str, Any] = series(sweep.controllers.index(name), name)
            looks |= {"markersize": 6.0, "linestyle": "none"}
            axes.errorbar(error.value, place, xerr=_bar(error), capsize=3.0, **looks)
        if not len(known):
            _note(axes, "no pair completed")
        axes.axvline(0.0, color=BLACK, linewidth=0.9)
        label = "difference of the error, run by run [cm]"
        if np.abs(values(known["error"])).max(initial=0.0) > 10.0:
            axes.set_xscale("symlog", linthresh=1.0)  # one poor controller hides no difference
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            left, right = axes.get_xlim()
            axes.set_xlim(1.3 * min(left, -1.0), 1.3 * max(right, 1.0))
            label += ", linear within 1 cm"
        dress(axes, label, "")
        axes.set_yticks(range(len(table)), table["controller"])
        axes.set_ylim(len(table) - 0.4, -0.6)

    return Panel(f"Better (left) or worse (right) than {against}", draw)


def map_panels(
    sweep: Sweep, across: Scale, up: Scale, table: pd.DataFrame, paired: pd.DataFrame, against: str
) -> list[Panel]:
    """Return maps over two axes: difference of two controllers, errors, and failures if any.

    Args:
        sweep: the runs.
        across: the horizontal axis.
        up: the vertical axis.
        table: `groups` by both.
        paired: `differences` of one controller by both; may be empty.
        against: the other controller.
    """

    def panel(
        title: str, own: pd.DataFrame, column: str, factor: float, looks: tuple[Any, ...]
    ) -> Panel:
        cells = np.full((len(up.texts), len(across.texts)), np.nan)
        places = own[up.label].to_numpy(), own[across.label].to_numpy()
        cells[places] = factor * values(own[column])
        hatched = np.zeros_like(cells, dtype=bool)
        hatched[places] = np.isnan(cells[places])
        return Panel(title, partial(_draw_map, across, up, cells, hatched, *looks))

    panels = []
    if len(paired):
        largest = float(np.nan_to_num(np.abs(values(paired["error"]))).max()) or 1.0
        decimals = max(0, -math.floor(math.log10(largest))) + (1.0 <= largest < 10.0)
        title = f"{paired['controller'].iloc[0]} minus {against}: error [cm]"
        looks = f"{{:+.{decimals}f}}", Normalize(-largest, largest), "RdBu_r"
        panels.append(panel(title, paired, "error", 1.0, looks))
    errors = values(table["error"])
    low = max(1e-2, np.nanmin(errors)) if np.isfinite(errors).any() else 1.0
    norm = LogNorm(low, max(1.001 * low, float(np.nan_to_num(errors).max())))
    by_controller = [(name, table[table["controller"] == name]) for name in sweep.controllers]
    for name, own in by_controller:
        looks = "{:.1f}", norm, "YlGnBu"
        panels.append(panel(f"{name}: {error_label(sweep)}", own, "error", 1.0, looks))
    for name, own in by_controller:
        if own["failed"].map(len).any():
            looks = "{:.0f}", Normalize(0.0, 100.0), "YlOrBr"
            panels.append(panel(f"{name}: failed [%]", own, "rate", 100.0, looks))
    return panels


def _draw_map(
    across: Scale,
    up: Scale,
    cells: FloatArray,
    hatched: Any,  # noqa: ANN401 - an array of truth values
    form: str,
    norm: Normalize,
    palette: str,
    axes: Axes,
) -> None:
    """Draw the cells (n, m) of a map, those without a figure hatched, with a colour bar."""
    colours = colormaps[palette].resampled(_COLOURS)
    edges = (np.arange(cells.shape[1] + 1) - 0.5, np.arange(cells.shape[0] + 1) - 0.5)
    border = {"edgecolor": "white", "linewidth": 1.5}
    axes.pcolormesh(*edges, np.ma.masked_invalid(cells), norm=norm, cmap=colours, **border)
    for y, x in np.argwhere(hatched):
        place, size = (x - 0.47, y - 0.47), (0.94, 0.94)
        looks: dict[str, Any] = {"edgecolor": GREY, "hatch": "/////", "linewidth": 0.0}
        axes.add_patch(Rectangle(place, *size, facecolor="none", **looks))
    for (y, x), value in np.ndenumerate(cells):
        if np.isfinite(value) and cells.shape[1] <= _TEXT_FITS:
            dark = np.dot(colours(float(norm(value)))[:3], (0.299, 0.587, 0.114)) < _LIGHT_LUMA
            text = f"{value:.0f}" if value >= 9.95 else form.format(value)
            ink = _LIGHT_INK if dark else _DARK_INK
            axes.text(x, y, text, ha="center", va="center", fontsize=7.0, color=ink)
    dress(axes, across.label, up.label)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    _ticks(axes.xaxis, across, range(len(across.texts)))
    _ticks(axes.yaxis, up, range(len(up.texts)))
    axes.tick_params(length=0)
    ticks: dict[str, Any] = {}
    if isinstance(norm, LogNorm):
        ticks = {"ticks": LogLocator(subs=(1.0, 2.0, 5.0)), "format": StrMethodFormatter("{x:g}")}
    mappable = ScalarMappable(norm, colours)
    bar = axes.figure.colorbar(mappable, ax=axes, aspect=25.0, pad=0.02, **ticks)
    bar.minorticks_off()
    bar.ax.tick_params(labelsize=7.0, length=2)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]


def _ticks(axis: XAxis | YAxis, scale: Scale, positions: Sequence[float]) -> None:
    """Label an axis with the values of a scale; rotate long labels."""
    axis.set_minor_locator(NullLocator())
    turned = axis.axis_name == "x" and sum(map(len, scale.texts)) > _LONG
    looks = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if turned else {}
    axis.set_ticks(positions, scale.texts, **looks)


def _logarithmic_where_wide(axis: XAxis | YAxis, numbers: FloatArray) -> None:
    known = numbers[np.isfinite(numbers)]
    if len(known) and known.min() > 0.0 and known.max() >= _WIDE * known.min():
        _make_logarithmic(axis)


def _make_logarithmic(axis: XAxis | YAxis) -> None:
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def values(estimates: pd.Series) -> FloatArray:
    """Return the values of estimates, NaN for None, (n,)."""
    return np.array([item.value if item else np.nan for item in estimates], dtype=float)


def _bar(item: Any) -> list[list[float]]:  # noqa: ANN401 - an estimate out of a frame
    """Return the lengths of the bars to both sides of an estimate."""
    low, high = item.ends
    return [[item.value - low], [high - item.value]]


def _note(axes: Axes, text: str) -> None:
    note(axes, 0.5, 0.5, text, ha="center", color=GREY)
