"""Split-conformal calibration of half widths that the next run keeps with a given probability.

Every run has one score. The scores of n calibration runs and of the next run are assumed to be
exchangeable. Runs that differ in their seed alone have exchangeable scores. The next score then
exceeds the k-th smallest of the n scores with a probability of at most 1 - k / (n + 1), whatever
the distribution: Vovk, Gammerman and Shafer (2005), "Algorithmic learning in a random world"; Lei,
G'Sell, Rinaldo, Tibshirani and Wasserman (2018), "Distribution-free predictive inference for
regression", JASA 113. The score of a run is its largest deviation in time and over all quantities
(`largest_score`), so that the statement holds for whole runs.

This probability is over the draw of calibration and next run together. Given one calibration and
continuous scores, the coverage is a random number with the Beta(k, n + 1 - k) distribution
(`Calibration`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import InvalidTube
from ..types import FloatArray

# Tolerance of coverage * (n + 1), so that a whole number with a rounding error is not rounded up.
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Calibration:
    """Factor on a scale that the score of the next run does not exceed with a given probability."""

    factor: float
    rank: int  # k: the factor is the k-th smallest score
    count: int  # n, number of calibration scores

    @property
    def coverage(self) -> float:
        """Least probability k / (n + 1) that the next run stays within the factor."""
        return self.rank / (self.count + 1)

    def coverage_interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the central interval of the coverage given this calibration (continuous scores).

        The coverage has the distribution Beta(k, n + 1 - k): Vovk (2012), "Conditional validity of
        inductive conformal predictors", proposition 2a.
        """
        from scipy.special import betaincinv  # takes a while to load, and a drive needs none

        alpha = self.rank
        beta = self.count + 1 - self.rank
        low = betaincinv(alpha, beta, 0.5 * (1.0 - confidence))
        high = betaincinv(alpha, beta, 0.5 * (1.0 + confidence))
        return float(low), float(high)


def largest_score(deviation: FloatArray, scale: FloatArray) -> float:
    """Return the score of a run: its largest absolute deviation (T, q) in units of a scale.

    The scale is above 0 and chosen without the calibration runs. It is (q,) for constant half
    widths, or (T, q) for the half widths of a tube along the run.

    Raises:
        InvalidTube: the scale is not positive, or the deviation is empty or not finite.
    """
    if not np.all(scale > 0.0):
        raise InvalidTube(f"scale: got a smallest entry of {np.min(scale):g}, must be above 0")
    if not deviation.size or not np.isfinite(deviation).all():
        raise InvalidTube(f"deviation: got {deviation.shape}, must be finite and not empty")
    return float((np.abs(deviation) / scale).max())


def fewest_scores(coverage: float) -> int:
    """Return the least number of scores whose largest one has the coverage.

    Raises:
        InvalidTube: the coverage is not between 0 and 1.

    Examples:
        >>> fewest_scores(0.95), fewest_scores(0.99)
        (19, 99)
    """
    if not 0.0 < coverage < 1.0:
        raise InvalidTube(f"coverage: got {coverage:g}, must be between 0 and 1")
    # The largest of n scores has the rank n, and n / (n + 1) >= coverage.
    fewest = coverage / (1.0 - coverage)
    tolerance = _ROUNDING / (1.0 - coverage)
    return max(1, math.ceil(fewest - tolerance))


def calibrate(scores: Sequence[float] | FloatArray, coverage: float) -> Calibration:
    """Return the smallest score that the next run exceeds with probability 1 - `coverage` at most.

    Scores (n,) may be infinite: the score of a run that ended early is. Equal scores only raise the
    coverage.

    Raises:
        InvalidTube: there are too few scores for the coverage, with the number that is needed; a
            score is NaN; or the coverage is not between 0 and 1.

    Examples:
        >>> calibrate([0.4, 0.1, 0.3, 0.2], coverage=0.6).factor
        0.3
    """
    ordered = np.sort(np.asarray(scores, dtype=float))
    if ordered.ndim != 1 or np.isnan(ordered).any():
        raise InvalidTube(f"scores: got {ordered.shape}, must be one number a run and not NaN")

    count = len(ordered)
    needed = fewest_scores(coverage)
    if count < needed:
        raise InvalidTube(
            f"got {count} scores, a coverage of {coverage:g} for the next run takes {needed} at "
            "least"
        )

    rank = max(1, math.ceil(coverage * (count + 1) - _ROUNDING))
    return Calibration(float(ordered[rank - 1]), rank, count)
