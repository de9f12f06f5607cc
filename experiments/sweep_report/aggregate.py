"""Runs that belong together, and what can be said of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..results.statistics import (
    Estimate,
    Statistic,
    bootstrap,
    cvar95,
    mean,
    paired,
    quantile95,
    share,
)
from ..sweep.envelope import mostly
from .axes import Scale
from .runs import Runs


@dataclass(frozen=True, slots=True)
class Group:
    """What the runs of one controller did; errors are those of the runs that completed [cm]."""

    controller: int
    runs: NDArray[np.intp]  # their numbers
    failed: NDArray[np.intp]  # those of them that failed
    failure_rate: Estimate
    error_cm: Estimate | None  # mean; None where none completed

    @property
    def count(self) -> int:
        """Return the number of runs."""
        return len(self.runs)

    @property
    def fails(self) -> bool:
        """Return whether at least half of the runs fail."""
        return mostly(len(self.failed), self.count)


@dataclass(frozen=True, slots=True)
class Cell:
    """The runs of one controller at one combination of values."""

    places: tuple[int, ...]  # on each scale that the runs are grouped by
    group: Group


@dataclass(frozen=True, slots=True)
class Tail:
    """The worst that is to be expected of a controller [cm]."""

    quantile95_cm: Estimate | None
    cvar95_cm: Estimate | None
    step_us: Estimate | None  # median of a control step, mean over runs


@dataclass(frozen=True, slots=True)
class Difference:
    """A controller against another one under the same points and seeds."""

    controller: int
    error_cm: Estimate | None  # over pairs of which both completed
    pairs: int  # of these
    alone_failed: NDArray[np.intp]  # runs that failed where the other's did not
    other_failed: NDArray[np.intp]  # runs that did not where the other's failed
    runs: NDArray[np.intp]  # all of which there is the other's


def group(runs: Runs, chosen: NDArray[np.intp]) -> Group:
    """Return what can be said of runs, all of one controller, by their places in `runs`."""
    error = runs.error_cm[chosen]
    there = np.isfinite(error)
    failed = runs.run[chosen[runs.failed[chosen]]]
    return Group(
        int(runs.driver[chosen[0]]),
        runs.run[chosen],
        failed,
        share(len(failed), len(chosen)),
        bootstrap(error[there], runs.unit[chosen][there]) if there.any() else None,
    )


def whole(runs: Runs) -> list[Group]:
    """Return a group a controller."""
    return [cell.group for cell in cells(runs, ())]


def cells(runs: Runs, by: Sequence[Scale]) -> list[Cell]:
    """Return the runs of each controller at each combination of values that has any."""
    keys = np.column_stack([*(scale.place for scale in by), runs.driver])
    return [
        Cell(tuple(key[:-1]), group(runs, chosen))
        for key, chosen in _chosen(keys.reshape(len(runs.rows), -1))
    ]


def tail(runs: Runs, controller: int) -> Tail:
    """Return the worst of a controller, and what it costs."""
    mine = runs.driver == controller

    def told(values: FloatArray, statistic: Statistic) -> Estimate | None:
        there = mine & np.isfinite(values)
        return bootstrap(values[there], runs.unit[there], statistic) if there.any() else None

    error = runs.error_cm
    return Tail(told(error, quantile95), told(error, cvar95), told(runs.step_us, mean))


def differences(runs: Runs, against: int) -> list[Difference]:
    """Return how every other controller differs from one, run by run of the same ground."""
    theirs = np.flatnonzero(runs.driver == against)
    found = []
    for controller in range(len(runs.controllers)):
        if controller == against:
            continue
        mine = np.flatnonzero(runs.driver == controller)
        here, there = paired(runs.pair[mine], runs.pair[theirs])
        mine, others = mine[here], theirs[there]
        error = runs.error_cm[mine] - runs.error_cm[others]
        both = np.isfinite(error)
        failed, other = runs.failed[mine], runs.failed[others]
        found.append(
            Difference(
                controller,
                bootstrap(error[both], runs.unit[mine][both]) if both.any() else None,
                int(both.sum()),
                runs.run[mine[failed & ~other]],
                runs.run[mine[~failed & other]],
                runs.run[mine],
            )
        )
    return found


def _chosen(
    keys: NDArray[np.intp],
) -> Iterator[tuple[tuple[int, ...], NDArray[np.intp]]]:
    """Yield each distinct row of keys (n, m), in their order, and where it stands."""
    distinct, number = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(number.ravel(), kind="stable")
    counts = np.bincount(number.ravel())
    for key, chosen in zip(distinct, np.split(order, np.cumsum(counts)[:-1]), strict=True):
        yield tuple(int(part) for part in key), chosen
