"""Gains of the linear-quadratic regulator along a reference, by the Riccati recursion."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from ..errors import InvalidTuning
from ..types import FloatArray


def riccati_gains(
    a: FloatArray,
    b: FloatArray,
    state_cost: FloatArray,
    input_cost: FloatArray,
    terminal_cost: FloatArray | None = None,
) -> FloatArray:
    """Return the gains K (N, m, n) of u(k) = -K_k z(k) that minimise sum z'Q z + sum u'R u.

    The model is z(k+1) = A_k z(k) + B_k u(k). The recursion runs backwards over the N stages,

        K = (R + B'PB)^-1 B'PA,    P <- Q + A'P (A - BK).

    Args:
        a: A (N, n, n).
        b: B (N, n, m).
        state_cost: Q (N, n, n).
        input_cost: diagonal of R (m,).
        terminal_cost: P (n, n) after the last stage. Without it, the last stage is repeated
            indefinitely, and P solves its algebraic Riccati equation.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """
    weight = np.diag(input_cost)
    value = terminal_cost
    if value is None:
        try:
            value = solve_discrete_are(a[-1], b[-1], state_cost[-1], weight)
        except np.linalg.LinAlgError as error:
            raise InvalidTuning(f"no regulator stabilises the last stage: {error}") from None
    gains = np.empty((len(b), b.shape[2], b.shape[1]))
    for k in reversed(range(len(b))):
        by_input = b[k].T @ value
        gains[k] = np.linalg.solve(weight + by_input @ b[k], by_input @ a[k])
        value = state_cost[k] + a[k].T @ value @ (a[k] - b[k] @ gains[k])
        value = 0.5 * (value + value.T)
    return gains
