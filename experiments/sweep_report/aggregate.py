"""Aggregation of runs: failure rate, error, tail and paired differences of groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..results.statistics import (
    IntervalEstimate,
    Proportion,
    Statistic,
    bootstrap,
    cvar95,
    mean,
    pair,
    proportion,
    quantile95,
)
from ..results.summary import ACTUATOR_USE
from ..sweep.failure import mostly_fails
from .axes import Scale
from .runs import Runs


@dataclass(frozen=True, slots=True)
class Group:
    """Runs of one controller with their failure rate and error.

    Errors are those of completed runs that have an error figure [cm].
    """

    controller: int  # index in `Runs.controllers`
    runs: NDArray[np.intp]  # run numbers
    failed: NDArray[np.intp]  # run numbers of those that failed
    failure_rate: Proportion
    error_cm: IntervalEstimate | None  # mean; None where no run has an error

    @property
    def count(self) -> int:
        """Return the number of runs."""
        return len(self.runs)

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs fail."""
        return mostly_fails(len(self.failed), self.count)


@dataclass(frozen=True, slots=True)
class Cell:
    """The runs of one controller at one combination of values."""

    places: tuple[int, ...]  # index of the value on each scale that the runs are grouped by
    group: Group


@dataclass(frozen=True, slots=True)
class DifferenceCell:
    """Paired difference of two controllers at one combination of values."""

    places: tuple[int, ...]  # as of `Cell`
    error_cm: IntervalEstimate | None  # None where no pair has two errors


@dataclass(frozen=True, slots=True)
class Tail:
    """Worst errors of a controller [cm], cost of its control step, use of the actuators."""

    quantile95_cm: IntervalEstimate | None
    cvar95_cm: IntervalEstimate | None
    step_us: IntervalEstimate | None  # mean over runs of the median step
    use: tuple[IntervalEstimate | None, ...]  # means over completed runs, see `ACTUATOR_USE`


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Difference of a controller to another one at the same points and seeds."""

    controller: int  # index in `Runs.controllers`
    error_cm: IntervalEstimate | None  # mean over pairs in which both runs have an error
    pairs: int  # number of these
    alone_failed: NDArray[np.intp]  # numbers of failed runs whose counterpart did not fail
    other_failed: NDArray[np.intp]  # numbers of runs that did not fail, their counterpart did
    runs: NDArray[np.intp]  # numbers of all runs that have a counterpart


def aggregate(runs: Runs, chosen: NDArray[np.intp]) -> Group:
    """Return the group of runs of one controller.

    Args:
        runs: of the sweep.
        chosen: indices in `runs`, (k,), k at least 1.
    """
    error = runs.error_cm[chosen]
    finite = np.isfinite(error)
    failed = runs.run[chosen[runs.failed[chosen]]]
    return Group(
        int(runs.controller_index[chosen[0]]),
        runs.run[chosen],
        failed,
        proportion(len(failed), len(chosen)),
        mean(error[finite], runs.unit[chosen][finite]) if finite.any() else None,
    )


def controller_groups(runs: Runs) -> list[Group]:
    """Return one group per controller."""
    return [cell.group for cell in cells(runs, ())]


def cells(runs: Runs, by: Sequence[Scale]) -> list[Cell]:
    """Return the runs of each controller at each combination of values that has any."""
    keys = np.column_stack([*(scale.place for scale in by), runs.controller_index])
    return [
        Cell(tuple(key[:-1]), aggregate(runs, chosen))
        for key, chosen in _by_key(keys.reshape(len(runs.rows), -1))
    ]


def controller_tail(runs: Runs, controller: int) -> Tail:
    """Return worst errors and cost of a controller."""
    own = runs.controller_index == controller

    errors = own & np.isfinite(runs.error_cm)

    def tail(statistic: Statistic) -> IntervalEstimate | None:
        values, units = runs.error_cm[errors], runs.unit[errors]
        return bootstrap(values, units, statistic) if errors.any() else None

    def average(values: FloatArray) -> IntervalEstimate | None:
        known = own & np.isfinite(values)
        return mean(values[known], runs.unit[known]) if known.any() else None

    completed = np.where(runs.completed, 1.0, np.nan)
    return Tail(
        tail(quantile95),
        tail(cvar95),
        average(runs.step_us),
        tuple(average(factor * completed * runs.numbers(name)) for _, name, factor in ACTUATOR_USE),
    )


def ranking(runs: Runs) -> list[int]:
    """Return the controllers (indices in `Runs.controllers`), that with the least error first.

    They are compared by the median error of their runs. A run that did not complete counts as
    worse than any other, so that no controller gains by the runs that it does not complete.
    """

    def key(controller: int) -> tuple[float, float, int]:
        own = runs.controller_index == controller
        error = np.where(runs.completed, runs.error_cm, np.inf)[own]
        measured = error[~np.isnan(error)]  # without runs that are too short for an error
        median = np.percentile(measured, 50.0, method="higher") if len(measured) else np.inf
        return float(median), float(runs.failed[own].mean()), controller

    return sorted(range(len(runs.controllers)), key=key)


def paired_differences(runs: Runs, against: int) -> list[PairedDifference]:
    """Return the differences of every other controller to one, paired by point and seed."""
    result = []
    for controller in range(len(runs.controllers)):
        if controller == against:
            continue
        own, other = _pairs(runs, controller, against)
        error = runs.error_cm[own] - runs.error_cm[other]
        both = np.isfinite(error)
        failed, other_failed = runs.failed[own], runs.failed[other]
        result.append(
            PairedDifference(
                controller,
                mean(error[both], runs.unit[own][both]) if both.any() else None,
                int(both.sum()),
                runs.run[own[failed & ~other_failed]],
                runs.run[own[~failed & other_failed]],
                runs.run[own],
            )
        )
    return result


def difference_cells(
    runs: Runs, by: Sequence[Scale], controller: int, against: int
) -> list[DifferenceCell]:
    """Return the difference of a controller to another one at each combination of values."""
    own, other = _pairs(runs, controller, against)
    error = runs.error_cm[own] - runs.error_cm[other]
    unit, both = runs.unit[own], np.isfinite(error)
    result = []
    for places, chosen in _by_key(np.column_stack([scale.place[own] for scale in by])):
        known = chosen[both[chosen]]
        estimate = mean(error[known], unit[known]) if len(known) else None
        result.append(DifferenceCell(places, estimate))
    return result


def _pairs(runs: Runs, controller: int, against: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of runs of two controllers at the same points and seeds."""
    own, other = (np.flatnonzero(runs.controller_index == each) for each in (controller, against))
    own_places, other_places = pair(runs.pair[own], runs.pair[other])
    return own[own_places], other[other_places]


def _by_key(
    keys: NDArray[np.intp],
) -> Iterator[tuple[tuple[int, ...], NDArray[np.intp]]]:
    """Yield each distinct row of keys (n, m), sorted, with the indices of its rows."""
    distinct, number = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(number.ravel(), kind="stable")
    counts = np.bincount(number.ravel())
    for key, chosen in zip(distinct, np.split(order, np.cumsum(counts)[:-1]), strict=True):
        yield tuple(int(part) for part in key), chosen
