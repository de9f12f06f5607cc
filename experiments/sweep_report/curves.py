"""Charts over one axis of a sweep, of tails, costs and paired differences."""

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
from ..results.statistics import IntervalEstimate, Proportion, survival
from .aggregate import Cell, Group, PairedDifference, Tail
from .axes import Scale
from .runs import Runs

ERROR_LABEL: Final = "trailer cross-track p95 [cm]"
_ASIDE: Final = 0.5  # width of the bars at one text value, as a share of the spacing
_LONG: Final = 34  # characters of all labels of an axis that fit side by side
_WIDE: Final = 6.0  # largest over smallest value from which an axis is logarithmic


def curve_panels(controllers: Sequence[str], scale: Scale, cells: Sequence[Cell]) -> list[Panel]:
    """Return failure rate, if any run failed, and error over one axis, 95 % intervals as bands.

    Args:
        controllers: of the study.
        scale: the axis.
        cells: grouped by it.
    """

    def failures(axes: Axes) -> None:
        _curves(axes, controllers, scale, cells, lambda group: group.failure_rate, 100.0)
        dress(axes, scale.label, "failed [%]")
        axes.set_ylim(-3.0, 103.0)

    def error(axes: Axes) -> None:
        _curves(axes, controllers, scale, cells, lambda group: group.error_cm, 1.0)
        dress(axes, scale.label, ERROR_LABEL)
        errors = [cell.group.error_cm.value for cell in cells if cell.group.error_cm]
        _logarithmic_where_wide(axes.yaxis, errors)

    panels = [Panel(f"Error of completed runs over {scale.label}", error, tuple(controllers))]
    if any(len(cell.group.failed) for cell in cells):
        panels.insert(0, Panel(f"Failed runs over {scale.label}", failures, tuple(controllers)))
    return panels


def _curves(
    axes: Axes,
    controllers: Sequence[str],
    scale: Scale,
    cells: Sequence[Cell],
    select: Callable[[Group], IntervalEstimate | Proportion | None],
    factor: float,
) -> None:
    for number in range(len(controllers)):
        points = [
            (scale.positions[cell.places[0]], estimate)
            for cell in cells
            if cell.group.controller == number and (estimate := select(cell.group))
        ]
        if not points:
            continue
        x = np.array([position for position, _ in points])
        y, low, high = factor * np.array([(item.value, *item.ends) for _, item in points]).T
        looks = series(number, controllers[number])
        if scale.numeric:
            band = {"color": looks["color"], "alpha": 0.15, "linewidth": 0.0}
            axes.fill_between(x, low, high, label=controllers[number], **band)
            axes.plot(x, y, linewidth=1.3, markersize=3.8, **looks)
        else:  # text values have nothing between them: no line, and bars side by side
            aside = _ASIDE * (number - 0.5 * (len(controllers) - 1)) / len(controllers)
            markers: dict[str, Any] = looks | {"linestyle": "none", "markersize": 3.8}
            axes.errorbar(x + aside, y, yerr=[y - low, high - y], **markers)
    if not any(select(cell.group) for cell in cells):
        _note_none(axes)
    if scale.logarithmic:
        axes.set_xscale("log")
    ticks(axes, scale, "x", scale.positions.tolist())
    axes.set_xlim(_margins(scale))


def _margins(scale: Scale) -> tuple[float, float]:
    """Return the ends of an axis with a margin beside its values."""
    first, last = float(scale.positions[0]), float(scale.positions[-1])
    if scale.logarithmic:
        factor = (last / first) ** 0.05
        return first / factor, last * factor
    margin = 0.05 * (last - first) if scale.numeric else 0.5
    return first - margin, last + margin


def _note_none(axes: Axes) -> None:
    note(axes, 0.5, 0.5, "no run completed", ha="center", color=GREY)


