"""The linear-quadratic regulator along a reference, by the Riccati recursion."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from ..errors import InvalidTuning
from ..types import FloatArray


def regulator_gains(
    a: FloatArray, b: FloatArray, state_cost: FloatArray, input_cost: FloatArray
) -> FloatArray:
    """Return K (N, m, n) such that u(k) = -K_k z(k) minimises sum z'Qz + u'Ru from each tick on.

    z(k+1) = A_k z(k) + B_k u(k) with `a` (N, n, n) and `b` (N, n, m); Q is `state_cost`
    (N, n, n), R the diagonal `input_cost` (m,). Beyond the last stage it repeats for ever.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """
    weight = np.diag(input_cost)
    try:
        value = solve_discrete_are(a[-1], b[-1], state_cost[-1], weight)
    except np.linalg.LinAlgError as error:
        raise InvalidTuning(f"regulator of the last stage: {error}") from None
    gains = np.empty((len(b), b.shape[2], b.shape[1]))
    for k in reversed(range(len(b))):
        by_input = b[k].T @ value
        gains[k] = np.linalg.solve(weight + by_input @ b[k], by_input @ a[k])
        value = state_cost[k] + a[k].T @ value @ (a[k] - b[k] @ gains[k])
        value = 0.5 * (value + value.T)
    return gains
