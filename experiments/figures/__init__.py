"""The figures of a run: each is a function from a record to a matplotlib figure."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from proving_ground.testbed.recording.channels import TUBE
from proving_ground.testbed.recording.record import Record

from .errors import error_figure
from .path import path_figure
from .signals import signals_figure
from .style import DPI
from .timing import timing_figure
from .tube import tube_figure
from .tyres import tyres_figure

FIGURES: Final[dict[str, Callable[[Record], Figure]]] = {
    "path": path_figure,
    "error": error_figure,
    "signals": signals_figure,
    "tyres": tyres_figure,
    "timing": timing_figure,
    "tube": tube_figure,
}

CAPTIONS: Final = {
    "path": "Reference and driven paths; below, the places where the error is largest.",
    "error": "Distance to the time-based reference. Shaded: curves. Means leave out the start-up.",
    "signals": "The three actions, their sum, and what was sent. Dashed: the vehicle's bounds.",
    "tyres": "Slip of the driven wheels, slip angles of the trailer's wheels, loads of all wheels.",
    "tube": "How far left of the nominal vehicle the truth was, in the tube of the controller; of "
    "`ttempc` that is the tube of one step, predicted from the last estimate. Below, how far "
    "inside the estimate was: 1 in the middle, 0 on the boundary.",
    "timing": "Wall-clock cost of the parts of a control period, on the machine that made the run.",
}

_PALETTE: Final = 128  # colours


def draw(record: Record) -> dict[str, bytes]:
    """Return every figure of a run as a PNG file's content, by the figure's name.

    The one of the tube is left out where the controller had none.
    """
    names = [name for name in FIGURES if name != "tube" or len(record[TUBE])]
    return {name: png(FIGURES[name](record)) for name in names}


def png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file, the same for the same figure."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    # A palette is a third of the size, and the eye does not see it in a plot of a few colours.
    picture.quantize(_PALETTE).save(buffer, format="png", optimize=True, dpi=(DPI, DPI))
    return buffer.getvalue()
