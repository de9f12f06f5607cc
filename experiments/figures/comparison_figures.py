"""Figures of several runs on one reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from proving_ground.testbed.recording.channels import CONTROL, REFERENCE, STATE

from ..results.run_comparison import ComparedRun
from ..results.tracking_errors import BODIES, position_fields
from .signals import INPUTS
from .style import (
    BLACK,
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
)

_COLOURS: Final = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)


def paths_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the driven paths of both axle points and the reference."""
    figure = blank(6.4)
    for axes, body in zip(figure.subplots(2, 1), BODIES, strict=True):
        fields = position_fields(body)
        longest = max(runs, key=lambda run: len(run.record[REFERENCE]))
        reference = longest.record[REFERENCE].columns(*fields)
        axes.plot(*reference.T, color=PALE, linewidth=3.0, label="reference")
        for run, colour in zip(runs, _COLOURS, strict=False):
            table = run.record[STATE]
            driven = table.columns(*fields)[table.time_s <= run.end_s]
            axes.plot(*driven.T, color=colour, linewidth=0.9, label=run.label)
        dress(axes, "x east [m]", "y north [m]")
        note(axes, 0.01, 0.97, body, va="top", fontweight="bold")
        axes.set_aspect("equal", adjustable="datalim")
    _legend(figure, len(runs) + 1)
    return figure


def errors_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the errors of all points over the common time, curves shaded."""
    points = max((run.errors.by_point for run in runs), key=len)
    figure = blank(2.3 * len(points))
    rows = figure.subplots(len(points), 1, sharex=True, sharey=True)
    for axes, point in zip(rows, points, strict=True):
        shade(axes, runs[0].errors.time_s, runs[0].errors.curved)
        for run, colour in zip(runs, _COLOURS, strict=False):
            if (error := run.errors.by_point.get(point)) is None:
                continue
            centimetres = 100 * error.euclidean_m
            axes.plot(run.errors.time_s, centimetres, color=colour, linewidth=0.9, label=run.label)
        dress(axes, "", f"{point} error [cm]")
        axes.margins(x=0.0)
        axes.set_ylim(bottom=0.0)
    _legend(figure, len(runs))
    rows[-1].set_xlabel("time [s] (shaded: curves)", fontsize=8.5)
    return figure


def inputs_figure(runs: Sequence[ComparedRun]) -> Figure:
    """Return the commands of all runs with the bounds of the first run."""
    figure = blank(6.2)
    rows = figure.subplots(3, 1, sharex=True)
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for run, colour in zip(runs, _COLOURS, strict=False):
            table = run.record[CONTROL]
            common = table.time_s <= run.end_s
            sent = np.where(common, factor * table[f"{name}_command"], np.nan)
            axes.plot(table.time_s, sent, color=colour, linewidth=0.9, label=run.label)
        bounds = runs[0].record[CONTROL]
        for bound in ("min", "max"):
            limit = factor * bounds[f"{name}_{bound}"]
            axes.plot(bounds.time_s, limit, color=BLACK, linestyle="--", linewidth=0.9)
        dress(axes, "", label)
        axes.margins(x=0.0, y=0.06)
    rows[-1].set_xlim(0.0, runs[0].end_s)
    _legend(figure, len(runs))
    rows[-1].set_xlabel("time [s]", fontsize=8.5)
    return figure


COMPARISONS: Final[dict[str, Callable[[Sequence[ComparedRun]], Figure]]] = {
    "path": paths_figure,
    "error": errors_figure,
    "signals": inputs_figure,
}


def _legend(figure: Figure, entries: int) -> None:
    legend(figure.axes[0], min(entries, 3))
