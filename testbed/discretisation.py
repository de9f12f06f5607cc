"""Discretisation: times as counts of physics steps, values as multiples of a resolution."""

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
    """Return how many physics steps make `delay` [s]; a delay of 0 makes none.

    Raises:
        InvalidPlant: the delay is not a whole number of steps; `what` names it.
    """
    return whole_steps(delay, timestep, what) if delay else 0


def quantised(value: float, resolution: float) -> float:
    """Return the multiple of `resolution` nearest to `value`; the value itself where that is 0."""
    return resolution * round(value / resolution) if resolution else value
