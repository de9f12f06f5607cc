"""Numerical derivatives for tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ttempc.types import FloatArray


def central_differences(
    function: Callable[[FloatArray], FloatArray], point: FloatArray, step: float = 1e-6
) -> FloatArray:
    """Return d function / d point by central differences, (m, n)."""
    columns = [
        (function(point + step * unit) - function(point - step * unit)) / (2.0 * step)
        for unit in np.eye(len(point))
    ]
    return np.stack(columns, axis=-1)
