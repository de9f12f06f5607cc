"""Panels: charts of half a page's width, and figures as SVG in a page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .style import GRID, blank, series

_HEIGHT_IN: Final = 2.9


@dataclass(frozen=True, slots=True)
class Panel:
    """A chart of half a page's width.

    Attributes:
        title: of the chart.
        draw: draws the chart onto empty axes.
        series: names of the compared series for the legend, in the order of `style.series`.
    """

    title: str
    draw: Callable[[Axes], None]
    series: tuple[str, ...] = ()


def alone(panel: Panel) -> Figure:
    """Return a figure of one panel. Its title is left out, since a page shows it as text."""
    figure = blank(_HEIGHT_IN, 0.5)
    panel.draw(figure.subplots())
    handles = [
        Line2D([], [], linewidth=1.4, markersize=4.5, label=name, **series(number))
        for number, name in enumerate(panel.series)
    ]
    if handles:
        figure.legend(
            handles=handles,
            loc="outside upper left",
            ncols=2,
            frameon=False,
            fontsize=8.0,
            handlelength=1.8,
            columnspacing=1.2,
        )
    return figure


def svg(figure: Figure, name: str) -> str:
    """Return a figure as SVG to be embedded in a page. Equal figures give equal text.

    Black lines and text take the current colour of the page, grid and background its CSS variables
    `--line` and `--paper`, so that the figure fits a dark page.

    Args:
        figure: to convert.
        name: prefix of the ids, unique within the page.
    """
    buffer = io.StringIO()
    no_metadata = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", transparent=True, metadata=no_metadata)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    head, _, rest = text.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    rest = re.sub(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", "", rest, flags=re.DOTALL)
    rest = re.sub(r'(id="|url\(#|href="#)', rf"\g<1>{name}-", rest)
    rest = re.sub(r"(font: [^;\"]*?px) [^;\"]*", r"\1 sans-serif", rest)
    rest = re.sub(r"\s*\n\s*", "\n", rest.replace("#000000", "currentColor"))
    rest = rest.replace(GRID.lower(), "var(--line)").replace("#ffffff", "var(--paper)")
    return f'<svg {box[0]} role="img" aria-labelledby="{name}-title">{rest}'
