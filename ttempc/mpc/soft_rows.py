"""Soft constraints on linear outputs of the state, with an exact penalty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..types import FloatArray

# Of a slack s: cost PENALTY s + PENALTY s^2 / 2. The penalty is exact, that is the slack is 0 where
# the hard problem has a solution, if it exceeds the sum of that problem's multipliers of the output
# (Kerrigan and Maciejowski 2000). Assumed; multipliers on `rows` stay below 40.
PENALTY: Final = 10.0
FREE: Final = 1e3
"""Bound in the place of an infinite one: of rows without a bound PIQP drops the coefficients."""
_HOLDS: Final = 1e-9  # violation that counts as none


@dataclass(frozen=True, slots=True)
class OutputBounds:
    """Bounds lower <= S z <= upper on r outputs of the state at N + 1 ticks; infinite: free."""

    rows: FloatArray  # S (N + 1, r, n)
    lower: FloatArray  # (N + 1, r)
    upper: FloatArray  # (N + 1, r)
    first: int = 1  # stage of the horizon from which on they hold


@dataclass(frozen=True, slots=True)
class SoftRows:
    """Soft constraints of one QP: lower - s_j <= G x <= upper + s_j, for j = row modulo r.

    The rows are those of r outputs at one stage after the other. Each output has one slack s_j,
    its largest violation along the horizon.
    """

    matrix: FloatArray  # G (Np r, n)
    lower: FloatArray  # (Np r,)
    upper: FloatArray  # (Np r,)
    outputs: int  # r

    def hold(self, x: FloatArray) -> bool:
        """Whether all constraints hold at `x` (n,) without a slack."""
        rows = self.matrix @ x
        excess = np.maximum(rows - self.upper, self.lower - rows)
        return bool((excess <= _HOLDS).all())

    @property
    def slack_columns(self) -> FloatArray:
        """Return the matrix from the slacks to the rows, (Np r, r)."""
        return np.tile(np.eye(self.outputs), (len(self.lower) // self.outputs, 1))
