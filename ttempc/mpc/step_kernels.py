"""The arithmetic of one control step that numpy takes longest to start, compiled.

Each function has a clear twin that a test holds it to: the formulas in its words,
`error_model.tracking_error`, `numpy.linalg.cholesky`, `QP.residuals`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ..types import FloatArray


@numba.njit(cache=True)
def tick_vectors(
    by_known: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    k: int,
    state: FloatArray,
    previous: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return gradient and both bounds of the QP of tick `k`, (p,) each.

        g = F_k (z_k, u_{k-1}),   lower_k - (u_{k-1} ... u_{k-1}),   upper_k likewise,

    with F = `by_known` (N, p, n + m) and the bounds (N, p) on the inputs.
    """
    n, m, p = state.shape[0], previous.shape[0], lower.shape[1]
    gradient, low, high = np.empty(p), np.empty(p), np.empty(p)
    for row in range(p):
        total = 0.0
        for column in range(n):
            total += by_known[k, row, column] * state[column]
        for column in range(m):
            total += by_known[k, row, n + column] * previous[column]
        gradient[row] = total
        low[row] = lower[k, row] - previous[row % m]
        high[row] = upper[k, row] - previous[row % m]
    return gradient, low, high


@numba.njit(cache=True)
def clipped(values: FloatArray, bounds: FloatArray) -> FloatArray:
    """Return `values` (m,) within `bounds` (2, m); where these cross, the upper counts."""
    result = np.empty_like(values)
    for i in range(values.shape[0]):
        result[i] = min(max(values[i], bounds[0, i]), bounds[1, i])
    return result


@numba.njit(cache=True)
def finite(first: FloatArray, second: FloatArray, third: FloatArray) -> bool:
    """Whether all entries of three vectors of any length are finite."""
    for vector in (first, second, third):
        for value in vector:
            if not math.isfinite(value):
                return False
    return True


@numba.njit(cache=True)
def convex(hessian: FloatArray) -> bool:
    """Whether `hessian` (n, n) is finite and positive definite, by Cholesky's factorisation."""
    n = hessian.shape[0]
    factor = np.empty((n, n))
    for column in range(n):
        for row in range(column, n):
            rest = hessian[row, column]
            for i in range(column):
                rest -= factor[row, i] * factor[column, i]
            if not math.isfinite(rest):
                return False
            if row == column:
                if rest <= 0.0:
                    return False
                factor[row, row] = math.sqrt(rest)
            else:
                factor[row, column] = rest / factor[column, column]
    return True


@numba.njit(cache=True)
def slack(
    matrix: FloatArray,
    x: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    step_lower: FloatArray,
    step_upper: FloatArray,
) -> float:
    """Return how far `x` (n,) is inside its bounds, negative outside, NaN where `x` is not finite.

    The bounds are lower <= G x <= upper with G = `matrix` (m, n), and those on x itself.
    """
    least = math.inf
    for row in range(matrix.shape[0]):
        value = 0.0
        for column in range(x.shape[0]):
            value += matrix[row, column] * x[column]
        least = min(least, value - lower[row], upper[row] - value)
    for i in range(x.shape[0]):
        if not math.isfinite(x[i]):
            return math.nan
        least = min(least, x[i] - step_lower[i], step_upper[i] - x[i])
    return least


@numba.njit(cache=True, inline="always")
def _wrapped(angle: float) -> float:
    return angle - math.tau * np.rint(angle / math.tau)


@numba.njit(cache=True)
def tracking_error(
    state: FloatArray,
    trailer_xy: FloatArray,
    reference_state: FloatArray,
    reference_trailer_xy: FloatArray,
) -> FloatArray:
    """Return z_e (7,), see `ttempc.models.tracking_error.tracking_error`."""
    error = np.empty(7)
    dx, dy = reference_state[0] - state[0], reference_state[1] - state[1]
    cos, sin = math.cos(state[2]), math.sin(state[2])
    error[0], error[1] = cos * dx + sin * dy, cos * dy - sin * dx
    error[2] = _wrapped(reference_state[2] - state[2])
    dx, dy = reference_trailer_xy[0] - trailer_xy[0], reference_trailer_xy[1] - trailer_xy[1]
    cos, sin = math.cos(state[3]), math.sin(state[3])
    error[3], error[4] = cos * dx + sin * dy, cos * dy - sin * dx
    error[5] = _wrapped(reference_state[3] - state[3])
    error[6] = reference_state[6] - state[6]
    return error
