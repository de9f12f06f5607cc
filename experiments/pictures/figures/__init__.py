"""Figures of runs, and how figures become files."""

from ....testbed.recording.record import Record
from .export import png
from .run_figures import CAPTIONS, FIGURES, shown_figures

__all__ = ["CAPTIONS", "FIGURES", "draw", "png", "shown_figures"]


def draw(record: Record) -> dict[str, bytes]:
    """Return all figures of a run as contents of PNG files, by the figure's name."""
    return {name: png(FIGURES[name](record)) for name in shown_figures(record)}
