"""Exact feedforward: the inputs that drive a perfect vehicle along the reference."""

from __future__ import annotations

import numpy as np

from ..types import FloatArray
from .reference import Reference


def exact_feedforward(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return (delta_t, delta_i, hp) of the exact posture, (`ticks`, 3).

    Taken in the middle of each period, because an input held for a period lags by half of it.
    """
    return reference.at((np.arange(ticks) + 0.5) * period_s).inputs
