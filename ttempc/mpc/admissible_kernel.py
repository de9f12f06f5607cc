"""Nearest admissible first input of a plan, compiled."""

from __future__ import annotations

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray


@cached_njit(error_model="numpy", boundscheck=False)
def nearest_admissible(
    k: int,
    inputs: FloatArray,
    previous: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    step_lower: FloatArray,
    step_upper: FloatArray,
) -> FloatArray:
    """Return the input (m,) nearest to `inputs` (m,) within bounds and a step from `previous`.

    The other arguments are those of `StageBounds`, (ticks, m or more); row `k` counts.
    """
    result = np.empty_like(inputs)
    for i in range(inputs.size):
        low = max(lower[k, i], previous[i] + step_lower[k, i])
        high = min(upper[k, i], previous[i] + step_upper[k, i])
        result[i] = max(min(inputs[i], high), low)
    return result
