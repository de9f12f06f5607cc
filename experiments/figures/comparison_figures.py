"""Figures of several runs on one reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from ...testbed.recording.channels import CONTROL, REFERENCE, STATE
from ..results.run_comparison import ComparedRun
from ..results.tracking_errors import BODIES, START_UP_S, position_fields
from .signals import BOUNDS, INPUTS, draw_bounds
from .style import (
    BLUE,
    GREEN,
    ORANGE,
    PALE,
    PURPLE,
    RED,
    SKY,
    blank,
    dress,
    legend,
    note,
    shade,
    wrapped,
)
from .tracking_error import TIME_OF_ERRORS

_COLOURS: Final = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
_WIDEST: Final = 2.2  # line width of the first run, below all others
_THINNEST: Final = 0.7  # of the last, on top


def paths_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the driven paths of both axle points and the reference."""
    figure = _blank(6.4, runs)
    rows = figure.subplots(2, 1)
    for axes, body in zip(rows, BODIES, strict=True):
        fields = position_fields(body)
        longest = max(runs, key=lambda run: len(run.record[REFERENCE]))
        reference = longest.record[REFERENCE].columns(*fields)
        axes.plot(*reference.T, color=PALE, linewidth=4.0, label="reference")
        for run, style in _lines(runs):
            table = run.record[STATE]
            driven = table.columns(*fields)[table.time_s <= run.end_s]
            axes.plot(*driven.T, **style)
        dress(axes, "x east [m]", "y north [m]")
        note(axes, 0.01, 0.97, body, va="top", fontweight="bold")
        axes.set_aspect("equal", adjustable="datalim")
    legend(rows[0], len(runs) + 1)
    return figure


def errors_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the errors of all points over the common time, curves shaded, start-up hatched."""
    points = max((run.errors.by_point for run in runs), key=len)
    figure = _blank(2.3 * len(points), runs)
    rows = figure.subplots(len(points), 1, sharex=True, sharey=True)
    first = runs[0].errors
    for axes, point in zip(rows, points, strict=True):
        shade(axes, first.time_s, first.curved)
        shade(axes, first.time_s, first.time_s < START_UP_S, hatch="////")
        for run, style in _lines(runs):
            if (error := run.errors.by_point.get(point)) is not None:
                axes.plot(run.errors.time_s, 100 * error.euclidean_m, **style)
        dress(axes, "", f"{point} error [cm]")
        axes.margins(x=0.0)
        axes.set_ylim(bottom=0.0)
    legend(rows[0], len(runs))
    rows[-1].set_xlabel(wrapped(rows[-1], TIME_OF_ERRORS), fontsize=8.5)
    return figure


def inputs_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the commands of all runs with the bounds of the first run."""
    figure = _blank(6.2, runs)
    rows = figure.subplots(3, 1, sharex=True)
    bounds, in_view = runs[0].record[CONTROL], False
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for run, style in _lines(runs):
            table = run.record[CONTROL]
            common = table.time_s <= run.end_s
            sent = np.where(common, factor * table[f"{name}_command"], np.nan)
            axes.plot(table.time_s, sent, **style)
        dress(axes, "", label)
        in_view |= draw_bounds(axes, bounds, name, factor)
    rows[-1].set_xlim(0.0, runs[0].end_s)
    legend(rows[0], len(runs) + 1, [BOUNDS] if in_view else [])
    rows[-1].set_xlabel("time [s]", fontsize=8.5)
    return figure


COMPARISONS: Final[dict[str, Callable[[Sequence[ComparedRun]], Figure]]] = {
    "path": paths_figure,
    "error": errors_figure,
    "signals": inputs_figure,
}


def comparison_figures(runs: Sequence[ComparedRun]) -> dict[str, Callable[[], Figure]]:
    """Return functions that draw the figures of a comparison, by name."""
    return {name: partial(draw, runs) for name, draw in COMPARISONS.items()}


def _blank(height_in: float, runs: Sequence[ComparedRun]) -> Figure:
    """Return an empty figure with what all runs have in common as its title."""
    figure = blank(height_in)
    if runs[0].common:
        figure.suptitle(runs[0].common, x=0.01, ha="left", fontsize=8.5, fontweight="bold")
    return figure


def _lines(runs: Sequence[ComparedRun]) -> Iterator[tuple[ComparedRun, dict[str, Any]]]:
    """Yield the runs with label, colour and width of their lines.

    A later line is thinner, so that equal lines are all seen.
    """
    widths = np.geomspace(_WIDEST, _THINNEST, len(runs)).tolist()
    for run, colour, width in zip(runs, _COLOURS, widths, strict=False):
        yield run, {"label": run.short_label, "color": colour, "linewidth": width}