def tail_panel(runs: Runs) -> Panel:
    """Return the share of the runs with a larger error; a run not completed exceeds any."""

    def draw(axes: Axes) -> None:
        finite = np.isfinite(runs.error_cm)
        errors = runs.error_cm[finite]
        right = 1.1 * float(errors.max()) if len(errors) else 1.0
        for number in range(len(runs.controllers)):
            own = runs.controller_index == number
            not_completed = int((own & ~runs.completed).sum())
            own_errors = runs.error_cm[own & finite]
            if not len(own_errors) + not_completed:
                continue  # all its runs are too short for an error figure
            x, y = survival(own_errors, not_completed)
            looks = series(number, runs.controllers[number]) | {"marker": "", "linewidth": 1.4}
            lost = not_completed / (len(own_errors) + not_completed)
            x, y = np.append(x, right), np.append(y, lost)
            axes.step(x, 100.0 * np.where(y > 0.0, y, np.nan), where="post", **looks)
        if not len(errors):
            _note_none(axes)
        dress(axes, ERROR_LABEL, "runs that are worse [%]")
        _logarithmic_where_wide(axes.xaxis, errors)
        _make_logarithmic(axes.yaxis)
        axes.set_ylim(min(4.0, axes.get_ylim()[0]), 120.0)
        axes.axhline(5.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))

    return Panel("Tails: share of the runs that are worse", draw, runs.controllers)


def cost_panel(controllers: Sequence[str], groups: Sequence[Group], tails: Sequence[Tail]) -> Panel:
    """Return error over the cost of a control step: one point with intervals per controller."""

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
            looks: dict[str, Any] = series(group.controller, controllers[group.controller]) | {
                "markersize": 7.0,
                "linestyle": "none",
            }
            axes.errorbar(cost.value, error.value, xerr=spans[0], yerr=spans[1], **looks)
        if not shown:
            _note_none(axes)
        dress(axes, "control step, median [us]", ERROR_LABEL)
        _logarithmic_where_wide(axes.xaxis, [cost.value for _, _, cost in shown])
        _logarithmic_where_wide(axes.yaxis, [error.value for _, error, _ in shown])
        axes.margins(0.12)

    return Panel("Error against computation time", draw, tuple(controllers))


def difference_panel(
    controllers: Sequence[str], against: int, differences: Sequence[PairedDifference]
) -> Panel:
    """Return the paired difference of the error of every other controller to one."""

    def draw(axes: Axes) -> None:
        for place, item in enumerate(differences):
            looks: dict[str, Any] = series(item.controller, controllers[item.controller]) | {
                "markersize": 6.0,
                "linestyle": "none",
            }
            if item.error_cm is not None:
                value, (low, high) = item.error_cm.value, item.error_cm.ends
                span = [[value - low], [high - value]]
                axes.errorbar(value, place, xerr=span, capsize=3.0, **looks)
        if not any(item.error_cm for item in differences):
            note(axes, 0.5, 0.5, "no pair completed", ha="center", color=GREY)
        axes.axvline(0.0, color=BLACK, linewidth=0.9)
        label = "difference of the error, run by run [cm]"
        if max((abs(item.error_cm.value) for item in differences if item.error_cm), default=0) > 10:
            axes.set_xscale("symlog", linthresh=1.0)  # one poor controller hides no difference
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            left, right = axes.get_xlim()
            axes.set_xlim(1.3 * min(left, -1.0), 1.3 * max(right, 1.0))
            label += ", linear within 1 cm"
        dress(axes, label, "")
        axes.set_yticks(
            range(len(differences)), [controllers[item.controller] for item in differences]
        )
        axes.set_ylim(len(differences) - 0.4, -0.6)

    return Panel(f"Better (left) or worse than {controllers[against]}", draw)


def holds_panel(controllers: Sequence[str], scale: Scale, cells: Sequence[Cell]) -> Panel:
    """Return the values of one axis at which each controller holds or fails."""

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
    """Label an axis with the values of a scale; rotate long labels."""
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
