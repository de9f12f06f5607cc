"""Stretches of a run's reference: curves, passes, changes of curvature.

A pass is a straight stretch of the tractor's reference of at least 15 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE
from ...testbed.recording.record import Record

LEAST_M: Final = 15.0
"""Length of a straight stretch from which it counts as a pass; assumed."""
LEAD_M: Final = 5.0
"""End of a turn that is scored with the pass that follows: a tool is lowered there; assumed."""
SETTLING_M: Final = 5.0
"""Distance behind a curvature change in which its peak is looked for; assumed."""

# A reference counts as curved from 1 % of its largest curvature on: the blends between line and
# arc then count as curve, and rounding errors on a line do not.
_CURVED_FRACTION: Final = 0.01
_STRAIGHT_PER_M: Final = 1e-6  # a path whose largest curvature is below this is a straight line

_CHANGING: Final = 0.01  # share of the largest curvature by which it changes in a metre of a blend
_NONE: Final = -1  # number of a row that belongs to no stretch


def is_curved(record: Record) -> NDArray[np.bool_]:
    """Return for each row of the reference whether it counts as curve."""
    curvature = np.abs(record[REFERENCE]["curvature_per_m"])
    largest = float(curvature.max(initial=0.0, where=np.isfinite(curvature)))
    return curvature > max(_CURVED_FRACTION * largest, _STRAIGHT_PER_M)


@dataclass(frozen=True, slots=True)
class Stretches:
    """Consecutive stretches of the reference."""

    first: NDArray[np.intp]  # (n,) first row of each
    end: NDArray[np.intp]  # (n,) row behind the last of each

    @classmethod
    def where(cls, inside: NDArray[np.bool_]) -> Stretches:
        """Return the stretches of rows that are True."""
        edges = np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8))
        return cls(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1))

    def numbers(self, rows: int) -> NDArray[np.intp]:
        """Return the number of the stretch of each of so many rows, -1 outside."""
        number = np.full(rows, _NONE)
        for index, (first, end) in enumerate(zip(self.first, self.end, strict=True)):
            number[first:end] = index
        return number


def travelled(record: Record) -> FloatArray:
    """Return the distance along the tractor's reference at each of its rows, (n,) [m]."""
    table = record[REFERENCE]
    if not len(table):
        return np.zeros(0)
    steps = np.diff(table.columns("x_t_m", "y_t_m"), axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])


def passes(record: Record, lead_m: float = 0.0) -> Stretches:
    """Return the passes of a run, each with so much of the reference before it [m]."""
    distance = travelled(record)
    found = Stretches.where(~is_curved(record))
    if not found.first.size:
        return found
    begins = distance[found.first]
    long = distance[found.end - 1] - begins >= LEAST_M
    first = np.searchsorted(distance, begins[long] - lead_m)
    return Stretches(first, found.end[long])


def curvature_changes(record: Record) -> Stretches:
    """Return the stretches in which the curvature changes, each with 5 m behind it."""
    distance = travelled(record)
    curvature = record[REFERENCE]["curvature_per_m"]
    if len(distance) < 2:
        return Stretches.where(np.zeros(len(distance), dtype=bool))
    steps = np.maximum(np.diff(distance), np.finfo(float).tiny)
    change = np.abs(np.diff(curvature))
    largest = float(np.abs(curvature).max())
    blend = Stretches.where((change > _CHANGING * largest * steps) & (change > 0.0))
    ends = np.searchsorted(distance, distance[blend.end] + SETTLING_M, side="right")
    return Stretches(blend.first, ends)
