"""Figure of the Euclidean errors of tractor, trailer and tool over time, as in the paper."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...testbed.recording.record import Record, fault_spans
from ..results.tracking_errors import START_UP_S, BodyError, TrackingErrors, tracking_errors
from .style import BLACK, BODY_COLOURS, GREY, blank, dress, mark_faults, note, shade, wrapped

TIME_OF_ERRORS: Final = "time [s] (hatched: start-up, not counted; shaded: curves)"


def error_figure(record: Record) -> Figure:
    """Return the errors of all points, curves shaded, with their means."""
    errors = tracking_errors(record)
    points = errors.by_point
    figure = blank(2.1 * len(points))
    rows = figure.subplots(len(points), 1, sharex=True, sharey=True)
    for axes, (body, error) in zip(rows, points.items(), strict=True):
        shade(axes, errors.time_s, errors.curved)
        shade(axes, errors.time_s, errors.time_s < START_UP_S, hatch="////")
        mark_faults(axes, fault_spans(record.events), float(errors.time_s[-1]))
        style = {"color": BODY_COLOURS[body], "linewidth": 1.0, "label": body}
        axes.plot(errors.time_s, 100 * error.euclidean_m, **style)
        dress(axes, "", f"{body} error [cm]")
        _draw_means(axes, errors, error)
        axes.margins(x=0.0)
    rows[0].set_ylim(bottom=0.0)
    rows[0].set_ylim(top=1.22 * rows[0].get_ylim()[1])  # space for the text of the means
    rows[-1].set_xlabel(wrapped(rows[-1], TIME_OF_ERRORS), fontsize=8.5)
    return figure


def _draw_means(axes: Axes, errors: TrackingErrors, error: BodyError) -> None:
    """Draw the mean errors on straights and on curves as lines, with their values as text."""
    counted = (errors.time_s >= START_UP_S) & np.isfinite(error.along_m)
    parts = []
    for name, rows in (
        ("straights", counted & ~errors.curved),
        ("curves", counted & errors.curved),
    ):
        if rows.any():
            mean_m = float(np.mean(error.euclidean_m[rows]))
            mean_cm = np.where(rows, 100 * mean_m, np.nan)
            style = {"color": BLACK, "linewidth": 1.0, "label": f"mean on {name}"}
            axes.plot(errors.time_s, mean_cm, **style)
            parts.append(f"{name} {100 * mean_m:.1f} cm")
    text = f"mean on {', on '.join(parts)}" if parts else "shorter than the start-up"
    note(axes, 0.05, 0.93, text, va="top", color="black" if parts else GREY)
