"""Search for the least cost by a (1+1) evolution strategy, in as many evaluations as are given.

I. Rechenberg (1973), "Evolutionsstrategie", with the one-fifth rule in the form of S. Kern et al.
(2004), "Learning probability distributions in continuous evolutionary algorithms", Natural
Computing 3, pp. 77-112: a normal step from the best point so far; wider steps after a success,
narrower ones after a failure, in balance where one step in five succeeds. It starts where it is
told to, and one that finds nothing better returns the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

_FIRST_STEP: Final = 0.15  # standard deviation of the first step, of a range of 1; assumed
_WIDER: Final = 1.5  # factor of the step after a success, its fourth root the divisor else


@dataclass(frozen=True)
class Found:
    """Result of a search."""

    point: FloatArray  # (n,) best point
    cost: float  # at the best point
    first: float  # at the start
    evaluations: int


def evolve(
    cost: Callable[[FloatArray], float],
    start: FloatArray,
    evaluations: int,
    rng: np.random.Generator,
) -> Found:
    """Return the best of `evaluations` points, the `start` (n,) in [0, 1]^n among them.

    Steps beyond a bound are reflected at it. `cost` must give the same at the same point.
    """
    first = cost(start)
    best = start
    least = first
    width = _FIRST_STEP
    for _ in range(evaluations - 1):
        drawn = best + width * rng.standard_normal(len(best))
        point = 1.0 - np.abs(1.0 - np.abs(drawn) % 2.0)
        found = cost(point)
        if found < least:
            best = point
            least = found
            width *= _WIDER
        else:
            width /= _WIDER**0.25
    return Found(best, least, first, evaluations)
