"""Coverage of the intervals of a mean and of a 95 % quantile by the number of seeds.

    python -m experiments.benchmarks.intervals [DRAWS]

Draws DRAWS (2000) sets of samples of each size, normal and skewed, with a fixed seed. The mean has
the interval of Student's t. The bootstrap of the 95 % quantile is measured on sets of seeds with
48 runs each, of which the seed explains half of the variance.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np
from scipy.stats import norm

from ...testbed.randomness import generator
from ..results.statistics import CONFIDENCE, bootstrap, mean, quantile95

_COUNTS: Final = (3, 5, 8, 14, 30)
_SKEW: Final = 0.5  # standard deviation of the logarithm
_RUNS: Final = 48  # per seed


def coverage(count: int, draws: int, skewed: bool) -> float:
    """Return the share of intervals of a mean, each of `count` samples, that contain it."""
    random = generator(count, "intervals")
    covered = 0
    for _ in range(draws):
        normal = random.normal(0.0, 1.0, count)
        low, high = mean(np.exp(_SKEW * normal) if skewed else normal).ends
        covered += low <= (np.exp(0.5 * _SKEW**2) if skewed else 0.0) <= high
    return float(covered / draws)


def quantile_coverage(count: int, draws: int) -> float:
    """Return the share of bootstrap intervals over `count` seeds that contain the quantile."""
    random, truth = generator(count, "quantiles"), norm.ppf(0.95)
    units, covered = np.repeat(np.arange(count), _RUNS), 0
    for _ in range(draws):
        shared = random.normal(0.0, np.sqrt(0.5), count)[units]
        values = shared + random.normal(0.0, np.sqrt(0.5), len(units))
        low, high = bootstrap(values, units, quantile95).ends
        covered += low <= truth <= high
    return float(covered / draws)


def main(draws: str = "2000") -> None:
    """Print the figures."""
    print(f"seeds   mean: normal  log-normal   95 % quantile   (intervals of {CONFIDENCE:.0%})")
    for count in _COUNTS:
        normal, skewed = (coverage(count, int(draws), skewed) for skewed in (False, True))
        quantile = quantile_coverage(count, max(1, int(draws) // 10))
        print(f"{count:5d} {normal:14.1%} {skewed:11.1%} {quantile:15.1%}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
