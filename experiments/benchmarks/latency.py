"""Latency of a control step as a loop in real time sees it: after 20 ms of idle.

The process sleeps before every step, so that caches and branch predictors hold the work of others.
With preparation, `prepare` runs between sleep and step, as while a loop waits for the samples. Wall
time counts, once per step: the tail has the interruptions by other processes.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.guidance.controllers import make_controller
from ttempc.types import FloatArray

from .control_step import PERIOD_S, default_reference, estimates_along, timed
from .figure import BenchmarkFigure, Limit

REPEATS = 4  # of half a lap
PAUSE_S = 0.02

LARGEST_P99_WITHOUT_SOLVER_US: Final = 100.0

KINDS: Final = ("without preparation", "with preparation")
_QUANTILES: Final = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}


def latencies() -> dict[str, tuple[FloatArray, NDArray[np.bool_]]]:
    """Return the time of every step [us] and whether its QP needed the solver, by kind."""
    vehicle, reference = default_reference()
    estimates = estimates_along("ttempc", vehicle, reference)
    result = {}
    for kind in KINDS:
        times, solved = [], []
        for _ in range(REPEATS):
            controller = make_controller("ttempc", vehicle, reference, PERIOD_S)
            steps, iterations = timed(controller, estimates, PAUSE_S, kind == KINDS[1])
            times.append(1e6 * steps[1:])
            solved.append(iterations[1:] > 0)
        result[kind] = np.concatenate(times), np.concatenate(solved)
    return result


def figures(
    measured: dict[str, tuple[FloatArray, NDArray[np.bool_]]] | None = None,
) -> list[BenchmarkFigure]:
    """Return quantiles of the latency by kind, and its tail where the QP needs no solver."""
    result = []
    for kind, (times, solved) in (measured or latencies()).items():
        result += [
            BenchmarkFigure(f"{kind}, {name}", float(np.quantile(times, share)), "us")
            for name, share in _QUANTILES.items()
        ]
        tail = float(np.quantile(times[~solved], 0.99))
        limit = Limit(LARGEST_P99_WITHOUT_SOLVER_US)
        result.append(BenchmarkFigure(f"{kind}, p99 without active bounds", tail, "us", limit))
    return result


def histograms(measured: dict[str, tuple[FloatArray, NDArray[np.bool_]]]) -> bytes:
    """Return a picture of the latencies of every kind (PNG)."""
    from ..figures import png
    from ..figures.run_figures import histogram
    from ..figures.style import blank, dress

    figure = blank(2.6)
    places = figure.subplots(1, len(measured), sharex=True, squeeze=False).flat
    for axes, (kind, (times, _)) in zip(places, measured.items(), strict=True):
        dress(axes, "wall-clock time of a step [us]", "steps", kind)
        histogram(axes, times)
    return png(figure)
