"""Coverage of the bootstrap interval of a mean by the number of seeds.

    python -m experiments.benchmarks.intervals [DRAWS]

Draws DRAWS (2000) sets of samples of each size, normal and skewed, with a fixed seed.
"""

from __future__ import annotations

import sys
from typing import Final

import numpy as np

from proving_ground.testbed.randomness import generator

from ..results.statistics import CONFIDENCE, bootstrap

_COUNTS: Final = (3, 5, 8, 14, 30)
_SKEW: Final = 0.5  # standard deviation of the logarithm


def coverage(count: int, draws: int, skewed: bool) -> float:
    """Return the share of intervals, each of `count` samples, that contain the mean."""
    random = generator(count, "intervals")
    covered = 0
    for _ in range(draws):
        normal = random.normal(0.0, 1.0, count)
        estimate = bootstrap(np.exp(_SKEW * normal) if skewed else normal)
        low, high = estimate.ends
        covered += low <= (np.exp(0.5 * _SKEW**2) if skewed else 0.0) <= high
    return covered / draws


def main(draws: str = "2000") -> None:
    """Print the figures."""
    print(f"seeds   normal  log-normal   (an interval of {CONFIDENCE:.0%})")
    for count in _COUNTS:
        normal, skewed = (coverage(count, int(draws), skewed) for skewed in (False, True))
        print(f"{count:5d} {normal:8.1%} {skewed:11.1%}")


if __name__ == "__main__":
    main(*sys.argv[1:])
