"""Check of a disturbance set on held-out runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

from ttempc.tube.sets import DisturbanceSet
from ttempc.types import FloatArray

from ..results.statistics import proportion
from ..scenario.tube_file import HoldOut


def hold_out(
    disturbance: DisturbanceSet, runs: Sequence[FloatArray], confidence: float, apart: int
) -> HoldOut:
    """Count the windows of held-out runs inside the set, one every `apart` steps."""
    fills = np.concatenate([disturbance.fill(run)[::apart] for run in runs])
    inside = proportion(int((fills <= 1.0).sum()), len(fills), confidence)
    return HoldOut(inside.total, inside.count, inside.low, inside.high)


def contradiction(count: HoldOut, what: str, coverage: float, confidence: float) -> str:
    """Return a sentence where a hold-out count contradicts the coverage, "" where it does not.

    The test is the one-sided binomial one.
    """
    if not count.windows:
        return ""
    p = binomtest(count.inside, count.windows, coverage, alternative="less").pvalue
    if p >= 1.0 - confidence:
        return ""
    return (
        f"{count.inside} of {count.windows} held-out windows of the {what} lie in its set, a "
        f"coverage of {coverage:g} is contradicted (binomial test, p = {p:.2g}): fit to more runs"
    )
