"""Chart of envelopes: all tested values and the bracket of each controller."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from ..figures.panel import Panel
from ..figures.style import dress, series
from .envelope_results import EnvelopeResults


def envelope_panel(controllers: Sequence[str], results: EnvelopeResults) -> Panel:
    """Return the chart of one quantity, one line of values per controller.

    Args:
        controllers: of the study; they keep their colours.
        results: envelopes of the quantity.
    """
    names = [envelope.question.controller for envelope in results.envelopes]
    coloured = list(dict.fromkeys([*controllers, *names]))
    classes = list(
        dict.fromkeys(
            probe.value
            for envelope in results.envelopes
            for probe in envelope.probes
            if isinstance(probe.value, str)
        )
    )

    def at(value: float | str) -> float:
        return float(classes.index(value)) if isinstance(value, str) else value

    def draw(axes: Axes) -> None:
        for line, envelope in enumerate(results.envelopes):
            colour = series(coloured.index(names[line]))["color"]
            for probe in envelope.probes:
                marker = "x" if probe.fails else "o"
                axes.plot(at(probe.value), line, marker=marker, color=colour, markersize=5.0)
            holds, fails = envelope.holds_at, envelope.fails_at
            if holds is not None and fails is not None:
                span = [at(holds), at(fails)]
                axes.plot(span, [line, line], color=colour, linewidth=5.0, alpha=0.35)
        dress(axes, f"{results.label}  (dot: holds, cross: fails)", "")
        if results.logarithmic:
            axes.set_xscale("log")
        if classes:
            axes.set_xticks(range(len(classes)), classes)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)

    return Panel(f"Breaking point over {results.label}", draw)
