"""One axis of a sweep, its tails, and error against the cost of a control step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter, StrMethodFormatter

from ttempc.types import FloatArray

from ..figures.panel import Panel
from ..figures.style import BLACK, GREY, dress, note, series
from ..results.statistics import Estimate, survival
from .aggregate import Cell, Difference, Group, Tail
from .axes import Scale
from .runs import Runs

ERROR_LABEL: Final = "trailer cross-track p95 [cm]"
_ASIDE: Final = 0.5  # width of the bars at one word, of the way to the next
_LONG: Final = 34  # letters of all labels of an axis that fit side by side
_WIDE: Final = 6.0  # greatest over least value from which a logarithm shows more


def curve_panels(
    controllers: Sequence[str], scale: Scale, cells: Sequence[Cell]
) -> tuple[Panel, Panel]:
    """Return failure rate and error over one axis, 95 % intervals as bands.

    Args:
        controllers: all of the study.
        scale: the axis.
        cells: grouped by it.
    """

    def failures(axes: Axes) -> None:
        _curves(axes, controllers, scale, cells, lambda group: group.failure_rate, 100.0)
        dress(axes, scale.label, "failed [%]")
        axes.set_ylim(-3.0, 103.0)

    def errors(axes: Axes) -> None:
        _curves(axes, controllers, scale, cells, lambda group: group.error_cm, 1.0)
        dress(axes, scale.label, ERROR_LABEL)
        found = [cell.group.error_cm.value for cell in cells if cell.group.error_cm]
        _logarithmic_where_wide(axes.yaxis, found)

    return (
        Panel(f"Failed runs over {scale.label}", failures, tuple(controllers)),
        Panel(f"Error of completed runs over {scale.label}", errors, tuple(controllers)),
    )


def _curves(
    axes: Axes,
    controllers: Sequence[str],
    scale: Scale,
    cells: Sequence[Cell],
    told: Callable[[Group], Estimate | None],
    factor: float,
) -> None:
    for number in range(len(controllers)):
        mine = [
            (scale.positions[cell.places[0]], found)
            for cell in cells
            if cell.group.controller == number and (found := told(cell.group))
        ]
        if not mine:
            continue
        x = np.array([place for place, _ in mine])
        y, low, high = factor * np.array([(found.value, *found.ends) for _, found in mine]).T
        looks = series(number)
        if scale.numeric:
            axes.fill_between(x, low, high, color=looks["color"], alpha=0.15, linewidth=0.0)
            axes.plot(x, y, linewidth=1.3, markersize=3.8, **looks)
        else:  # nothing lies between two words: no line, and bars beside each other
            aside = _ASIDE * (number - 0.5 * (len(controllers) - 1)) / len(controllers)
            points: dict[str, Any] = looks | {"linestyle": "none", "markersize": 3.8}
            axes.errorbar(x + aside, y, yerr=[y - low, high - y], **points)
    if not any(told(cell.group) for cell in cells):
        _say_none(axes)
    if scale.logarithmic:
        axes.set_xscale("log")
    ticks(axes, scale, "x", scale.positions.tolist())
    axes.set_xlim(_margins(scale))


def _margins(scale: Scale) -> tuple[float, float]:
    """Return the ends of an axis with some room beside its values."""
    first, last = float(scale.positions[0]), float(scale.positions[-1])
    if scale.logarithmic:
        room = (last / first) ** 0.05
        return first / room, last * room
    room = 0.05 * (last - first) if scale.numeric else 0.5
    return first - room, last + room


def _say_none(axes: Axes) -> None:
    note(axes, 0.5, 0.5, "no run completed", ha="center", color=GREY)


def tail_panel(runs: Runs) -> Panel:
    """Return how large a share of the runs is worse than an error, failures worse than any."""

    def draw(axes: Axes) -> None:
        found = runs.error_cm[np.isfinite(runs.error_cm)]
        right = 1.1 * float(found.max()) if len(found) else 1.0
        for number in range(len(runs.controllers)):
            mine = runs.error_cm[runs.driver == number]
            there = mine[np.isfinite(mine)]
            x, y = survival(there, len(mine) - len(there))
            looks = series(number) | {"marker": "", "linewidth": 1.4}
            lost = 1.0 - len(there) / len(mine)
            x, y = np.append(x, right), np.append(y, lost)
            axes.step(x, 100.0 * np.where(y > 0.0, y, np.nan), where="post", **looks)
        if not len(found):
            _say_none(axes)
        dress(axes, ERROR_LABEL, "runs that are worse [%]")
        _logarithmic_where_wide(axes.xaxis, found)
        _make_logarithmic(axes.yaxis)
        axes.set_ylim(min(4.0, axes.get_ylim()[0]), 120.0)
        axes.axhline(5.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))

    return Panel("Tails: share of the runs that are worse", draw, runs.controllers)


def cost_panel(controllers: Sequence[str], groups: Sequence[Group], tails: Sequence[Tail]) -> Panel:
    """Return error against the cost of a control step, a point with its interval a controller."""

    def draw(axes: Axes) -> None:
        shown = [
            (group, group.error_cm, tail.step_us)
            for group, tail in zip(groups, tails, strict=True)
            if group.error_cm and tail.step_us
        ]
        for group, error, cost in shown:
            spans = [
                [[end.value - end.ends[0]], [end.ends[1] - end.value]] for end in (cost, error)
            ]
            looks: dict[str, Any] = series(group.controller) | {
                "markersize": 7.0,
                "linestyle": "none",
            }
            axes.errorbar(cost.value, error.value, xerr=spans[0], yerr=spans[1], **looks)
        if not shown:
            _say_none(axes)
        dress(axes, "control step, median [us]", ERROR_LABEL)
        _logarithmic_where_wide(axes.xaxis, [cost.value for _, _, cost in shown])
        _logarithmic_where_wide(axes.yaxis, [error.value for _, error, _ in shown])
        axes.margins(0.12)

    return Panel("Error against computation time", draw, tuple(controllers))


def difference_panel(
    controllers: Sequence[str], against: int, differences: Sequence[Difference]
) -> Panel:
    """Return how much every other controller errs more or less than one, run by run."""

    def draw(axes: Axes) -> None:
        for place, item in enumerate(differences):
            looks: dict[str, Any] = series(item.controller) | {
                "markersize": 6.0,
                "linestyle": "none",
            }
            if item.error_cm is not None:
                found, (low, high) = item.error_cm, item.error_cm.ends
                span = [[found.value - low], [high - found.value]]
                axes.errorbar(found.value, place, xerr=span, capsize=3.0, **looks)
        if not any(item.error_cm for item in differences):
            note(axes, 0.5, 0.5, "no pair completed", ha="center", color=GREY)
        axes.axvline(0.0, color=BLACK, linewidth=0.9)
        dress(axes, "difference of the error, run by run [cm]", "")
        axes.set_yticks(
            range(len(differences)), [controllers[item.controller] for item in differences]
        )
        axes.set_ylim(len(differences) - 0.4, -0.6)

    return Panel(f"Better (left) or worse than {controllers[against]}", draw)


def holds_panel(controllers: Sequence[str], scale: Scale, cells: Sequence[Cell]) -> Panel:
    """Return one chart of where on an axis each controller holds and where it fails."""

    def draw(axes: Axes) -> None:
        for cell in cells:
            number = cell.group.controller
            looks = {"color": series(number)["color"], "markersize": 7.0}
            marker = "x" if cell.group.fails else "o"
            axes.plot(cell.places[0], number, marker=marker, **looks)
        dress(axes, f"{scale.label}  (dot: holds, cross: fails)", "")
        ticks(axes, scale, "x")
        axes.set_yticks(range(len(controllers)), controllers)
        axes.set_ylim(len(controllers) - 0.4, -0.6)

    return Panel("Where at least half of the runs fail", draw)


def ticks(
    axes: Axes, scale: Scale, direction: Literal["x", "y"], positions: Sequence[float] | None = None
) -> None:
    """Label an axis with the values of a scale, turned where they do not fit side by side."""
    where = range(len(scale.texts)) if positions is None else positions
    axis = axes.xaxis if direction == "x" else axes.yaxis
    axis.set_major_locator(FixedLocator(list(where)))
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(FixedLocator([]))
    turned = direction == "x" and sum(map(len, scale.texts)) > _LONG
    axis.set_ticklabels(scale.texts, rotation=35 if turned else 0)
    if turned:
        for label in axis.get_ticklabels():
            label.set(ha="right", rotation_mode="anchor")


def _logarithmic_where_wide(axis: XAxis | YAxis, values: Sequence[float] | FloatArray) -> None:
    if len(values) and min(values) > 0.0 and max(values) >= _WIDE * min(values):
        _make_logarithmic(axis)


def _make_logarithmic(axis: XAxis | YAxis) -> None:
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
