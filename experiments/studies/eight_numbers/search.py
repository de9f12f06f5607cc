"""Search of a unit cube: a Sobol sequence, then mutations of the best points found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import qmc

from ttempc.types import FloatArray

START: Final = 32  # points of the Sobol sequence
BATCH: Final = 8  # points evaluated at a time
_PARENTS: Final = 6  # best points from which mutations start
_CROSSING: Final = 0.3  # probability that an entry comes from a second parent
_REDRAWN: Final = 0.1  # probability that an entry is drawn anew, which a choice may need
_SPREAD: Final = (0.2, 0.97, 0.02)  # standard deviation at first, its factor a point, its least


@dataclass(frozen=True, slots=True)
class Trial:
    """A point of the cube and its score, lower is better."""

    point: FloatArray  # (n,)
    score: float


def search(
    scores: Callable[[Sequence[FloatArray]], Sequence[float]],
    dimension: int,
    budget: int,
    known: FloatArray | None = None,
    seed: int = 0,
) -> list[Trial]:
    """Return `budget` trials in the order in which they were made.

    The i-th point depends on the seed and the scores before it alone, so that a larger budget
    continues a smaller one and stored scores resume a search that was interrupted.

    Args:
        scores: of a batch of points; finite numbers.
        dimension: of the cube.
        budget: number of points.
        known: the first point (n,), in the place of that of the sequence.
        seed: of the sequence and of the mutations.
    """
    first = qmc.Sobol(dimension, rng=np.random.default_rng(seed)).random(START)
    if known is not None:
        first[0] = known
    trials: list[Trial] = []
    while len(trials) < budget:
        count = min(BATCH, budget - len(trials))
        places = range(len(trials), len(trials) + BATCH)  # a cut batch makes the same points
        points = [first[i] if i < START else _mutation(trials, i, seed) for i in places][:count]
        values = scores(points)
        trials += [Trial(point, float(score)) for point, score in zip(points, values, strict=True)]
    return trials


def best(trials: Sequence[Trial], count: int) -> list[Trial]:
    """Return the `count` best trials, the best first."""
    return sorted(trials, key=lambda trial: trial.score)[:count]


def _mutation(trials: Sequence[Trial], number: int, seed: int) -> FloatArray:
    """Return the point of this number from the best of all whole batches before it."""
    generator = np.random.default_rng((seed, number))
    parents = best(trials[: number - number % BATCH], _PARENTS)
    mother, father = (parents[i].point for i in generator.integers(len(parents), size=2))
    size = len(mother)
    mixed = np.where(generator.random(size) < _CROSSING, father, mother)
    first, factor, least = _SPREAD
    spread = max(least, first * factor ** (number - START))
    moved = mixed + spread * generator.standard_normal(size)
    reflected = 1.0 - np.abs(1.0 - np.abs(moved) % 2.0)  # at both faces of the cube
    return np.where(generator.random(size) < _REDRAWN, generator.random(size), reflected)
