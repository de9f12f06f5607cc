"""The arithmetic of a tube in a control step, compiled: numpy takes longer to start than to do it.

Tests hold each function to its formula in numpy's words.
"""

from __future__ import annotations

import numba
import numpy as np

from ..types import FloatArray


@numba.njit(cache=True)
def within(
    share: FloatArray,
    seen: FloatArray,
    gains: FloatArray,
    k: int,
    here: FloatArray,
    nominal: FloatArray,
) -> tuple[float, FloatArray, FloatArray]:
    """Return margin, seen nominal error (9,) and K (here - nominal) (3,) of tick `k`.

    `share` (T, 12, 7) gives the deviation in half widths of the tube; the margin is 1 less the
    largest of them.
    """
    n, rows, inputs = here.shape[0], seen.shape[1], gains.shape[1]
    largest = 0.0
    for row in range(share.shape[1]):
        total = 0.0
        for column in range(n):
            total += share[k, row, column] * (here[column] - nominal[column])
        largest = max(largest, abs(total))
    error, action = np.zeros(rows), np.zeros(inputs)
    for row in range(rows):
        for column in range(n):
            error[row] += seen[k, row, column] * nominal[column]
    for row in range(inputs):
        for column in range(n):
            action[row] += gains[k, row, column] * (here[column] - nominal[column])
    return 1.0 - largest, error, action


@numba.njit(cache=True)
def successor(
    a: FloatArray, b: FloatArray, k: int, state: FloatArray, inputs: FloatArray
) -> FloatArray:
    """Return A_k state + B_k inputs with A (T, 7, 16) and B (T, 7, 3), (7,)."""
    result = np.zeros(a.shape[1])
    for row in range(a.shape[1]):
        for column in range(state.shape[0]):
            result[row] += a[k, row, column] * state[column]
        for column in range(inputs.shape[0]):
            result[row] += b[k, row, column] * inputs[column]
    return result
