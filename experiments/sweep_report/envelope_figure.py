"""The breaking points of controllers: all values that were tried, and between which they fail."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes

from ..figures.panel import Panel
from ..figures.style import dress, series
from .envelope_results import Breaking


def breaking_panel(controllers: Sequence[str], breaking: Breaking) -> Panel:
    """Return a chart of one quantity: a line of values a controller.

    Args:
        controllers: of the study, whose looks are kept.
        breaking: the answers.
    """
    others = [a.question.controller for a in breaking.answers]
    known = list(dict.fromkeys([*controllers, *others]))
    words = list(
        dict.fromkeys(
            probe.value
            for answer in breaking.answers
            for probe in answer.probes
            if isinstance(probe.value, str)
        )
    )

    def at(value: float | str) -> float:
        return float(words.index(value)) if isinstance(value, str) else value

    def draw(axes: Axes) -> None:
        for line, answer in enumerate(breaking.answers):
            colour = series(known.index(answer.question.controller))["color"]
            for probe in answer.probes:
                marker = "x" if probe.fails else "o"
                axes.plot(at(probe.value), line, marker=marker, color=colour, markersize=5.0)
            holds, fails = answer.holds_at, answer.fails_at
            if holds is not None and fails is not None:
                span = [at(holds), at(fails)]
                axes.plot(span, [line, line], color=colour, linewidth=5.0, alpha=0.35)
        dress(axes, f"{breaking.label}  (dot: holds, cross: fails)", "")
        if breaking.logarithmic:
            axes.set_xscale("log")
        if words:
            axes.set_xticks(range(len(words)), words)
        axes.set_yticks(range(len(others)), others)
        axes.set_ylim(len(others) - 0.4, -0.6)

    return Panel(f"Breaking point over {breaking.label}", draw)
