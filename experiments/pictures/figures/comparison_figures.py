"""Figures of several runs on one reference."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ttempc.types import FloatArray

from ....testbed.recording.channels import CONTROL, REFERENCE
from ...results.run_comparison import ComparedRun
from ...results.tracking_errors import BODIES, position_fields
from .magnified import beside, counted_errors, extent_of, line_of, magnification
from .run_figures import (
    BOUNDS,
    INPUTS,
    LENGTH,
    draw_bounds,
    path_length,
    shade_errors,
)
from .style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    SKY,
    dress,
    has_column_width,
    label_below,
    legend,
    note,
    stacked,
)

_COLOURS: Final = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
# Equal lines are all seen, since the gaps of a later one show those below it.
_DASHES: Final = ("-", (0, (6, 2)), (0, (3, 2)), (0, (8, 2, 2, 2)), (0, (1.5, 1.5)), (0, (4, 4)))


def paths_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the reference of both axle points, and beside it the errors of each run, enlarged."""
    figure, rows = _stacked(2, 3.2, runs, share_x=False)
    longest = max(runs, key=lambda run: len(run.record[REFERENCE]))
    for axes, body in zip(rows, BODIES, strict=True):
        reference = longest.record[REFERENCE].columns(*position_fields(body))
        axes.plot(*reference.T, color=PALE, linewidth=2.0, label="reference")
        errors = [counted_errors(run.errors)[body] for run in runs]
        factor = magnification(extent_of(reference), errors)
        for (run, style), error in zip(_lines(runs), errors, strict=True):
            points, headings = line_of(run.record, body)
            shown = len(error)
            enlarged = beside(points[:shown], headings[:shown], factor * error)
            axes.plot(*enlarged.T, **style)
        dress(axes, "x east [m]", "y north [m]")
        note(axes, 0.01, 0.97, f"{body}: errors {factor:g} times as large", va="top")
        axes.set_aspect("equal", adjustable="datalim")
    legend(rows[0], len(runs) + 1)
    return figure


def errors_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the errors of all points to the left of the reference over the length of the path."""
    points = max((run.errors.by_point for run in runs), key=len)
    figure, rows = _stacked(len(points), 2.3, runs, share_y=True)

    def place(run: ComparedRun) -> FloatArray:
        return path_length(run.record)[: len(run.errors.time_s)]

    for axes, point in zip(rows, points, strict=True):
        shade_errors(axes, place(runs[0]), runs[0].errors)
        for run, style in _lines(runs):
            if (error := run.errors.by_point.get(point)) is not None:
                axes.plot(place(run), 100 * error.cross_m, **style)
        dress(axes, "", f"{point} cross-track,\nleft positive [cm]")
        axes.margins(x=0.0)
        axes.axhline(0.0, color=BLACK, linewidth=0.6)
    legend(rows[0], len(runs))
    label_below(rows[-1], LENGTH)
    return figure


def inputs_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the commands of all runs with the bounds of the first run."""
    figure, rows = _stacked(3, 2.1, runs)
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for run, style in _lines(runs):
            table = run.record[CONTROL]
            common = table.time_s <= run.end_s
            sent = np.where(common, factor * table[f"{name}_command"], np.nan)
            axes.plot(table.time_s, sent, **style)
        dress(axes, "", label)
        draw_bounds(axes, runs[0].record[CONTROL], name, factor)
    rows[-1].set_xlim(0.0, runs[0].end_s)
    legend(rows[0], len(runs) + 1, [BOUNDS])
    label_below(rows[-1], "time [s]")
    return figure


COMPARISONS: Final[dict[str, Callable[[Sequence[ComparedRun]], Figure]]] = {
    "path": paths_figure,
    "cross-track": errors_figure,
    "signals": inputs_figure,
}


def comparison_figures(runs: Sequence[ComparedRun]) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the figures of a comparison, by name."""
    return {name: partial(draw, runs) for name, draw in COMPARISONS.items()}


def _stacked(
    count: int, height_in: float, runs: Sequence[ComparedRun], **share: bool
) -> tuple[Figure, list[Axes]]:
    """Return `stacked` axes, with what all runs have in common as the title of their figure."""
    figure, rows = stacked(count, height_in, **share)
    if runs[0].common and not has_column_width():  # a paper says it in its caption
        figure.suptitle(runs[0].common, x=0.01, ha="left", fontsize=8.5, fontweight="bold")
    return figure, rows


def _lines(runs: Sequence[ComparedRun]) -> Iterator[tuple[ComparedRun, dict[str, Any]]]:
    for run, colour, dashes in zip(runs, _COLOURS, _DASHES, strict=False):
        style = {"color": colour, "linestyle": dashes, "linewidth": 1.1}
        yield run, {"label": run.short_label, **style}
