"""Estimates over many runs with their 95 % confidence intervals.

Runs with the same seed share ground and noise, whatever the point and the controller. They are not
independent samples: intervals are those over whole units, seeds or drawn points. Means have the
interval of Student's t.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, chi2, norm, t

from ttempc.types import FloatArray

from ...testbed.randomness import generator

CONFIDENCE: Final = 0.95
TAIL: Final = 0.05  # share of the runs over which CVaR averages
_ENOUGH_FOR_MEANS: Final = 5

_RESAMPLES: Final = 10_000
_RESAMPLES_OF_MANY: Final = 2_000  # of more than `_FEW` units
_FEW: Final = 100


@dataclass(frozen=True, slots=True)
class IntervalEstimate:
    """An estimate with its 95 % confidence interval."""

    value: float
    low: float | None  # None: one unit does not show the spread
    high: float | None

    @property
    def ends(self) -> tuple[float, float]:
        """Return the ends of the interval; without one, the value twice."""
        value = self.value
        return value if self.low is None else self.low, value if self.high is None else self.high


@dataclass(frozen=True, slots=True)
class Proportion:
    """A count out of a total, with the interval of its probability."""

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Return the proportion; NaN where the total is 0."""
        return self.count / self.total if self.total else math.nan

    @property
    def ends(self) -> tuple[float, float]:
        """Return the ends of the interval."""
        return self.low, self.high

    def __str__(self) -> str:
        return f"{self.value:.4f} ({self.low:.4f} to {self.high:.4f})"


def mean(values: FloatArray, units: NDArray[Any] | None = None) -> IntervalEstimate:
    """Return a mean with the interval of Student's t over whole units.

    The mean is that over samples, a ratio of sums over units; its variance is linearised (Cochran
    1977, "Sampling techniques", 3rd ed., section 6.4). For units of equal size this is the interval
    of the mean over units, exact for normal ones, however few. BCa intervals need tens of units.

    Args:
        values: samples, (n,), n at least 1, finite.
        units: the unit of each sample, such as its seed, (n,); default: each sample is a unit.
    """
    units = np.arange(len(values)) if units is None else units
    # Sorted, so that no rounding depends on the order in which the runs ended.
    order = np.lexsort((values, units))
    values = values[order]
    _, unit = np.unique(units[order], return_inverse=True)
    sizes = np.bincount(unit)
    value = float(values.mean())
    count = len(sizes)
    if count < 2:
        return IntervalEstimate(value, None, None)
    residual = np.bincount(unit, values - value) / sizes.mean()
    half = t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * residual.std(ddof=1) / math.sqrt(count)
    return IntervalEstimate(value, value - float(half), value + float(half))


def paired_p(differences: FloatArray) -> float:
    """Return the two-sided p-value of Student's paired t-test of differences (n,).

    NaN for a single one; of equal ones 0, or 1 if they are 0.
    """
    count = len(differences)
    if count < 2:
        return math.nan
    centre = float(differences.mean())
    spread = float(differences.std(ddof=1))
    if not spread:
        return float(centre == 0.0)
    return float(2.0 * t.sf(abs(centre) / spread * math.sqrt(count), count - 1))


def holm(p_values: Sequence[float]) -> FloatArray:
    """Return p-values adjusted for their number, (n,): Holm (1979), Scand. J. Statist. 6.

    Rejecting below a level keeps the probability of any false rejection below that level.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


def caveat(units: int, what: str = "seeds") -> str:
    """Return what a page must say of intervals over few `units`, called `what`, "" where enough."""
    if units >= _ENOUGH_FOR_MEANS:
        return ""
    return (
        f"With {units} {what} the interval of a mean is a 95 % interval only if the errors are "
        "normal."
    )


def cvar95(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the conditional value at risk: the mean of the largest 5 %.

    Rockafellar and Uryasev (2002), "Conditional value-at-risk for general loss distributions",
    proposition 8: the value at the edge of the 5 % counts with its part inside.
    """
    order = np.argsort(-values, kind="stable")
    weights = weights[:, order]
    reached = np.cumsum(weights, axis=1)
    size = TAIL * reached[:, -1:]
    inside = np.clip(size - (reached - weights), 0.0, weights)
    return inside @ values[order] / size[:, 0]


def bootstrap_means(
    table: FloatArray, statistic: Callable[[FloatArray], FloatArray]
) -> IntervalEstimate:
    """Return a statistic of means over units with the interval of a cluster bootstrap.

    The percentile interval, expanded for few units: Hesterberg (2015), "What teachers should know
    about the bootstrap", The American Statistician 69(4).

    Args:
        table: samples of each unit, (units, k), finite; a unit is resampled as a whole.
        statistic: of means, (resamples, k) -> (resamples,).
    """
    count = len(table)
    value = float(statistic(table.mean(axis=0, keepdims=True))[0])
    if count < 2:
        return IntervalEstimate(value, None, None)
    return _expanded(value, statistic(resampled_means(table)), count)


def resampled_means(table: FloatArray) -> FloatArray:
    """Return means (resamples, k) over units drawn with replacement from a table (units, k)."""
    return _weights(len(table)) @ table / len(table)


def _expanded(value: float, resampled: FloatArray, count: int) -> IntervalEstimate:
    tail = norm.cdf(np.sqrt(count / (count - 1)) * t.ppf(0.5 - 0.5 * CONFIDENCE, count - 1))
    low, high = np.quantile(resampled, (tail, 1.0 - tail))
    # Rounding of resamples must not exclude the estimate from its own interval.
    return IntervalEstimate(value, min(float(low), value), max(float(high), value))


@functools.lru_cache(maxsize=2)
def _weights(count: int) -> NDArray[np.int16]:
    """Return the count of each unit in each resample, (resamples, count)."""
    equal = np.full(count, 1.0 / count)
    resamples = _RESAMPLES if count <= _FEW else _RESAMPLES_OF_MANY
    return generator(count, "bootstrap").multinomial(count, equal, size=resamples).astype(np.int16)


def proportion(count: int, total: int, confidence: float = CONFIDENCE) -> Proportion:
    """Return a proportion with its exact interval, after Clopper and Pearson (1934).

    Of a total of 0, the interval is all of [0, 1].
    """
    if not total:
        return Proportion(0, 0, 0.0, 1.0)
    interval = binomtest(count, total).proportion_ci(confidence, method="exact")
    return Proportion(count, total, float(interval.low), float(interval.high))


def rate(count: int, time: float) -> IntervalEstimate:
    """Return events per unit of time with the exact interval of a Poisson rate, Garwood (1936)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = 0.5 * float(chi2.ppf(tail, 2 * count)) if count else 0.0
    high = 0.5 * float(chi2.ppf(1.0 - tail, 2 * (count + 1)))
    return IntervalEstimate(count / time, low / time, high / time)


def fewest_samples(coverage: float, confidence: float = CONFIDENCE) -> int:
    """Return the number of independent samples whose maximum bounds a quantile.

    Wilks (1941): the largest of n samples exceeds the quantile of probability `coverage` with
    probability 1 - coverage^n.
    """
    return math.ceil(math.log(1.0 - confidence) / math.log(coverage))
