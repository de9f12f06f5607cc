"""Exact discretisation of linear models along a horizon."""

from __future__ import annotations

import math

import numpy as np

from ..types import FloatArray

_TAYLOR_TERMS = 15


def zero_order_hold(a: FloatArray, b: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A_d (N, n, n) and B_d (N, n, m) of z' = A z + B u with u constant for `period_s`.

    They are blocks of the exponential of [[A, B], [0, 0]] (Van Loan 1978), for `a` A (N, n, n) and
    `b` B (N, n, m), all samples at once.
    """
    count, n, m = b.shape
    block = np.zeros((count, n + m, n + m))
    block[:, :n, :n] = a * period_s
    block[:, :n, n:] = b * period_s
    exponential = _exponential(block)  # (N, n + m, n + m)
    return exponential[:, :n, :n].copy(), exponential[:, :n, n:].copy()


def _exponential(matrices: FloatArray) -> FloatArray:
    """Return exp of each of (N, n, n) matrices by Taylor's series, scaling and squaring.

    scipy's expm treats one matrix after the other and starts a pool of threads for each: 20 times
    slower along a reference, and far more on a busy machine. Scaled to a norm of 1/2, 15 terms
    leave an error below 1e-17.
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, math.frexp(norm)[1] + 1)
    scaled = matrices / 2.0**squarings
    unit = np.eye(matrices.shape[-1])
    result = unit + scaled / _TAYLOR_TERMS
    for order in range(_TAYLOR_TERMS - 1, 0, -1):
        result = unit + scaled @ result / order
    for _ in range(squarings):
        result = result @ result
    return result
