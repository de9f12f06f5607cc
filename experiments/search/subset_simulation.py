"""Probability of a rare event by subset simulation, with an interval.

Au and Beck, Estimation of small failure probabilities in high dimensions by subset simulation,
Probabilistic Engineering Mechanics 16, 2001, doi 10.1016/S0266-8920(01)00019-4. The event is
g <= 0 of a limit state g. Each level of g is one below which a tenth of the samples lie; Markov
chains started from these make the samples of the next level, until a tenth of them are failures.
The chains move by conditional sampling in standard normal space (Papaioannou, Betz, Zwirglmaier and
Straub, MCMC algorithms for subset simulation, Probabilistic Engineering Mechanics 41, 2015, doi
10.1016/j.probengmech.2015.06.006).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, norm

from ttempc.types import FloatArray

LEAST_SAMPLES: Final = 50  # below it, the interval holds less often than it says
_SHARE: Final = 0.1  # of the samples below a level; Au and Beck
_CORRELATION: Final = 0.8  # of a move of a chain at first, adapted to the acceptance
_ACCEPTANCE: Final = 0.44  # Papaioannou et al.
_LEVELS: Final = 9  # most: probabilities down to 1e-9


@dataclass(frozen=True)
class Probability:
    """Probability of an event, with a 95 % interval."""

    estimate: float | None  # None: the event did not occur; `high` is its upper limit
    low: float
    high: float
    levels: int
    samples: int


def subset_simulation(
    limit_state: Callable[[FloatArray], FloatArray],
    dimension: int,
    samples: int,
    rng: np.random.Generator,
) -> Probability:
    """Return the probability that g(z) <= 0 for z of independent standard normals.

    The interval is lognormal. Its coefficient of variation is that of Au and Beck (their eq. 28 and
    29) from the correlation along each chain, with levels taken as fully correlated, their upper
    bound: at a hundred samples a level the sum of squares is too small.

    Args:
        limit_state: g at points (m, dimension), (m,); the order of its calls is fixed by `rng`.
        dimension: of z.
        samples: per level, a multiple of 10 and at least `LEAST_SAMPLES`.
        rng: draws samples and moves.

    Raises:
        ValueError: `samples` is no such number.
    """
    if samples < LEAST_SAMPLES or samples % 10:
        raise ValueError(f"samples must be a multiple of 10 from {LEAST_SAMPLES}, got {samples}")
    chains = round(_SHARE * samples)
    z = rng.standard_normal((1, samples, dimension))  # (length of chains, chains, dimension)
    g = limit_state(z[0])[None, :]
    estimate, correlation, variations, count = 1.0, _CORRELATION, [], samples
    for _ in range(_LEVELS):
        level = max(float(np.sort(g, axis=None)[chains - 1]), 0.0)
        below = g <= level
        if level == 0.0 or below.mean() > 0.5:  # the event, or g is constant on most samples
            break
        estimate *= float(below.mean())
        variations.append(_variation(below))
        starts = rng.choice(np.flatnonzero(below), chains, replace=False)
        first = z.reshape(samples, dimension)[starts], g.ravel()[starts]
        z, g, correlation = _chains(limit_state, *first, level, samples // chains, correlation, rng)
        count += samples - chains
    failed = g <= 0.0
    if not failed.any():
        most = estimate * float(beta.ppf(0.95, 1, samples))  # Clopper and Pearson, none of samples
        return Probability(None, 0.0, most, len(variations) + 1, count)
    estimate *= float(failed.mean())
    variations.append(_variation(failed))
    spread = math.sqrt(math.log1p(sum(variations) ** 2)) * float(norm.ppf(0.975))
    return Probability(
        estimate,
        low=estimate * math.exp(-spread),
        high=min(estimate * math.exp(spread), 1.0),
        levels=len(variations),
        samples=count,
    )


def _chains(
    limit_state: Callable[[FloatArray], FloatArray],
    z: FloatArray,
    g: FloatArray,
    level: float,
    length: int,
    correlation: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, float]:
    """Return the states of Markov chains below a level, (length, chains, n) and (length, chains).

    All chains move at once, by r z + sqrt(1 - r^2) xi with a standard normal xi, and stay where
    they would leave the level. The correlation r is adapted to the share of accepted moves.
    """
    states, values = [z], [g]
    for move in range(1, length):
        noise = rng.standard_normal(z.shape)
        candidates = correlation * z + math.sqrt(1.0 - correlation**2) * noise
        results = limit_state(candidates)
        accepted = results <= level
        z, g = np.where(accepted[:, None], candidates, z), np.where(accepted, results, g)
        states.append(z)
        values.append(g)
        scale = math.sqrt(1.0 - correlation**2) * math.exp(
            (float(accepted.mean()) - _ACCEPTANCE) / math.sqrt(move)
        )
        correlation = math.sqrt(1.0 - min(scale, 1.0) ** 2)
    return np.array(states), np.array(values), correlation


def _variation(inside: NDArray[np.bool_]) -> float:
    """Return the coefficient of variation of the share of states inside, (length, chains)."""
    length, chains = inside.shape
    share = float(inside.mean())
    variance = share * (1.0 - share)
    correlated = 0.0
    for lag in range(1, length):
        covariance = float((inside[:-lag] & inside[lag:]).mean()) - share**2
        correlated += 2.0 * (1.0 - lag / length) * covariance / variance if variance else 0.0
    factor = max(1.0 + correlated, 1.0)
    return math.sqrt((1.0 - share) / (share * length * chains) * factor)
