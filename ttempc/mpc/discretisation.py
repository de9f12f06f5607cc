"""Exact discretisation of linear models along a horizon."""

from __future__ import annotations

import math

import numpy as np

from ..types import FloatArray

_TAYLOR_TERMS = 15
_BLOCK = 64  # matrices at a time: a long reference needs little memory beside the result


def zero_order_hold(a: FloatArray, b: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A_d (N, n, n) and B_d (N, n, m) of z' = A z + B u with u constant for `period_s`.

    They are blocks of the exponential of [[A, B], [0, 0]] (Van Loan 1978), for `a` A (N, n, n) and
    `b` B (N, n, m).
    """
    count, n, m = b.shape

    def block(first: int) -> FloatArray:
        part = slice(first, first + _BLOCK)
        matrices = np.zeros((len(a[part]), n + m, n + m))
        matrices[:, :n, :n] = a[part] * period_s
        matrices[:, :n, n:] = b[part] * period_s
        return matrices

    starts = range(0, count, _BLOCK)
    # one norm for all samples: the result of a sample does not depend on its block
    norm = max((float(np.abs(block(k)).sum(axis=-1).max()) for k in starts), default=0.0)
    a_d, b_d = np.empty((count, n, n)), np.empty((count, n, m))
    for k in starts:
        exponential = _exponential(block(k), norm)
        a_d[k : k + _BLOCK], b_d[k : k + _BLOCK] = exponential[:, :n, :n], exponential[:, :n, n:]
    return a_d, b_d


def _exponential(matrices: FloatArray, norm: float) -> FloatArray:
    """Return exp of (N, n, n) matrices up to a `norm` by Taylor's series, scaling and squaring.

    scipy's expm treats one matrix after the other and starts a pool of threads for each: 20 times
    slower along a reference, and far more on a busy machine. Scaled to a norm of 1/2, 15 terms
    leave an error below 1e-17.
    """
    squarings = max(0, math.frexp(norm)[1] + 1)
    scaled = matrices / 2.0**squarings
    unit = np.eye(matrices.shape[-1])
    result = unit + scaled / _TAYLOR_TERMS
    for order in range(_TAYLOR_TERMS - 1, 0, -1):
        result = unit + scaled @ result / order
    for _ in range(squarings):
        result = result @ result
    return result
