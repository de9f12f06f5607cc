"""Figure of the cross-track errors of tractor, trailer and tool over the length of the path."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...testbed.recording.channels import REFERENCE, STATE
from ...testbed.recording.record import Record
from ..results.tracking_errors import (
    START_UP_S,
    position_fields,
    rows_at_same_time,
    tracking_errors,
)
from .style import BLACK, BODY_COLOURS, blank, dress, legend, shade


def cross_track_figure(record: Record) -> Figure:
    """Return the errors to the left of the reference over the tractor's arc length of it."""
    errors = tracking_errors(record)
    _, _, rows = rows_at_same_time(record, STATE, REFERENCE)
    places = record[REFERENCE].columns(*position_fields("tractor"))[rows]
    steps_m = np.hypot(*np.diff(places, axis=0).T)
    length_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    figure = blank(2.6)
    axes = figure.subplots()
    shade(axes, length_m, errors.curved)
    shade(axes, length_m, errors.time_s < START_UP_S, hatch="////")
    for body, error in errors.by_point.items():
        axes.plot(
            length_m, 100 * error.cross_m, color=BODY_COLOURS[body], linewidth=1.0, label=body
        )
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    dress(
        axes,
        "length of the path [m] (hatched: start-up; shaded: curves)",
        "cross-track error,\nleft positive [cm]",
    )
    legend(axes, 3)
    axes.margins(x=0.0)
    return figure
