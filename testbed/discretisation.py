"""Discretisation: times as counts of physics steps."""

import math

from .errors import InvalidPlant


def whole_steps(period: float, timestep: float, what: str, least: int = 1) -> int:
    """Return how many physics steps make `period` [s], at least so many.

    Raises:
        InvalidPlant: the period is not a whole number of steps; `what` names it.
    """
    steps = round(period / timestep) if math.isfinite(period) else -1
    if steps < least or abs(steps * timestep - period) > 1e-9:
        raise InvalidPlant(
            f"{what}: {period:g} s is not a whole number of physics steps of {timestep:g} s"
        )
    return steps
