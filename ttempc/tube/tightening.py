"""Constraints on state and input, tightened by a tube."""

from __future__ import annotations

import numpy as np

from ..errors import InvalidTube
from ..types import FloatArray
from .polytope import Polytope
from .tube import Tube


def tightened_offsets(
    constraints: Polytope, tube: Tube, offsets: FloatArray | None = None
) -> FloatArray:
    """Return the offsets that a tube leaves to nominal state and input at every tick, (T, h).

    With u = ubar + K m, every (zbar + m, ubar + K m) satisfies F z + G u <= offsets if the nominal
    pair satisfies F zbar + G ubar <= offsets - h_S(F + G K).

    Args:
        constraints: normals (F G) on the stacked (z, u), (h, n + m).
        tube: around the nominal motion.
        offsets: of every tick (T, h) where they change; by default those of `constraints`.

    Raises:
        InvalidTube: shapes that do not fit, or an empty set, with its first tick.
    """
    system = tube.system
    ticks, n, m = system.b.shape
    if constraints.dimension != n + m:
        raise InvalidTube(
            f"constraints: got {constraints.dimension} columns, must be {n} of the state and "
            f"{m} of the input"
        )
    allowed = np.broadcast_to(
        constraints.offsets if offsets is None else offsets, (ticks, len(constraints.offsets))
    )
    taken = tube.support(constraints.normals[:, :n] + constraints.normals[:, n:] @ system.gains)
    left = allowed - taken
    try:  # no tick is empty where the smallest offsets leave a point
        Polytope(constraints.normals, left.min(axis=0)).require_interior(taken.max(axis=0))
    except InvalidTube:
        for k in range(ticks):
            try:
                Polytope(constraints.normals, left[k]).require_interior(taken[k])
            except InvalidTube as reason:
                raise InvalidTube(f"tick {k}: {reason}") from None
    return left
