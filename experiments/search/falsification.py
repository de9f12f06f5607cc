"""Falsification: search for the least severe point that fails, by CMA-ES.

Two points are compared by the rules of Deb (An efficient constraint handling method for genetic
algorithms, CMAME 186, 2000, doi 10.1016/S0045-7825(99)00389-8), with failure as the constraint: of
two that fail, the less severe is better; one that fails is better than one that holds; of two that
hold, the less robust is better. The optimiser uses the order alone: CMA-ES (Hansen, The CMA
evolution strategy: a tutorial, arXiv 1604.00772), restarted with twice the population when it has
converged (Auger and Hansen, CEC 2005, doi 10.1109/CEC.2005.1554902). Every new best failure is
simplified, as in delta debugging (Zeller and Hildebrandt, IEEE TSE 28, 2002, doi
10.1109/32.988498): without one of its deviations, and with a share of all; CMA-ES then goes on from
the mildest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import qmc

from ttempc.types import FloatArray

from ...testbed.randomness import generator
from ..errors import MissingExtra
from .robustness import Outcome
from .space import Space

if TYPE_CHECKING:
    from cmaes import CMA

_SIGMA: Final = 0.2  # first standard deviation, of the bounds
_EXPLORED: Final = 2  # generations of the first, space-filling sample
_SHARES: Final = (0.5, 0.75, 0.9, 0.97)  # of the deviations of a failure
_REFUSED: Final = 4.0  # cost, above that of every run


@dataclass(frozen=True)
class Case:
    """A point of the search and its outcome."""

    point: FloatArray  # (n,)
    severity: float
    outcome: Outcome | None  # None: the scenario refuses the point, or the run raised an error

    @property
    def failed(self) -> bool:
        """Return whether the run failed."""
        return self.outcome is not None and self.outcome.failed

    @property
    def cost(self) -> float:
        """Return the number by which cases are ordered, best first."""
        if self.outcome is None:
            return _REFUSED
        return self.severity if self.outcome.failed else 2.0 + self.outcome.robustness


Evaluate = Callable[[FloatArray], Sequence[Outcome | None]]
"""Outcomes of points (m, n), in their order."""


def falsify(
    space: Space,
    evaluate: Evaluate,
    budget: int,
    seed: int,
    on_generation: Callable[[Sequence[Case]], object] = lambda cases: None,
) -> list[Case]:
    """Search for the least severe failure; return all cases in the order of their runs.

    The cases depend on space, budget and seed alone, not on
    how `evaluate` shares its work.

    Args:
        space: of the parameters.
        evaluate: drives points.
        budget: largest number of points.
        seed: of the optimiser.
        on_generation: called with all cases so far after every call of `evaluate`.

    Raises:
        MissingExtra: `cmaes` is not installed.
    """
    try:
        import cmaes
    except ImportError:
        raise MissingExtra(
            "falsify needs cmaes: pip install 'ttempc-proving-ground[search]'"
        ) from None
    rng = generator(seed, "falsification")
    size = len(space.parameters)
    cases: list[Case] = []

    def add(points: FloatArray) -> list[Case]:
        outcomes = evaluate(points)
        pairs = zip(points, outcomes, strict=True)
        new = [Case(point, space.severity(point), outcome) for point, outcome in pairs]
        cases.extend(new)
        on_generation(cases)
        return new

    def strategy(mean: FloatArray, population: int) -> CMA:
        bounds = np.tile([0.0, 1.0], (size, 1))
        state = int(rng.integers(2**31))
        return cmaes.CMA(mean, _SIGMA, bounds=bounds, seed=state, population_size=population)

    population = 4 + int(3.0 * np.log(size))  # Hansen's default
    add(qmc.LatinHypercube(size, rng=rng).random(min(_EXPLORED * population, budget)))
    optimiser = strategy(best(cases).point, population)
    simplified: Case | None = None
    while (rest := budget - len(cases)) > 0:
        known = best(cases)
        if known.failed and known.severity == 0.0:
            break  # at a place where the nominal values fail
        if known.failed and known is not simplified:
            simplified = known
            add(milder(space, known.point)[:rest])
            if best(cases) is not known:
                optimiser = strategy(best(cases).point, population)
            continue
        points = np.array([optimiser.ask() for _ in range(min(population, rest))])
        new = add(points)
        if len(new) == population:
            optimiser.tell([(case.point, case.cost) for case in new])
        if optimiser.should_stop():
            population *= 2
            optimiser = strategy(rng.random(size), population)
    return cases


def best(cases: Sequence[Case]) -> Case:
    """Return the least severe failure, or the least robust case if none failed."""
    return min(cases, key=lambda case: case.cost)


def distinct(space: Space, cases: Sequence[Case], most: int, apart: float = 0.2) -> list[Case]:
    """Return failures in the order of their severity, without neighbours of one returned before.

    Args:
        space: of the parameters.
        cases: to choose from.
        most: largest number of failures to return.
        apart: least root mean square distance, of the bounds.
    """
    chosen: list[Case] = []
    scale = apart * np.sqrt(len(space.parameters))
    for case in sorted((case for case in cases if case.failed), key=lambda case: case.cost):
        if all(np.linalg.norm(case.point - other.point) >= scale for other in chosen):
            chosen.append(case)
    return chosen[:most]


def milder(space: Space, point: FloatArray) -> FloatArray:
    """Return milder points, (m, n), that share the free parameters of a point.

    Each lacks the deviation of one parameter, or has a share of all deviations.
    """
    deviation = np.where(space.counted > 0.0, point - space.nominal, 0.0)
    counted = np.flatnonzero(deviation)
    without = [np.where(np.arange(len(point)) == i, deviation, 0.0) for i in counted]
    removed = without if len(counted) > 1 else []
    return np.array([point - part for part in (*removed, *((1 - s) * deviation for s in _SHARES))])
