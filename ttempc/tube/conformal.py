"""Split-conformal calibration: half widths that the next run keeps with a given probability.

Let every run have one score, and let the scores of n calibration runs and of the next run be
exchangeable, such as those of runs that differ in their seed alone. The k-th smallest of the n
scores is then exceeded by the next one with a probability of at most 1 - k / (n + 1), whatever the
distribution: Vovk, Gammerman and Shafer (2005), "Algorithmic learning in a random world"; Lei,
G'Sell, Rinaldo, Tibshirani and Wasserman (2018), "Distribution-free predictive inference for
regression", JASA 113. The score of a run is its largest deviation in time and over all quantities
(`largest_score`), so that the statement is one on whole runs.

The probability is that over calibration and next run together. Given one calibration, the coverage
is a random number with the Beta(k, n + 1 - k) distribution for continuous scores (`Calibration`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv

from ..errors import InvalidTube
from ..types import FloatArray

_ROUNDING = 1e-9  # of coverage * (n + 1), which may be a whole number but for rounding


@dataclass(frozen=True)
class Calibration:
    """Factor on a scale that the score of the next run does not exceed with a given probability."""

    factor: float
    rank: int  # k: the factor is the k-th smallest score
    count: int  # n

    @property
    def coverage(self) -> float:
        """Probability k / (n + 1) that the next run stays within the factor."""
        return self.rank / (self.count + 1)

    def coverage_interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the central interval of the coverage given this calibration (continuous scores).

        It is that of Beta(k, n + 1 - k): Vovk (2012), "Conditional validity of inductive conformal
        predictors", proposition 2a.
        """
        tails = 0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)
        low, high = betaincinv(self.rank, self.count + 1 - self.rank, tails)
        return float(low), float(high)


def largest_score(deviation: FloatArray, scale: FloatArray) -> float:
    """Return the score of a run: its largest absolute deviation (T, q) in units of a scale.

    The scale is (q,) for constant half widths or (T, q) for those of a tube along the run, above 0,
    and chosen without the calibration runs.

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
    return max(1, math.ceil(coverage / (1.0 - coverage) - _ROUNDING / (1.0 - coverage)))


def calibrate(scores: Sequence[float] | FloatArray, coverage: float) -> Calibration:
    """Return the smallest score that the next run exceeds with probability 1 - `coverage` at most.

    The scores (n,) are infinite for runs that were lost. Equal scores only raise the coverage.

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
    count, needed = len(ordered), fewest_scores(coverage)
    if count < needed:
        raise InvalidTube(
            f"got {count} scores, a coverage of {coverage:g} for the next run takes {needed} at "
            "least"
        )
    rank = max(1, math.ceil(coverage * (count + 1) - _ROUNDING))
    return Calibration(float(ordered[rank - 1]), rank, count)
