"""Reference and driven paths, whole and where the error is largest (the paper's two figures)."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from proving_ground.testbed.recording.channels import REFERENCE, STATE
from proving_ground.testbed.recording.record import Record

from ..results.tracking import BODIES, START_UP_S, Tracking, rows_at_same_time, tracking
from .style import BLACK, BODY_COLOURS, GREY, PALE, blank, dress, legend, note

_ZOOM_ERRORS: Final = 4.0  # half width of a zoom in errors of the moment that it shows
_ZOOM_MIN_M: Final = 1.0  # but no less, so that a good run still shows a piece of path
_ZOOM_MAX_M: Final = 6.0  # and no more, so that a lost one is still zoomed in
_ZOOM_SHAPE: Final = 1.4  # width over height


def path_figure(record: Record) -> Figure:
    """Return the driven paths beside the reference, with two zooms."""
    figure = blank(6.0)
    whole, *zooms = figure.subplot_mosaic(
        [["whole", "whole"], ["straight", "curve"]], height_ratios=[1.0, 1.0]
    ).values()
    _draw_paths(whole, record)
    dress(whole, "x east [m]", "y north [m]")
    whole.set_aspect("equal", adjustable="datalim")
    legend(whole, 3)
    errors = tracking(record)
    for axes, where, rows in zip(
        zooms, ("straight", "curve"), (~errors.curved, errors.curved), strict=True
    ):
        dress(axes, "x east [m]", "y north [m]", f"Largest error on a {where}")
        counted = np.flatnonzero(rows & (errors.time_s >= START_UP_S))
        if len(counted):
            _zoom(axes, whole, record, errors, counted)
        else:
            note(axes, 0.5, 0.5, f"no {where} after the start-up", ha="center", color=GREY)
    return figure


def _draw_paths(axes: Axes, record: Record) -> None:
    place = record[REFERENCE].columns("x_t_m", "y_t_m")
    axes.plot(*place.T, color=PALE, linewidth=3.0, label="reference")
    for body, letter in BODIES.items():
        place = record[STATE].columns(f"x_{letter}_m", f"y_{letter}_m")
        axes.plot(*place.T, color=BODY_COLOURS[body], linewidth=1.0, label=body)


def _zoom(
    axes: Axes, whole: Axes, record: Record, errors: Tracking, rows: NDArray[np.intp]
) -> None:
    """Show where the tractor's error is largest among `rows`, and both bodies at that moment."""
    worst = int(rows[np.argmax(errors.tractor.euclidean_m[rows])])
    _, state, reference = rows_at_same_time(record, STATE, REFERENCE)
    _draw_paths(axes, record)
    ends = []
    for body, letter in BODIES.items():
        place = (f"x_{letter}_m", f"y_{letter}_m")
        here = record[STATE].columns(*place)[state[worst]]
        there = record[REFERENCE].columns(*place)[reference[worst]]
        axes.plot(*zip(here, there, strict=True), color=BODY_COLOURS[body], linewidth=1.0)
        axes.plot(*here, "o", color=BODY_COLOURS[body], markersize=5)
        axes.plot(*there, "o", markeredgecolor=BLACK, markerfacecolor="white", markersize=5)
        if body == "tractor":
            ends = [here, there]
    x, y = np.mean(ends, axis=0)
    error_m = float(errors.tractor.euclidean_m[worst])
    half = min(max(_ZOOM_ERRORS * error_m, _ZOOM_MIN_M), _ZOOM_MAX_M)
    wide = _ZOOM_SHAPE * half
    axes.set_xlim(x - wide, x + wide)
    axes.set_ylim(y - half, y + half)
    axes.set_box_aspect(1.0 / _ZOOM_SHAPE)
    note(
        axes, 0.02, 0.03, f"t = {errors.time_s[worst]:.1f} s: tractor off by {100 * error_m:.1f} cm"
    )
    corner = (x - wide, y - half)
    whole.add_patch(Rectangle(corner, 2 * wide, 2 * half, fill=False, edgecolor=GREY))
