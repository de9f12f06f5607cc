"""Where in its tube a run was: deviations across the track in their half widths, and the margin."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from proving_ground.testbed.recording.channels import TUBE
from proving_ground.testbed.recording.record import Record
from ttempc.types import FloatArray

from ..results.containment import Containment, containment, to_the_left
from .style import BLACK, BODY_COLOURS, GREY, PALE, blank, dress, legend, note, shade


def tube_figure(record: Record) -> Figure:
    """Return the truth's deviation of both axle points in the tube, and the estimate's margin."""
    found = containment(record)
    figure = blank(5.4)
    *rows, last = figure.subplots(3, 1, sharex=True)
    for axes, (body, column) in zip(rows, found.ACROSS.items(), strict=True):
        _across(axes, found, column, body)
    shade(last, found.time_s, found.curved)
    counted = record[TUBE].time_s >= found.time_s.min(initial=np.inf)
    margin: FloatArray = record[TUBE]["margin"][counted]
    last.plot(record[TUBE].time_s[counted], margin, color=BLACK, linewidth=0.8)
    last.axhline(0.0, color=GREY, linewidth=0.8)
    dress(last, "time [s] (shaded: curves)", "margin of estimate [1]")
    last.margins(x=0.0)
    inside = 100.0 * np.mean(margin >= 0.0) if margin.size else np.nan
    note(last, 0.02, 0.06, f"inside {inside:.1f} % of the ticks")
    return figure


def _across(axes: Axes, found: Containment, column: int, body: str) -> None:
    width = 100 * found.half_width[:, column]
    aside = 100 * to_the_left(found.deviation[:, column])
    shade(axes, found.time_s, found.curved)
    axes.fill_between(found.time_s, -width, width, color=PALE, alpha=0.6, label="tube")
    axes.plot(found.time_s, aside, color=BODY_COLOURS[body], linewidth=0.8, label=body)
    dress(axes, "", "to the left [cm]")
    axes.margins(x=0.0)
    legend(axes, 2)
