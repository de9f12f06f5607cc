"""Figure of the commands and the actions that add up to them, as in the paper."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ttempc.types import FloatArray

from ...testbed.recording.channels import CONTROL
from ...testbed.recording.record import Record, Table
from .style import BLACK, BLUE, GREY, RED, SKY, blank, dress, legend, note, wrapped

INPUTS: Final = (  # field, label, factor from the field's unit to the label's
    ("delta_t_rad", "front steering [deg]", np.degrees(1.0)),
    ("delta_i_rad", "trailer steering [deg]", np.degrees(1.0)),
    ("hp", "hydrostat position [%]", 100.0),
)
_ACTIONS: Final = (  # field, label, colour (the paper's roles: cyan, red, blue, black), width
    ("feedforward", "feedforward", SKY, 1.6),
    ("feedback", "feedback", RED, 0.8),
    ("robust", "robust", BLUE, 0.8),
    ("total", "total, before limits", GREY, 0.7),
    ("command", "total, as sent", BLACK, 1.0),
)
_HEADROOM: Final = 0.06  # of the range of the signals
_NEAR: Final = 0.3  # of the same; bounds farther away are left out
_EDGE: Final = 0.02  # of the same, beside a bound
_NOTE: Final = 0.15  # of the same, space for a note above them
_BOUND_LINE: Final[dict[str, Any]] = {"color": BLACK, "linestyle": "--", "linewidth": 0.9}
BOUNDS: Final = Line2D([], [], label="bounds", **_BOUND_LINE)
"""Entry of the legend for what `draw_bounds` draws."""


def signals_figure(record: Record) -> Figure:
    """Return feedforward, feedback, robust and total action of each input with its bounds.

    A controller that returns commands without such parts has the command alone.
    """
    table = record[CONTROL]
    given = [
        action
        for action in _ACTIONS
        if any(np.isfinite(table[f"{name}_{action[0]}"]).any() for name, _, _ in INPUTS)
    ]
    figure = blank(6.2)
    rows = figure.subplots(3, 1, sharex=True)
    in_view = False
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for action, text, colour, width in given:
            axes.plot(
                table.time_s,
                factor * table[f"{name}_{action}"],
                color=colour,
                linewidth=width,
                label=text,
            )
        dress(axes, "", label)
        in_view |= draw_bounds(axes, table, name, factor)
    legend(rows[0], 6, [BOUNDS] if in_view else [])
    rows[-1].set_xlabel(wrapped(rows[-1], "time [s]"), fontsize=8.5)
    return figure


def draw_bounds(axes: Axes, control: Table, name: str, factor: float) -> bool:
    """Set the limits of axes by the signals in them, draw the bounds; return whether one is seen.

    Bounds outside of these limits would flatten the signals; a note has their values.

    Args:
        axes: with the signals.
        control: rows of the commands of a run.
        name: of the input.
        factor: from the unit of the input's field to that of the axes.
    """
    axes.margins(x=0.0, y=_HEADROOM)
    low, high = axes.get_ylim()
    bounds = {
        "lower": factor * control[f"{name}_min"],
        "upper": factor * control[f"{name}_max"],
    }
    for which, values in bounds.items():
        # The underscore keeps the line out of the legend, and its name in the data of the figure.
        axes.plot(control.time_s, values, **_BOUND_LINE, label=f"_{which} bound")
    outside = []
    near, edge = _NEAR * (high - low), _EDGE * (high - low)
    for which, values in bounds.items():
        seen = values[(values >= low - near) & (values <= high + near)]
        low, high = min([low, *(seen - edge)]), max([high, *(seen + edge)])
        if not len(seen) and np.isfinite(values).any():
            outside.append(f"{which} bound {_range(values)}")
    if outside:
        note(axes, 0.99, 0.97, f"not in view: {', '.join(outside)}", ha="right", va="top")
        high += _NOTE * (high - low)
    axes.set_ylim(low, high)
    return len(outside) < len(bounds)


def _range(values: FloatArray) -> str:
    """Return the finite values as one number, or as their range where they change."""
    ends = f"{np.nanmin(values):.3g}", f"{np.nanmax(values):.3g}"
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)
