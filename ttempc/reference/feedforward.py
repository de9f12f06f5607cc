"""Exact feedforward: inputs that keep the articulated model on the reference."""

from __future__ import annotations

import numpy as np

from ..types import FloatArray
from .reference import Reference


def exact_feedforward(reference: Reference, ticks: int, period_s: float) -> FloatArray:
    """Return the inputs of the reference for each tick, (ticks, 3) in the order of `Input`.

    They are those of the middle of each period, because an input that is constant over a period
    lags by half of it.
    """
    return reference.at((np.arange(ticks) + 0.5) * period_s).inputs
