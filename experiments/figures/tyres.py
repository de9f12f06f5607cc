"""Figure of the wheels' slip, slip angles and loads."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from ttempc.types import FloatArray

from ...testbed.recording.channels import TYRES
from ...testbed.recording.record import Record
from ..results.tracking_errors import tracking_errors
from .style import BLUE, GREEN, RED, blank, dress, legend, shade, wrapped

_AXLES: Final = {"front": GREEN, "rear": BLUE, "trailer": RED}
_SIDES: Final = {"left": "-", "right": (0, (2, 1))}
_ROWS: Final = (  # field, label, factor from the field's unit to the label's, axles
    ("slip", "slip, driven [%]", 100.0, ("rear",)),
    ("slip_angle_rad", "slip angle [deg]", np.degrees(1.0), ("front", "trailer")),
    ("load_n", "wheel load [kN]", 1e-3, ("front", "rear", "trailer")),
)
_WINDOW_S: Final = 1.0  # bumps vary the load faster than a page can show


def tyres_figure(record: Record) -> Figure:
    """Return slip, slip angle and load of the wheels over time, curves shaded.

    Lines are means over a second. Bands extend from its smallest to its largest sample.
    """
    table, errors = record[TYRES], tracking_errors(record)
    figure = blank(6.2)
    rows = figure.subplots(3, 1, sharex=True)
    for axes, (field, label, factor, axles) in zip(rows, _ROWS, strict=True):
        shade(axes, errors.time_s, errors.curved)
        for axle in axles:
            for side, line in _SIDES.items():
                wheel = f"{axle}_{side}"
                time_s, mean, low, high = _windows(table.time_s, factor * table[f"{wheel}_{field}"])
                axes.fill_between(time_s, low, high, color=_AXLES[axle], alpha=0.15, linewidth=0)
                axes.plot(
                    time_s,
                    mean,
                    color=_AXLES[axle],
                    linestyle=line,
                    linewidth=1.1,
                    label=wheel.replace("_", " "),
                )
        dress(axes, "", label)
        axes.margins(x=0.0)
        legend(axes, 6)
    rows[-1].set_xlabel(
        wrapped(rows[-1], "time [s] (shaded: curves; bands: minimum to maximum in 1 s)"),
        fontsize=8.5,
    )
    return figure


def _windows(
    time_s: FloatArray, samples: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return mean time, mean, minimum and maximum of each window, each (windows,)."""
    starts = np.flatnonzero(np.diff(np.floor(time_s / _WINDOW_S), prepend=-1.0))
    counts = np.diff(np.append(starts, len(samples)))
    return (
        np.add.reduceat(time_s, starts) / counts,
        np.add.reduceat(samples, starts) / counts,
        np.minimum.reduceat(samples, starts),
        np.maximum.reduceat(samples, starts),
    )
