"""Figure of the wall-clock time of the parts of a control period."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from ttempc.types import FloatArray

from ...testbed.recording.channels import SOLVER, TIMING
from ...testbed.recording.record import Record
from .style import BLACK, GREY, RED, SKY, blank, dress, note

_PARTS: Final = (
    ("estimator_us", "estimator"),
    ("control_step_us", "control step"),
    ("qp_solve_us", "QP solve"),
    ("plant_step_us", "plant, one physics step"),
)
_BINS: Final = 40
_WIDE: Final = 50.0  # ratio of largest to smallest time above which decades alone label the axis


def timing_figure(record: Record) -> Figure:
    """Return a histogram of each time with its median and 99th percentile."""
    figure = blank(4.2)
    for axes, (field, title) in zip(figure.subplots(2, 2).flat, _PARTS, strict=True):
        cost_us = record[TIMING][field]
        if field == "qp_solve_us":
            title += _solved_ticks(record)
        dress(axes, "wall-clock time [us]", "control periods", title)
        histogram(axes, cost_us[np.isfinite(cost_us) & (cost_us > 0.0)])
    return figure


def _solved_ticks(record: Record) -> str:
    """Return at how many ticks the solver ran, "" if it was all or the controller has none.

    A QP whose unconstrained minimiser is within all bounds is accepted without an iteration.
    """
    ticks, solved = len(record[TIMING]), int(np.isfinite(record[TIMING]["qp_solve_us"]).sum())
    solver = record[SOLVER]
    inactive = int(((solver["accepted"] == 1.0) & (solver["iterations"] == 0.0)).sum())
    if solved == ticks or not solved + inactive:
        return ""
    reason = " (else no bound active)" if solved + inactive == ticks else ""
    return f", {solved} of {ticks} ticks{reason}"


def histogram(axes: Axes, cost_us: FloatArray) -> None:
    """Draw the distribution of times [us] with median, 99th percentile and maximum."""
    if not len(cost_us):
        note(axes, 0.5, 0.5, "not recorded", ha="center", color=GREY)
        axes.set(xticks=[], yticks=[])
        return
    low, high = 0.9 * cost_us.min(), 1.1 * cost_us.max()
    axes.set_xscale("log")
    axes.hist(cost_us, bins=np.geomspace(low, high, _BINS).tolist(), color=SKY)
    between = (2.0, 5.0) if high < _WIDE * low else ()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, *between)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    median, p99 = np.percentile(cost_us, [50.0, 99.0])
    axes.axvline(median, color=BLACK, linewidth=1.0)
    axes.axvline(p99, color=RED, linewidth=1.0, linestyle="--")
    text = f"median {median:.0f}\n99 % below {p99:.0f}\nmax {cost_us.max():.0f}"
    note(axes, 0.98, 0.95, text, ha="right", va="top")
