"""Inputs of a reference beyond the limits of the vehicle."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..limits import CommandLimits
from ..reference.reference import ReferenceSample
from ..types import Input

_ROUNDING: Final = 1e-6  # excess of a reference over a limit that is not reported


def beyond_limits(grid: ReferenceSample, limits: CommandLimits) -> list[str]:
    """Return for every tick the inputs of the reference beyond the limits, "" where none is."""
    inputs = grid.inputs
    over = (inputs > limits.upper + _ROUNDING) | (inputs < limits.lower - _ROUNDING)
    fast = np.abs(np.diff(inputs, axis=0, prepend=inputs[:1])) > limits.step + _ROUNDING
    names = np.array([item.name.lower() for item in Input])
    notes = np.full(len(inputs), "", dtype=object)
    for k in np.flatnonzero(over.any(axis=1) | fast.any(axis=1)):
        excess = ", ".join(names[over[k] | fast[k]])
        notes[k] = f"reference asks for more {excess} than the limits allow: driving at the limit"
    return notes.tolist()
