"""Weights of the errors where the trailer's steering of a reference is near its stop."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..mpc.articulated_error import Output
from ..reference.reference import Reference
from ..types import FloatArray, State

_BEGINS: Final = 0.75  # share of the stop from which on the tractor's error weighs less; assumed
_ENDS: Final = 0.95  # from which on it weighs as little as it ever does; assumed
# Of the tractor's error across there, over its weight elsewhere: what the trailer lacks, only the
# tractor can give it, by about as much. 0.05 gives little more and costs the tractor twice as much
_TRACTOR_FACTOR: Final = 0.2
_BEFORE_S: Final = 4.0  # from which on before such a place the factor falls: a horizon


def weight_factors(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return the factors of the weights of the outputs at each tick, (ticks, 4), see `Output`.

    Where the reference needs the trailer's steering up to its stop, an error of the trailer can be
    corrected by the tractor alone, which has to leave its line for that. The factor of the
    tractor's cross-track error falls from 1 to 0.2 between 75 % and 95 % of the stop, smoothly, and
    in proportion to the time over the four seconds before. Elsewhere, in reverse and with a plain
    trailer all factors are 1.
    """
    factors = np.ones((ticks, len(Output)))
    vehicle = reference.vehicle
    if vehicle.is_plain or vehicle.reverse:
        return factors
    angle = reference.at(period_s * np.arange(ticks)).state[:, State.DELTA_I]
    share = (np.abs(angle) / vehicle.steering_limit_i - _BEGINS) / (_ENDS - _BEGINS)
    share = np.clip(share, 0.0, 1.0)
    need = share * share * (3.0 - 2.0 * share)  # without a kink at either end

    before = math.ceil(_BEFORE_S / period_s)
    expected = need.copy()
    for n in range(1, min(before, ticks)):
        later = need[n:] * (1.0 - n / before)
        expected[:-n] = np.maximum(expected[:-n], later)
    factors[:, Output.TRACTOR_ACROSS] = 1.0 - (1.0 - _TRACTOR_FACTOR) * expected
    return factors
