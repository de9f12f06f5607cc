"""Reserve of the trailer's steering against the part of its side slip that nobody knows.

The tube reserves a part of each input for the ancillary gain: it counters what the plan does not
foresee. Side slip that a map or the foresight tells is in the plan, and needs no reserve beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..mpc.condensing import StageBounds
from ..types import Immutable


@dataclass(frozen=True)
class SteeringReserve(Immutable):
    """Bounds of the plan with and without a reserve of the trailer's steering, and those between.

    Of a disturbance with a share s of its variance known, the rest has sqrt(1 - s) of the half
    width, and so has the tube. Bounds in between hold a plan wherever both do. As the share falls
    the bounds close in; an input beyond them is led back by the limits of its rate.
    """

    reserved: StageBounds  # with the whole reserve
    relaxed: StageBounds  # without it

    def write(self, row: int, known: float, bounds: StageBounds) -> None:
        """Write a row of `bounds` for the share of the variance that is known, 0 to 1."""
        share = math.sqrt(1.0 - known)
        for values, reserved, relaxed in zip(bounds, self.reserved, self.relaxed, strict=True):
            values[row] = relaxed[row] + share * (reserved[row] - relaxed[row])
