"""Ancillary gain of a linear system, and the search for weights whose tube is narrow.

A quadratic cost does not contain the tube, but every choice of its weights gives a stabilising
gain. Among these gains a simplex search finds one whose tube minimises a cost.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from ..errors import InvalidTube, InvalidTuning
from ..mpc.riccati import riccati_gains
from ..types import FloatArray
from .disturbance_set import DisturbanceSet
from .tube import TrackingSystem, Tube, invariant_tube

_COARSE = 0.2  # alpha of the tubes of the search: at most 20 % too wide, five times as fast
_EVALUATIONS = 700  # of each simplex, at most
_NO_TUBE = 1e3  # cost of weights that give no tube
_FIRST_SIMPLEX = 1.0  # edge, in logarithms of the weights


def feedback_gains(
    a: FloatArray, b: FloatArray, state_cost: FloatArray, input_cost: FloatArray
) -> FloatArray:
    """Return K of u = K z that minimises sum z'Q z + sum u'R u, by the Riccati recursion.

    The last stage is repeated indefinitely; one stage alone gives the stationary gain.

    Args:
        a: A (T, n, n).
        b: B (T, n, m).
        state_cost: Q (T, n, n), or (n, n) of all stages.
        input_cost: diagonal of R (m,).

    Returns:
        K (T, m, n).

    Raises:
        InvalidTube: no gain stabilises the last stage.
    """
    try:
        return -riccati_gains(a, b, np.broadcast_to(state_cost, a.shape), input_cost)
    except InvalidTuning as reason:
        raise InvalidTube(str(reason)) from None


def search_tube(
    system_of: Callable[[FloatArray], TrackingSystem],
    cost: Callable[[Tube], float],
    disturbance: DisturbanceSet,
    start: FloatArray,
    evaluations: int = _EVALUATIONS,
    slowest: float = 0.98,
) -> FloatArray:
    """Return positive weights whose tube minimises a cost, (w,).

    Nelder and Mead's simplex over the logarithms of the weights runs twice, the second time from
    where the first one has stalled. The tubes of the search may be a fifth too wide.

    Args:
        system_of: closed loop for weights (w,); `InvalidTube` excludes them.
        cost: of a tube, below 1000.
        disturbance: that acts in every step.
        start: first weights (w,), above 0.
        evaluations: of each simplex, at most.
        slowest: largest modulus of a mode; it excludes slow loops before their tube is computed.

    Raises:
        InvalidTube: no weights give a tube.
    """

    def tube(logarithms: FloatArray) -> Tube | None:
        try:
            system = system_of(np.exp(logarithms))
            if np.abs(np.linalg.eigvals(system.closed)).max() > slowest:
                return None
            return invariant_tube(system, disturbance, _COARSE)
        except InvalidTube:
            return None

    def value(logarithms: FloatArray) -> float:
        candidate = tube(logarithms)
        return _NO_TUBE if candidate is None else cost(candidate)

    at = np.log(start)
    for _ in range(2):
        simplex = np.vstack([at, at + _FIRST_SIMPLEX * np.eye(len(at))])
        options = {"maxfev": evaluations, "adaptive": True, "initial_simplex": simplex}
        at = scipy.optimize.minimize(value, at, method="Nelder-Mead", options=options).x
    if tube(at) is None:
        raise InvalidTube("no weights of the ancillary gain were found that give a tube")
    return np.exp(at)
