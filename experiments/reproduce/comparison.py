"""Rows of the study `compare` as arrays over fields, controllers and seeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..results.leads import RunError
from ..results.statistics import IntervalEstimate, holm, mean, paired_p
from ..sweep.results import rows
from ..sweep.row import Row

DEFAULT: Final = "ttempc"
"""The controller that the others are compared with."""

FAMILY: Final = ("ttempc", "ttempc-nominal", "ttempc-tube")
"""Variants of one controller; the others are its rivals."""

LEVEL: Final = 0.05  # of the tests, after Holm's correction
_ENDED_EARLY: Final = {"stopped", "lost", "invalid", "failed", "crashed"}  # `RowStatus`
_POINTS: Final = tuple(f"tracking.all.{body}.mean_euclidean_m" for body in ("tractor", "trailer"))


@dataclass(frozen=True, slots=True)
class Ratio:
    """Error of a controller over that of the default one on a field, paired by seed."""

    estimate: IntervalEstimate  # geometric mean over seeds
    p: float  # of no difference, adjusted after Holm; NaN for a single seed

    @property
    def verdict(self) -> str:
        """Return "better", "worse", or "" where the difference is not significant."""
        if not self.p < LEVEL:
            return ""
        return "better" if self.estimate.value < 1.0 else "worse"


@dataclass(frozen=True)
class Comparison:
    """Runs of several controllers on several fields under the same seeds."""

    by_key: Mapping[tuple[str, str, int], Row]  # field, controller, seed

    @cached_property
    def fields(self) -> tuple[str, ...]:
        """Return the names of the scenarios."""
        return tuple(sorted({field for field, _, _ in self.by_key}))

    @cached_property
    def controllers(self) -> tuple[str, ...]:
        """Return the names of the controllers in the order of the study."""
        order = sorted(self.by_key.values(), key=lambda row: int(str(row["run"])))
        return tuple(dict.fromkeys(str(row["controller"]) for row in order))

    @cached_property
    def seeds(self) -> tuple[int, ...]:
        """Return the seeds."""
        return tuple(sorted({seed for _, _, seed in self.by_key}))

    @property
    def rivals(self) -> tuple[str, ...]:
        """Return the controllers that are no variant of the default one."""
        return tuple(name for name in self.controllers if name not in FAMILY)

    def column(self, name: str) -> FloatArray:
        """Return a column of the rows, (fields, controllers, seeds).

        NaN where a run did not complete, was refused, or has no such figure.
        """
        shape = (len(self.fields), len(self.controllers), len(self.seeds))
        values = np.full(shape, np.nan)
        for place in np.ndindex(shape):
            row = self.row(place)
            if row is not None and row["status"] == "completed":
                values[place] = row[name]  # None becomes NaN
        return values

    def row(self, place: tuple[int, ...]) -> Row | None:
        """Return a row by indices of field, controller and seed; None if the run was refused."""
        field, controller, seed = place
        key = (self.fields[field], self.controllers[controller], self.seeds[seed])
        return self.by_key.get(key)

    @cached_property
    def error_cm(self) -> FloatArray:
        """Return the mean Euclidean errors, mean of both axle points; shape as `column`."""
        return 100.0 * np.mean([self.column(name) for name in _POINTS], axis=0)

    @cached_property
    def driven(self) -> NDArray[np.intp]:
        """Return the number of runs, (fields, controllers)."""
        return self._count({"completed", *_ENDED_EARLY})

    @cached_property
    def lost(self) -> NDArray[np.intp]:
        """Return the number of runs that did not complete, (fields, controllers)."""
        return self._count(_ENDED_EARLY)

    def _count(self, statuses: set[str]) -> NDArray[np.intp]:
        numbers = np.zeros((len(self.fields), len(self.controllers)), dtype=np.intp)
        for (field, controller, _), row in self.by_key.items():
            place = self.fields.index(field), self.controllers.index(controller)
            numbers[place] += row["status"] in statuses
        return numbers

    @cached_property
    def log_ratio(self) -> FloatArray:
        """Return the logarithm of each error over that of the default controller.

        Whole fields of a controller are NaN where one of the two lost a run: a mean over the seeds
        that were easy enough would favour the weaker controller.
        """
        place = self.controllers.index(DEFAULT)
        ratio = np.log(self.error_cm) - np.log(self.error_cm[:, place : place + 1])
        return np.where(np.isfinite(ratio).all(axis=2, keepdims=True), ratio, np.nan)

    @cached_property
    def ratios(self) -> dict[tuple[str, str], Ratio]:
        """Return the ratios by field and controller, those of all rivals as one family of tests."""
        compared = [
            (field, controller)
            for field in range(len(self.fields))
            for controller in range(len(self.controllers))
            if self.controllers[controller] != DEFAULT
            and np.isfinite(self.log_ratio[field, controller]).all()
        ]
        adjusted = holm([paired_p(self.log_ratio[place]) for place in compared])
        return {
            (self.fields[place[0]], self.controllers[place[1]]): Ratio(
                _exp(mean(self.log_ratio[place])), float(p)
            )
            for place, p in zip(compared, adjusted, strict=True)
        }

    def over_fields(self, controller: str) -> tuple[IntervalEstimate | None, int]:
        """Return the geometric mean of a controller's ratios over fields, and their number.

        Each field counts the same, so that none dominates by its size; seeds are the units.
        """
        logs = self.log_ratio[:, self.controllers.index(controller)]
        logs = logs[np.isfinite(logs).all(axis=1)]
        return (_exp(mean(logs.mean(axis=0))), len(logs)) if len(logs) else (None, 0)


def run_errors(table: Iterable[Row], place: str = "") -> list[RunError]:
    """Return the errors of the rows of a sweep that were driven.

    Args:
        table: the rows.
        place: name of all of them; default: the scenario of each.
    """
    return [
        RunError(
            place or str(row["scenario"]),
            (row["point"], row["seed"]),
            str(row["controller"]),
            _mean_cm(row) if row["status"] == "completed" else math.nan,
        )
        for row in table
        if row["status"] in {"completed", *_ENDED_EARLY}
    ]


def _mean_cm(row: Row) -> float:
    """Return the mean of both points of the mean Euclidean errors [cm], NaN where there is none."""
    return 100.0 * float(np.array([row[name] for name in _POINTS], dtype=float).mean())


def _exp(estimate: IntervalEstimate) -> IntervalEstimate:
    """Return an estimate of a logarithm as one of the number."""
    ends = (None if end is None else float(np.exp(end)) for end in (estimate.low, estimate.high))
    return IntervalEstimate(float(np.exp(estimate.value)), *ends)


def read_comparison(folder: Path) -> Comparison:
    """Return the rows of a finished sweep of fields and controllers."""
    return Comparison(
        {
            (str(row["scenario"]), str(row["controller"]), int(str(row["seed"]))): row
            for row in rows(folder / "results.jsonl")
        }
    )
