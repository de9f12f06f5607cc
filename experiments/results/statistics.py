"""What may be said of many runs, and how sure: estimates with 95 % confidence intervals.

Runs under one seed share their ground and their noise, whatever the point and the controller. They
are no independent samples: what is drawn anew is always the whole unit, a seed or a drawn point.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, norm, t

from proving_ground.testbed.randomness import generator
from ttempc.types import FloatArray

CONFIDENCE: Final = 0.95
TAIL: Final = 0.05  # the share of runs that CVaR looks at

_RESAMPLED: Final = 10_000
_RESAMPLED_OF_MANY: Final = 2_000  # units, whose interval need not be expanded
_FEW: Final = 100
_AT_ONCE: Final = 1_000_000  # weights that are held in memory

Statistic = Callable[[FloatArray, FloatArray], FloatArray]
"""Values (n,) and their weights (resamples, n) -> the statistic of every resample (resamples,)."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure with its 95 % confidence interval."""

    value: float
    low: float | None  # None where one unit says nothing of the spread
    high: float | None

    @property
    def ends(self) -> tuple[float, float]:
        """Return the interval as it is drawn: none is the value alone."""
        value = self.value
        return value if self.low is None else self.low, value if self.high is None else self.high


def mean(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted mean."""
    return weights @ values / weights.sum(axis=1)


def quantile95(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the least value that at least 95 % of the weight does not exceed."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[:, order], axis=1)
    # Sums of whole numbers are exact, 0.95 is not: a hair below it counts as reached.
    needed = (1.0 - TAIL) * reached[:, -1:] * (1.0 - 1e-12)
    return values[order][np.argmax(reached >= needed, axis=1)]


def cvar95(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the mean of the worst, the largest, 5 %: the conditional value at risk.

    Rockafellar and Uryasev (2002), "Conditional value-at-risk for general loss distributions",
    proposition 8: of the value at the edge of the 5 % only the part inside counts.
    """
    order = np.argsort(-values, kind="stable")
    weights = weights[:, order]
    reached = np.cumsum(weights, axis=1)
    size = TAIL * reached[:, -1:]
    inside = np.clip(size - (reached - weights), 0.0, weights)
    return inside @ values[order] / size[:, 0]


def bootstrap(
    values: FloatArray, units: NDArray[Any] | None = None, statistic: Statistic = mean
) -> Estimate:
    """Return a statistic with its bootstrap interval; the same values give the same interval.

    The percentile interval of a cluster bootstrap, expanded for small numbers of units: Hesterberg
    (2015), "What teachers should know about the bootstrap", The American Statistician 69(4).
    Without that the interval of a mean of 5 seeds is a third too narrow.

    Args:
        values: samples, (n,), n at least 1, finite.
        units: what is drawn anew as a whole, such as the seed of each sample, (n,); each sample by
            itself if not given.
        statistic: of the samples.
    """
    units = np.arange(len(values)) if units is None else units
    # Sorted, so that the interval does not depend on the order in which runs ended.
    order = np.lexsort((values, units))
    values, units = values[order], units[order]
    value = float(statistic(values, np.ones((1, len(values))))[0])
    _, unit = np.unique(units, return_inverse=True)
    count = int(unit[-1]) + 1
    if count < 2:
        return Estimate(value, None, None)
    drawn = _drawn_few(count) if count <= _FEW else _drawn(count, _RESAMPLED_OF_MANY)
    step = max(1, _AT_ONCE // len(values))
    found = np.concatenate(
        [
            statistic(values, drawn[begin : begin + step, unit].astype(float))
            for begin in range(0, len(drawn), step)
        ]
    )
    tail = norm.cdf(np.sqrt(count / (count - 1)) * t.ppf(0.5 - 0.5 * CONFIDENCE, count - 1))
    low, high = np.quantile(found, (tail, 1.0 - tail))
    # Rounding of resampled means: an interval never leaves out its own estimate.
    return Estimate(value, min(float(low), value), max(float(high), value))


def _drawn(count: int, resamples: int) -> NDArray[np.int16]:
    """Return how often each unit is in each resample, (resamples, count)."""
    equal = np.full(count, 1.0 / count)
    return generator(count, "bootstrap").multinomial(count, equal, size=resamples).astype(np.int16)


@functools.lru_cache(maxsize=8)
def _drawn_few(count: int) -> NDArray[np.int16]:
    return _drawn(count, _RESAMPLED)


def share(hits: int, trials: int, confidence: float = CONFIDENCE) -> Estimate:
    """Return a share, such as that of failed runs, with its Clopper-Pearson interval."""
    interval = binomtest(hits, trials).proportion_ci(confidence, method="exact")
    return Estimate(hits / trials, float(interval.low), float(interval.high))


def paired(
    keys: NDArray[np.intp], other_keys: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where the keys that both have stand in the one and in the other.

    Args:
        keys: of samples, (n,), each once.
        other_keys: of the samples to pair them with, (m,), each once.
    """
    _, here, there = np.intersect1d(keys, other_keys, assume_unique=True, return_indices=True)
    return here, there


def survival(values: FloatArray, worse: int = 0) -> tuple[FloatArray, FloatArray]:
    """Return the empirical survival function as steps: the share of samples above each value.

    Args:
        values: samples, (n,).
        worse: samples without a value that count as worse than any: failed runs.

    Returns:
        The values sorted, (n,), and the share that lies above each, (n,).
    """
    above = np.arange(len(values) - 1, -1, -1) + worse
    return np.sort(values), above / (len(values) + worse)
