"""Style of all figures: page width, colours, axes, legends."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from textwrap import fill
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ....testbed.recording.record import FaultSpan
from ..colours import BLACK as BLACK
from ..colours import BLUE as BLUE
from ..colours import BODY_COLOURS as BODY_COLOURS
from ..colours import GREEN as GREEN
from ..colours import GREY as GREY
from ..colours import ORANGE as ORANGE
from ..colours import PURPLE as PURPLE
from ..colours import RED as RED
from ..colours import SERIES_COLOURS
from ..colours import SKY as SKY

PAGE_WIDTH_IN: Final = 7.2  # two columns of a journal page
DPI: Final = 110

PALE: Final = "#C4C4C4"

_SERIES_MARKERS: Final = "osD^vP"

CURVE_SHADE: Final = "#EDEDE6"
HATCH: Final = "#CFCFCF"
FAULT_SHADE: Final = "#F7D3C4"
GRID: Final = "#DDDDDD"

_FONT_PT: Final = 8.5
_BESIDE_IN: Final = 0.7  # width of an axis's label and numbers
_CHARACTERS_PER_IN: Final = 14.5  # characters of the body font in an inch
_HANDLE: Final = 4  # characters as wide as the line of a legend's entry and the spaces around it
_BOLD_PER_IN: Final = 10.0  # characters of the bold font of titles in an inch
_WIDTH_IN: Final[ContextVar[float | None]] = ContextVar("width of figures [in]", default=None)


@contextmanager
def figure_width(width_in: float | None) -> Iterator[None]:
    """Draw the figures inside the block with a width [in]; None: the page's width."""
    token = _WIDTH_IN.set(width_in)
    try:
        yield
    finally:
        _WIDTH_IN.reset(token)


def has_column_width() -> bool:
    """Return whether figures are drawn for the column of a page, see `figure_width`."""
    return _WIDTH_IN.get() is not None


def blank(height_in: float, share: float = 1.0) -> Figure:
    """Return an empty figure independent of pyplot.

    Args:
        height_in: its height [in].
        share: its width over that of the page; `figure_width` has precedence.
    """
    size = (_WIDTH_IN.get() or share * PAGE_WIDTH_IN, height_in)
    return Figure(figsize=size, dpi=DPI, layout="constrained")


def stacked(
    count: int, height_in: float, share_x: bool = True, share_y: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes below each other, each of this height [in]."""
    figure = blank(height_in * count)
    return figure, [*figure.subplots(count, sharex=share_x, sharey=share_y, squeeze=False).flat]


def wrapped(axes: Axes, text: str, per_in: float = _CHARACTERS_PER_IN) -> str:
    """Return a text with line breaks, so that it is not wider than the axes."""
    return fill(text, _characters(axes, per_in))


def _characters(axes: Axes, per_in: float = _CHARACTERS_PER_IN) -> int:
    """Return the number of characters that fit beside each other on the axes, at least 12."""
    place = axes.get_subplotspec()
    share = 1.0
    if place is not None:
        share = len(place.colspan) / place.get_gridspec().ncols
    width_in = share * axes.figure.bbox.width / axes.figure.dpi - _BESIDE_IN
    return max(12, int(per_in * width_in))


def series(number: int, name: str = "") -> dict[str, Any]:
    """Return label, line and marker of a compared series; of 20, no two lines are equal."""
    return ({"label": name} if name else {}) | {
        "color": SERIES_COLOURS[number % len(SERIES_COLOURS)],
        "linestyle": ("-", "--")[number // len(SERIES_COLOURS) % 2],
        "marker": _SERIES_MARKERS[number % len(_SERIES_MARKERS)],
    }


def dress(axes: Axes, x_label: str, y_label: str, title: str = "") -> None:
    """Set labels and title of axes, draw a light grid and remove the box."""
    axes.set_xlabel(wrapped(axes, x_label), fontsize=_FONT_PT)
    axes.set_ylabel(y_label, fontsize=_FONT_PT)
    if title:
        axes.set_title(
            wrapped(axes, title, _BOLD_PER_IN),
            fontsize=_FONT_PT + 0.5,
            loc="left",
            fontweight="bold",
        )
    axes.tick_params(labelsize=_FONT_PT - 0.5, length=3)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def label_below(axes: Axes, text: str) -> None:
    """Label the horizontal axis of the last of `stacked` axes."""
    axes.set_xlabel(wrapped(axes, text), fontsize=_FONT_PT)


def legend(axes: Axes, columns: int, more: Sequence[Line2D] = ()) -> None:
    """Add a legend above the axes, where it covers no line.

    Args:
        axes: whose lines with labels are listed.
        columns: at most; fewer where the texts would be wider than the axes.
        more: entries after those of the axes.
    """
    handles = [*axes.get_legend_handles_labels()[0], *more]
    fit = _characters(axes)
    labels = [fill(str(handle.get_label()), fit - _HANDLE) for handle in handles]
    widths = [_HANDLE + max(map(len, label.splitlines())) for label in labels]
    while columns > 1:
        parts = np.array_split(np.array(widths, dtype=int), columns)
        if sum(part.max(initial=0) for part in parts) <= fit:
            break
        columns -= 1
    axes.legend(
        handles,
        labels,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        frameon=False,
        fontsize=_FONT_PT - 0.5,
        handlelength=1.6,
        columnspacing=1.2,
        borderaxespad=0.1,
    )


def note(axes: Axes, x: float, y: float, text: str, **style: Any) -> None:  # noqa: ANN401
    """Write a short text at (x, y) in fractions of the axes."""
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
    fitted = "\n".join(wrapped(axes, line) for line in text.splitlines())
    axes.text(x, y, fitted, transform=axes.transAxes, fontsize=_FONT_PT - 0.5, bbox=box, **style)


def shade(
    axes: Axes, time_s: FloatArray, rows: NDArray[np.bool_], hatch: str | None = None
) -> None:
    """Shade or hatch the time spans in which `rows` is True."""
    axes.fill_between(
        time_s,
        0.0,
        1.0,
        where=rows.tolist(),
        transform=axes.get_xaxis_transform(),
        facecolor="none" if hatch else CURVE_SHADE,
        edgecolor=HATCH if hatch else "none",
        hatch=hatch,
        linewidth=0.0,
        zorder=0,
    )


def mark_faults(axes: Axes, spans: Sequence[FaultSpan], end_s: float) -> None:
    """Shade the time in which faults acted, up to the end of the run [s], with their names."""
    for span in spans:
        axes.axvspan(span.start_s, min(span.end_s, end_s), color=FAULT_SHADE, lw=0.0, zorder=0)
        place = {"x": span.start_s, "y": 0.02, "transform": axes.get_xaxis_transform()}
        axes.text(s=span.name, rotation=90, va="bottom", fontsize=_FONT_PT - 2.0, **place)
