"""What a count says of a probability."""

from __future__ import annotations

import math
from dataclasses import dataclass

from . import statistics


@dataclass(frozen=True, slots=True)
class Share:
    """How many of how many, and the interval of Clopper and Pearson (1934) for the probability."""

    inside: int
    total: int
    low: float
    high: float

    @property
    def fraction(self) -> float:
        """Return how many of all; NaN of none."""
        return self.inside / self.total if self.total else math.nan

    def __str__(self) -> str:
        return f"{self.fraction:.4f} ({self.low:.4f} to {self.high:.4f})"


def share(inside: int, total: int, confidence: float = 0.95) -> Share:
    """Return the share with its interval, which is exact and never too short.

    Raises:
        ValueError: there are fewer than none, or more inside than there are.
    """
    if not 0 <= inside <= total:
        raise ValueError(f"{inside} of {total}")
    if not total:
        return Share(0, 0, 0.0, 1.0)
    return Share(inside, total, *statistics.share(inside, total, confidence).ends)


def fewest_samples(coverage: float, confidence: float = 0.95) -> int:
    """Return how many independent samples bound a share of `coverage` by their largest one.

    Wilks (1941): the largest of n samples exceeds the quantile with probability 1 - coverage^n.
    """
    return math.ceil(math.log(1.0 - confidence) / math.log(coverage))
