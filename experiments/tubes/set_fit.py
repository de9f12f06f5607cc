"""Check of a disturbance set on held-out runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ttempc.tube.disturbance_set import DisturbanceSet
from ttempc.types import FloatArray

from ..results.statistics import proportion
from ..scenario.tube_file import HoldOut


def hold_out(disturbance: DisturbanceSet, runs: Sequence[FloatArray], confidence: float) -> HoldOut:
    """Count the windows of held-out runs inside the set, in consecutive windows without overlap."""
    fills = np.concatenate([disturbance.fill(run)[:: disturbance.window] for run in runs])
    inside = proportion(int((fills <= 1.0).sum()), len(fills), confidence)
    return HoldOut(inside.total, inside.count, inside.low, inside.high)
