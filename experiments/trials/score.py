"""Scores of the field trials: cost of a run, of a trial, of an entry.

The cost of a run is a length: the 95 % cross-track error of the working point, which is the tool
where there is one and else the trailer. A run that does not complete costs `LOSS_M`, and so does
the share of the time outside the corridor. Over seeds the mean counts, as the expected cost: a
loss counts with its frequency. Over trials the geometric mean counts: the order of two entries
does not depend on the scale of a trial (Fleming and Wallace 1986, "How not to lie with statistics:
the correct way to summarize benchmark results", CACM 29(3)), and no hard trial outweighs the
others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ...testbed.configuration.config_io import STRICT
from ..results.statistics import IntervalEstimate, bootstrap_means, cvar95
from ..sweep.row import RowStatus

LOSS_M: Final = 1.0
"""Cost of a run that does not complete, and the largest cost of any run [m]; assumed."""

_LEAST_M: Final = 1e-3  # smallest cost of a trial: below, no receiver of a field could tell

Number = Annotated[float, Field(ge=0)] | None
Status = RowStatus | Literal["refused"]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialRun:
    """What counts of a run; a number that does not exist is None."""

    status: Status
    failure: str = ""
    trailer_p95_m: Number = None
    """95th percentile of the absolute cross-track error."""
    tool_p95_m: Number = None
    trailer_max_m: Number = None
    """Largest Euclidean error."""
    outside: Annotated[float, Field(ge=0, le=1)] | None = None
    """Share of the time outside the corridor, of the point that is outside longest."""
    front_rad_per_m: Number = None
    """Travel of the front steering's command over the distance driven."""
    trailer_rad_per_m: Number = None
    hydrostat_per_m: Number = None
    step_p99_us: Number = None
    """99th percentile of the time of the controller's step."""

    @property
    def completed(self) -> bool:
        """Return whether the run ended at the end of its path."""
        return self.status == "completed"

    @property
    def cost_m(self) -> float:
        """Return the cost of the run [m]."""
        error = self.trailer_p95_m if self.tool_p95_m is None else self.tool_p95_m
        if not self.completed or error is None:
            return LOSS_M
        outside = self.outside or 0.0
        return (1.0 - outside) * min(error, LOSS_M) + outside * LOSS_M


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Interval:
    """An estimate with its 95 % confidence interval; without ends where there is one seed."""

    value: float
    low: float | None
    high: float | None

    @classmethod
    def of(cls, estimate: IntervalEstimate, factor: float = 1.0) -> Interval:
        """Return an estimate times a factor, rounded to 6 decimals."""
        ends = (estimate.value, estimate.low, estimate.high)
        value, low, high = (None if x is None else round(factor * x, 6) for x in ends)
        assert value is not None
        return cls(value=value, low=low, high=high)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class TrialScore:
    """Figures of a trial over its runs; means of errors and travel are those of completed runs."""

    cost_m: Interval
    tail_m: float
    """Mean cost of the worst 5 % of the runs."""
    not_completed: int
    trailer_p95_m: float | None
    tool_p95_m: float | None
    trailer_max_m: float | None
    """The largest of all runs."""
    outside: float | None
    front_rad_per_m: float | None
    trailer_rad_per_m: float | None
    hydrostat_per_m: float | None
    step_p99_us: float | None
    """Median over runs."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Score:
    """Figures of an entry."""

    cost_m: Interval
    """Geometric mean over trials of the mean costs: the overall figure, less is better."""
    runs: int
    not_completed: int
    step_p99_us: float | None
    """The largest of the trials."""
    trials: dict[str, TrialScore]


Runs = Mapping[str, tuple[TrialRun, ...]]
"""Runs of each trial, in the order of the seeds."""


def score(runs: Runs) -> Score:
    """Return the score of an entry."""
    trials = {name: _trial_score(own) for name, own in runs.items()}
    steps = [item.step_p99_us for item in trials.values() if item.step_p99_us is not None]
    return Score(
        cost_m=Interval.of(bootstrap_means(costs(runs), overall)),
        runs=sum(len(own) for own in runs.values()),
        not_completed=sum(item.not_completed for item in trials.values()),
        step_p99_us=max(steps, default=None),
        trials=trials,
    )


def costs(runs: Runs) -> FloatArray:
    """Return the costs of all runs [m], (seeds, trials)."""
    return np.array([[run.cost_m for run in own] for own in runs.values()]).T


def overall(means: FloatArray) -> FloatArray:
    """Return the geometric mean of mean costs over trials: (n, trials) -> (n,)."""
    return np.exp(np.log(np.maximum(means, _LEAST_M)).mean(axis=1))


def _trial_score(runs: tuple[TrialRun, ...]) -> TrialScore:
    cost = costs({"": runs})
    completed = [run for run in runs if run.completed]

    def numbers(name: str) -> list[float]:
        values = (getattr(run, name) for run in completed)
        return [value for value in values if value is not None]

    def mean(name: str) -> float | None:
        values = numbers(name)
        return round(math.fsum(values) / len(values), 6) if values else None

    steps = numbers("step_p99_us")
    return TrialScore(
        cost_m=Interval.of(bootstrap_means(cost, lambda means: means[:, 0])),
        tail_m=round(float(cvar95(cost[:, 0], np.ones((1, len(cost))))[0]), 6),
        not_completed=len(runs) - len(completed),
        trailer_p95_m=mean("trailer_p95_m"),
        tool_p95_m=mean("tool_p95_m"),
        trailer_max_m=max(numbers("trailer_max_m"), default=None),
        outside=mean("outside"),
        front_rad_per_m=mean("front_rad_per_m"),
        trailer_rad_per_m=mean("trailer_rad_per_m"),
        hydrostat_per_m=mean("hydrostat_per_m"),
        step_p99_us=round(float(np.median(steps)), 1) if steps else None,
    )
