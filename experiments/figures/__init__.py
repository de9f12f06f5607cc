"""Figures of a run. Each is a function from a record to a matplotlib figure."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ...testbed.recording.channels import CORRIDOR, TUBE
from ...testbed.recording.record import Record
from .corridor import corridor_figure
from .cross_track import cross_track_figure
from .path import path_figure
from .signals import signals_figure
from .style import DPI
from .timing import timing_figure
from .tracking_error import error_figure
from .tube import tube_figure
from .tyres import tyres_figure

FIGURES: Final[dict[str, Callable[[Record], Figure]]] = {
    "path": path_figure,
    "error": error_figure,
    "cross-track": cross_track_figure,
    "signals": signals_figure,
    "tyres": tyres_figure,
    "timing": timing_figure,
    "tube": tube_figure,
    "corridor": corridor_figure,
}

CAPTIONS: Final = {
    "path": "Reference and driven paths; below, where the error of an axle point is largest, the "
    "first 16 s left out.",
    "error": "Distance to the time-based reference. Shaded: curves; red, with names: faults. "
    "Means leave out the start-up.",
    "cross-track": "Error to the left of the reference over the length of the path.",
    "signals": "The three actions, their sum, and the command sent. Dashed: the vehicle's bounds, "
    "where they are near.",
    "tyres": "Slip of the driven wheels, slip angles of front and trailer wheels, loads of all.",
    "tube": "Offset of the true vehicle to the left of the nominal one, and the tube of the "
    "controller. The tube of ttempc is that of one step, predicted from the last estimate. "
    "Below: margin of both true axle points, 1 at the centre of the tube, 0 on its boundary.",
    "corridor": "Offset of the true points to the left of their paths, and the corridor.",
    "timing": "Wall-clock time of the parts of a control period, on the machine of the run.",
}

_PALETTE: Final = 256  # colours


def draw(record: Record) -> dict[str, bytes]:
    """Return all figures of a run as contents of PNG files, by the figure's name."""
    return {name: png(FIGURES[name](record)) for name in shown_figures(record)}


def shown_figures(record: Record) -> list[str]:
    """Return the names of the figures of a run; without tube or corridor it has none of them."""
    channels = {"tube": TUBE, "corridor": CORRIDOR}
    return [name for name in FIGURES if name not in channels or len(record[channels[name]])]


def png(figure: Figure, dpi: float = DPI) -> bytes:
    """Return the content of a PNG file of a figure. Equal figures give equal bytes."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    # A palette makes the file three times smaller, invisibly in a plot of a few colours.
    picture.quantize(_PALETTE, Image.Quantize.MAXCOVERAGE).save(
        buffer, format="png", optimize=True, dpi=(dpi, dpi)
    )
    return buffer.getvalue()
