"""Reward of a control period: negative squared errors and changes of the commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

ERROR_M: Final = 0.1
"""Distance of both points from their reference that costs 1; assumed."""

EFFORT: Final = 0.1
"""Cost where all commands change as fast as the vehicle allows; assumed: as an error of 3 cm."""

LARGEST_COST: Final = 100.0
"""Of a period: that of 1 m; assumed."""


def cost(errors_m: Sequence[float], change: Sequence[float]) -> float:
    """Return the cost of a period, from 0 to `LARGEST_COST`.

        cost = mean((e / ERROR_M)^2) + EFFORT mean(c^2)

    Args:
        errors_m: e, true distances of tractor and trailer point from their references [m].
        change: c, changes of the commands as shares of the largest ones in a period, of each input.
    """
    error = sum(e * e for e in errors_m) / (len(errors_m) * ERROR_M**2)
    effort = sum(c * c for c in change) / len(change)
    return min(error + EFFORT * effort, LARGEST_COST)


def reward(errors_m: Sequence[float], change: Sequence[float], periods_lost: int) -> float:
    """Return the reward of a period.

    The periods that are left when a vehicle is lost have the largest cost, so that no policy gains
    by ending its run early.

    Args:
        errors_m, change: as in `cost`.
        periods_lost: periods of the reference after this one that are not driven.
    """
    return -cost(errors_m, change) - LARGEST_COST * periods_lost
