"""Figure of the commands and the actions that add up to them, as in the paper."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from proving_ground.testbed.recording.channels import CONTROL
from proving_ground.testbed.recording.record import Record

from .style import BLACK, BLUE, GREY, RED, SKY, blank, dress, legend, wrapped

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
_HEADROOM: Final = 0.06  # of the range between the bounds


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
    for axes, (name, label, factor) in zip(rows, INPUTS, strict=True):
        for action, text, colour, width in given:
            axes.plot(
                table.time_s,
                factor * table[f"{name}_{action}"],
                color=colour,
                linewidth=width,
                label=text,
            )
        for bound in ("min", "max"):
            axes.plot(
                table.time_s,
                factor * table[f"{name}_{bound}"],
                color=BLACK,
                linestyle="--",
                linewidth=0.9,
                label="bounds" if bound == "min" else None,
            )
        dress(axes, "", label)
        axes.margins(x=0.0, y=_HEADROOM)
    legend(rows[0], 6)
    rows[-1].set_xlabel(wrapped(rows[-1], "time [s]"), fontsize=8.5)
    return figure
