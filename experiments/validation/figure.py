"""One experiment of the inspection: what the plant did beside what the law says."""

from __future__ import annotations

from typing import Final

from matplotlib.figure import Figure

from proving_ground.testbed.inspection.check import Chart

from ..figures.style import BLACK, BLUE, DPI, GREEN, PAGE_WIDTH_IN, RED, dress, legend

_COLOURS: Final = (BLUE, RED, GREEN)
_FEW: Final = 25  # points that are worth a marker each


def chart_figure(chart: Chart) -> Figure:
    """Return the chart at half a page's width; measured lines in colour, laws black and dashed."""
    figure = Figure(figsize=(0.5 * PAGE_WIDTH_IN, 2.5), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    colours = iter(_COLOURS)
    for line in chart.lines:
        if line.measured:
            marker = "o" if len(line.x) < _FEW else ""
            looks = {"color": next(colours), "marker": marker, "markersize": 4.0}
        else:
            looks = {"color": BLACK, "linestyle": (0, (4, 2))}
        axes.plot(line.x, line.y, linewidth=1.2, label=line.label, **looks)
    dress(axes, chart.x_label, chart.y_label)
    axes.margins(x=0.03)
    legend(axes, len(chart.lines))
    return figure
