"""Figure of the reference and driven paths with zooms at the largest errors, as in the paper."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from ...testbed.recording.channels import REFERENCE, STATE, TOOL
from ...testbed.recording.record import Record
from ..results.tracking_errors import (
    BODIES,
    START_UP_S,
    TrackingErrors,
    position_fields,
    rows_at_same_time,
    tracking_errors,
)
from .style import BLACK, BODY_COLOURS, GREY, PALE, blank, dress, legend, note

_ZOOM_ERRORS: Final = 4.0  # half height of a zoom over the error at its moment
_ZOOM_MIN_M: Final = 1.0  # least half height, so that a good run still shows a piece of path
_ZOOM_MAX_M: Final = 6.0  # greatest half height, so that a diverged run is still zoomed in
_ZOOM_SHAPE: Final = 1.4  # width over height
_SETTLED_S: Final = 2.0 * START_UP_S  # the largest error before is often that of the start-up
_FLATTEST, _TALLEST = 0.3, 0.8  # height of the whole path over its width, for lines and squares
_TEXT_IN: Final = 1.6  # height of all labels, titles and the legend


def path_figure(record: Record) -> Figure:
    """Return the driven paths and the reference, with a zoom on a straight and on a curve."""
    figure = blank(1.0)
    width_in = figure.get_figwidth()
    extent = np.ptp(record[REFERENCE].columns(*position_fields("tractor")), axis=0)
    shape = float(np.clip(extent[1] / max(extent[0], 1e-9), _FLATTEST, _TALLEST))
    zoom_shape = 0.5 / _ZOOM_SHAPE
    figure.set_figheight((shape + zoom_shape) * width_in + _TEXT_IN)
    whole, *zooms = figure.subplot_mosaic(
        [["whole", "whole"], ["straight", "curve"]], height_ratios=[shape, zoom_shape]
    ).values()
    _draw_paths(whole, record)
    dress(whole, "x east [m]", "y north [m]")
    whole.set_aspect("equal", adjustable="datalim")
    legend(whole, 4)
    errors = tracking_errors(record)
    for axes, where, shaped in zip(
        zooms, ("straight", "curve"), (~errors.curved, errors.curved), strict=True
    ):
        settled = np.flatnonzero(shaped & (errors.time_s >= _SETTLED_S))
        counted = np.flatnonzero(shaped & (errors.time_s >= START_UP_S))
        if len(rows := settled if len(settled) else counted):
            moment = _zoom(axes, whole, record, errors, rows)
            since_s = _SETTLED_S if len(settled) else START_UP_S
            title = f"Largest error on a {where} after {since_s:g}\N{NO-BREAK SPACE}s: {moment}"
        else:
            title = ""
            note(axes, 0.5, 0.5, f"no {where} after the start-up", ha="center", color=GREY)
        dress(axes, "x east [m]", "y north [m]", title)
    return figure


def _draw_paths(axes: Axes, record: Record) -> None:
    reference = record[REFERENCE].columns(*position_fields("tractor"))
    axes.plot(*reference.T, color=PALE, linewidth=3.0, label="reference")
    for body in BODIES:
        driven = record[STATE].columns(*position_fields(body))
        axes.plot(*driven.T, color=BODY_COLOURS[body], linewidth=1.0, label=body)
    tool = record[TOOL]
    if len(tool):
        driven = np.where(tool["lowered"] == 1.0, tool.columns("x_m", "y_m").T, np.nan)
        axes.plot(*driven, color=BODY_COLOURS["tool"], linewidth=1.0, label="tool, lowered")


def _zoom(
    axes: Axes, whole: Axes, record: Record, errors: TrackingErrors, rows: NDArray[np.intp]
) -> str:
    """Show both bodies and their references at the largest error of either among `rows`.

    Returns:
        Body, error and time.
    """
    largest_m = {body: errors.by_point[body].euclidean_m[rows].max() for body in BODIES}
    centre = max(BODIES, key=largest_m.__getitem__)
    error_m = float(largest_m[centre])
    worst = int(rows[np.argmax(errors.by_point[centre].euclidean_m[rows])])
    _, state, reference = rows_at_same_time(record, STATE, REFERENCE)
    _draw_paths(axes, record)
    ends = []
    for body in BODIES:
        fields = position_fields(body)
        actual = record[STATE].columns(*fields)[state[worst]]
        desired = record[REFERENCE].columns(*fields)[reference[worst]]
        axes.plot(*zip(actual, desired, strict=True), color=BODY_COLOURS[body], linewidth=1.0)
        axes.plot(*actual, "o", color=BODY_COLOURS[body], markersize=5)
        axes.plot(*desired, "o", markeredgecolor=BLACK, markerfacecolor="white", markersize=5)
        if body == centre:
            ends = [actual, desired]
    x, y = np.mean(ends, axis=0)
    half_height = min(max(_ZOOM_ERRORS * error_m, _ZOOM_MIN_M), _ZOOM_MAX_M)
    half_width = _ZOOM_SHAPE * half_height
    axes.set_xlim(x - half_width, x + half_width)
    axes.set_ylim(y - half_height, y + half_height)
    axes.set_box_aspect(1.0 / _ZOOM_SHAPE)
    corner = (x - half_width, y - half_height)
    whole.add_patch(Rectangle(corner, 2 * half_width, 2 * half_height, fill=False, edgecolor=GREY))
    return (
        f"{centre}, {100 * error_m:.1f}\N{NO-BREAK SPACE}cm "
        f"at {errors.time_s[worst]:.1f}\N{NO-BREAK SPACE}s"
    )
