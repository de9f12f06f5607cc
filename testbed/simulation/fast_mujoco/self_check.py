"""Self-check: do compiled steps move the first plant of a process as plain steps do?"""

import functools
import logging
from typing import Final

import numpy as np

from ...truth import TruthBlock

LARGEST_DIFFERENCE: Final = 1e-9  # of a number, over its size or over 1 where that is larger
CHECKED_STEPS: Final = 4  # with constraints, without them, and two that follow from those

_LOG: Final = logging.getLogger("ttempc")


class SelfCheck:
    """Verdict of a process on its compiled steps."""

    def __init__(self) -> None:
        self.passed: bool | None = None  # None: no plant was checked yet

    def compare(self, compiled: TruthBlock, plain: TruthBlock) -> None:
        """Compare states after the same steps; log a line where they differ."""
        found = difference(compiled, plain)
        self.passed = found <= LARGEST_DIFFERENCE
        if not self.passed:
            warn_of_plain_steps(
                f"compiled ones differ by {found:.1e} after {CHECKED_STEPS} steps, "
                f"at most {LARGEST_DIFFERENCE:g} is allowed"
            )


SELF_CHECK: Final = SelfCheck()


def difference(compiled: TruthBlock, plain: TruthBlock) -> float:
    """Return the largest relative difference of two blocks, infinite where one has NaN."""
    largest = 0.0
    for one, other in zip(compiled, plain, strict=True):
        if one.size:
            relative = np.abs(one - other) / np.maximum(1.0, np.abs(other))
            largest = max(largest, float(np.nan_to_num(relative, nan=np.inf).max()))
    return largest


@functools.cache
def warn_of_plain_steps(reason: str) -> None:
    """Log once that plain steps are taken, and why."""
    _LOG.warning("physics takes plain steps, which are slower: %s", reason)
