"""Minimiser of a QP whose bounds are all inactive, compiled."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray


class Outcome(IntEnum):
    """What `interior_minimum` found."""

    NOT_FINITE = 0  # an entry of the gradient or of a bound on the rows
    NOT_CONVEX = 1  # Hessian not positive definite, or not finite
    BOUNDED = 2  # the unconstrained minimiser violates a bound
    INTERIOR = 3  # the unconstrained minimiser is within all bounds: it is the minimiser


@cached_njit(error_model="numpy", boundscheck=False)
def interior_minimum(
    hessian: FloatArray,
    gradient: FloatArray,
    matrix: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    step_lower: FloatArray,
    step_upper: FloatArray,
    x: FloatArray,
) -> int:
    """Write -H^-1 g into `x` (n,), by Cholesky's factorisation, and return an `Outcome`.

    The other arguments are those of `ttempc.mpc.quadratic_programme.QP`.
    """
    n = gradient.size
    for i in range(n):
        if not math.isfinite(gradient[i]):
            return Outcome.NOT_FINITE
    for i in range(lower.size):
        if not (math.isfinite(lower[i]) and math.isfinite(upper[i])):
            return Outcome.NOT_FINITE
    factor = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            rest = hessian[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if i == j:
                if not (rest > 0.0 and math.isfinite(rest)):
                    return Outcome.NOT_CONVEX
                factor[i, i] = math.sqrt(rest)
            else:
                factor[i, j] = rest / factor[j, j]
    for i in range(n):
        rest = -gradient[i]
        for k in range(i):
            rest -= factor[i, k] * x[k]
        x[i] = rest / factor[i, i]
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for k in range(i + 1, n):
            rest -= factor[k, i] * x[k]
        x[i] = rest / factor[i, i]
    for i in range(n):
        if not step_lower[i] <= x[i] <= step_upper[i]:
            return Outcome.BOUNDED
    for i in range(lower.size):
        row = 0.0
        for k in range(n):
            row += matrix[i, k] * x[k]
        if not lower[i] <= row <= upper[i]:
            return Outcome.BOUNDED
    return Outcome.INTERIOR
