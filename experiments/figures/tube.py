"""Figure of the containment of a run in its tube."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...testbed.recording.record import Record
from ..results.containment import Containment, containment, leftward
from .style import BLACK, BODY_COLOURS, GREY, PALE, blank, dress, legend, note, shade


def tube_figure(record: Record) -> Figure:
    """Return the cross-track deviation of both true axle points, and their margin in the tube."""
    contained = containment(record)
    figure = blank(5.4)
    *rows, last = figure.subplots(3, 1, sharex=True)
    for axes, (body, column) in zip(rows, contained.ACROSS.items(), strict=True):
        _draw_deviation(axes, contained, column, body)
    shade(last, contained.time_s, contained.curved)
    margin = contained.margin
    last.plot(contained.time_s, margin, color=BLACK, linewidth=0.8)
    last.axhline(0.0, color=GREY, linewidth=0.8)
    dress(last, "time [s] (shaded: curves)", "margin [1]")
    last.margins(x=0.0)
    inside = 100.0 * np.mean(margin >= 0.0) if margin.size else np.nan
    note(last, 0.02, 0.06, f"both true axle points inside at {inside:.2f} % of the ticks")
    return figure


def _draw_deviation(axes: Axes, contained: Containment, column: int, body: str) -> None:
    half_width_cm = 100 * contained.half_width[:, column]
    offset_cm = 100 * leftward(contained.deviation[:, column])
    shade(axes, contained.time_s, contained.curved)
    axes.fill_between(
        contained.time_s, -half_width_cm, half_width_cm, color=PALE, alpha=0.6, label="tube"
    )
    axes.plot(contained.time_s, offset_cm, color=BODY_COLOURS[body], linewidth=0.8, label=body)
    dress(axes, "", "deviation from nominal\nstate, left positive [cm]")
    axes.margins(x=0.0)
    legend(axes, 2)
