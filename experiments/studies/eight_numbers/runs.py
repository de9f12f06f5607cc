"""Errors of runs, each driven once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ttempc.types import FloatArray

from ...sweep.engine import Engine
from ..batch import StudyRun, mean_errors_cm, run_tasks, simulate_run

Errors: TypeAlias = list[float]  # four mean errors [cm]; NaN where there is none

_LOST: Errors = [float("nan")] * 4


class RunStore:
    """Mean errors of runs by scenario, seed and overrides.

    Args:
        engine: drives the runs that are not known yet.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._known: dict[StudyRun, Errors] = {}

    def errors_cm(self, runs: Sequence[StudyRun]) -> FloatArray:
        """Return the mean errors [cm] of runs, (n, 4), in the order of `COLUMNS`.

        NaN in a run that was lost, and where a path has no such part.
        """
        missing = [run for run in dict.fromkeys(runs) if run not in self._known]
        results = run_tasks(_drive, missing, started=self._engine) if missing else ()
        self._known |= zip(missing, results, strict=True)
        return np.array([self._known[run] for run in runs], dtype=float)


def _drive(run: StudyRun) -> Errors:
    summary = simulate_run(run)
    return mean_errors_cm(summary) if summary.status == "completed" else _LOST
