"""Figure of the offsets from the path and the corridor."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...testbed.recording.channels import CORRIDOR
from ...testbed.recording.record import Record
from ..results.tracking_errors import START_UP_S
from .style import BODY_COLOURS, PALE, blank, dress, legend, shade


def corridor_figure(record: Record) -> Figure:
    """Return the offsets of all true points to the left of their paths, with the corridor."""
    table = record[CORRIDOR]
    points = [name for name in BODY_COLOURS if np.isfinite(table[f"{name}_m"]).any()]
    figure = blank(1.8 * len(points))
    rows = figure.subplots(len(points), 1, sharex=True, sharey=True, squeeze=False).ravel()
    half_width_cm = 100 * table["half_width_m"]
    for axes, name in zip(rows, points, strict=True):
        shade(axes, table.time_s, table.time_s < START_UP_S, hatch="////")
        axes.fill_between(
            table.time_s, -half_width_cm, half_width_cm, color=PALE, alpha=0.6, label="corridor"
        )
        offset_cm = 100 * table[f"{name}_m"]
        axes.plot(table.time_s, offset_cm, color=BODY_COLOURS[name], linewidth=0.8, label=name)
        dress(axes, "", "offset from path,\nleft positive [cm]")
        axes.margins(x=0.0)
        legend(axes, 2)
    rows[-1].set_xlabel("time [s] (hatched: start-up, not counted)", fontsize=8.5)
    return figure
