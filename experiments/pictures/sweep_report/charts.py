"""Charts of a sweep: tails of the error, curves over one axis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, StrMethodFormatter

from ttempc.types import FloatArray

from ..figures.style import GREY, blank, dress, note, series
from .runs import Scale, Sweep

_HEIGHT_IN: Final = 2.9
_ASIDE: Final = 0.5  # width of the bars at one text value, as a share of the spacing
_LONG: Final = 34  # characters of all labels of an axis that fit side by side
_WIDE: Final = 6.0  # largest over smallest value from which an axis is logarithmic


@dataclass(frozen=True, slots=True)
class Panel:
    """A chart of half a page's width."""

    title: str
    draw: Callable[[Axes], None]  # draws the chart onto empty axes
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
            x = scale.positions[own[scale.column]]
            y, low, high = factor * np.array([(item.value, *item.ends) for item in own[column]]).T
            looks: dict[str, Any] = series(number, name) | {"markersize": 3.8}
            if scale.numeric:
                band = {"color": looks["color"], "alpha": 0.15, "linewidth": 0.0}
                axes.fill_between(x, low, high, **band)
                axes.plot(x, y, linewidth=1.3, **looks)
            else:  # text values have nothing between them: no line, and bars side by side
                count = len(sweep.controllers)
                aside = _ASIDE * (number - 0.5 * (count - 1)) / count
                looks["linestyle"] = "none"
                axes.errorbar(x + aside, y, yerr=[y - low, high - y], **looks)
        if not len(known):
            note(axes, 0.5, 0.5, "no run completed", ha="center", color=GREY)
        if scale.logarithmic:
            axes.set_xscale("log")
        _ticks(axes.xaxis, scale, scale.positions.tolist())
        if column == "rate":
            axes.set_ylim(-3.0, 103.0)
        else:
            _logarithmic_where_wide(axes.yaxis, _values(known[column]))

    error = partial(draw, "error_cm", 1.0, error_label(sweep))
    panels = [Panel(f"Error over {scale.label}", error, sweep.controllers)]
    if sweep.rows["failed"].any():
        failed = partial(draw, "rate", 100.0, "failed [%]")
        panels.insert(0, Panel(f"Failed runs over {scale.label}", failed, sweep.controllers))
    return panels


def tail_panel(sweep: Sweep) -> Panel:
    """Return the share of the runs with a larger error; a run not completed exceeds any."""

    def draw(axes: Axes) -> None:
        known = sweep.rows["error_cm"].dropna()
        for number, name in enumerate(sweep.controllers):
            own = sweep.rows[sweep.rows["controller"] == name]
            errors = np.sort(own["error_cm"].dropna())
            lost = int(own["status"].ne("completed").sum())
            above = (np.arange(len(errors) - 1, -1, -1) + lost) / max(1, len(errors) + lost)
            looks: dict[str, Any] = series(number, name) | {"markersize": 3.8}
            axes.step(errors, 100.0 * np.where(above > 0.0, above, np.nan), where="post", **looks)
        if not len(known):
            note(axes, 0.5, 0.5, "no run completed", ha="center", color=GREY)
        dress(axes, error_label(sweep), "runs that are worse [%]")
        _logarithmic_where_wide(axes.xaxis, known.to_numpy())
        _make_logarithmic(axes.yaxis)
        axes.set_ylim(min(4.0, 80.0 * len(sweep.controllers) / len(sweep.rows)), 120.0)
        axes.axhline(5.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))

    return Panel("Share of the runs that are worse", draw, sweep.controllers)


def _ticks(axis: XAxis | YAxis, scale: Scale, positions: Sequence[float]) -> None:
    """Label an axis with the values of a scale; rotate long labels."""
    axis.set_minor_locator(NullLocator())
    turned = axis.axis_name == "x" and sum(map(len, scale.texts)) > _LONG
    looks = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if turned else {}
    axis.set_ticks(positions, scale.texts, **looks)


def _logarithmic_where_wide(axis: XAxis | YAxis, numbers: FloatArray) -> None:
    if len(numbers) and numbers.min() > 0.0 and numbers.max() >= _WIDE * numbers.min():
        _make_logarithmic(axis)


def _make_logarithmic(axis: XAxis | YAxis) -> None:
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _values(estimates: pd.Series) -> FloatArray:
    """Return the values of estimates, NaN for None, (n,)."""
    return np.array([item.value if item else np.nan for item in estimates], dtype=float)
