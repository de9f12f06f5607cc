"""Times as counts of physics steps."""

from __future__ import annotations

import math

from .errors import InvalidPlant


def whole_steps(period: float, timestep: float, what: str) -> int:
    """Return how many physics steps make `period` [s].

    Raises:
        InvalidPlant: the period is not a whole number of steps; `what` names it.
    """
    steps = round(period / timestep) if math.isfinite(period) else 0
    if steps < 1 or abs(steps * timestep - period) > 1e-9:
        raise InvalidPlant(
            f"{what}: {period:g} s is not a whole number of physics steps of {timestep:g} s"
        )
    return steps


def delay_steps(delay: float, timestep: float, what: str) -> int:
    """Return how many physics steps make `delay` [s], which may be none at all.

    Raises:
        InvalidPlant: as `whole_steps`.
    """
    return whole_steps(delay, timestep, what) if delay else 0
