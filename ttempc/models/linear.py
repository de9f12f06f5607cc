"""Linear models: discretisation, regulator."""

import math

import numpy as np
import scipy

from ..errors import InvalidTuning
from ..types import FloatArray

_TAYLOR_TERMS = 15
_BLOCK = 64  # matrices at a time: a long reference needs little more memory than its result


def zero_order_hold(a: FloatArray, b: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A_d (N, n, n) and B_d (N, n, m) of z' = A z + B u with u constant for `period_s`.

    They are blocks of the exponential of [[A, B], [0, 0]] (Van Loan 1978), for `a` A (N, r, n) and
    `b` B (N, r, m), whose rows after the r-th are 0.
    """
    count, r, m = b.shape
    n = a.shape[2]

    def block(first: int) -> FloatArray:
        part = slice(first, first + _BLOCK)
        matrices = np.zeros((len(a[part]), n + m, n + m))
        matrices[:, :r, :n] = a[part] * period_s
        matrices[:, :r, n:] = b[part] * period_s
        return matrices

    starts = range(0, count, _BLOCK)
    # one norm for all samples: the result of a sample does not depend on its block
    norm = max((float(np.abs(block(k)).sum(axis=-1).max()) for k in starts), default=0.0)
    a_d = np.empty((count, n, n))
    b_d = np.empty((count, n, m))
    for k in starts:
        exponential = _exponential(block(k), norm)
        a_d[k : k + _BLOCK] = exponential[:, :n, :n]
        b_d[k : k + _BLOCK] = exponential[:, :n, n:]
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

    A is (N, n, n), B (N, n, m), Q `state_cost` (N, n, n), the diagonal of R `input_cost` (m,).
    Without P after the last stage, `terminal_cost` (n, n), the last stage is repeated indefinitely,
    and P solves its algebraic Riccati equation.

    Raises:
        InvalidTuning: no gain stabilises the last stage.
    """
    weight = np.diag(input_cost)
    value = terminal_cost
    if value is None:
        try:
            value = scipy.linalg.solve_discrete_are(a[-1], b[-1], state_cost[-1], weight)
        except np.linalg.LinAlgError as error:
            raise InvalidTuning(f"no regulator stabilises the last stage: {error}") from None
    n = a.shape[2]
    both = np.concatenate([a[: len(b)], b], axis=2)
    gains = np.empty((len(b), b.shape[2], n))
    solve = scipy.linalg.lapack.dposv
    for k in reversed(range(len(b))):
        # [A B]'P[A B] has all products; numpy's own `solve` would take half of the time.
        products = both[k].T @ (value @ both[k])
        _, gains[k], failed = solve(weight + products[n:, n:], products[n:, :n])
        if failed:
            raise InvalidTuning(f"no regulator: R + B'PB is not positive at stage {k}")
        value = state_cost[k] + products[:n, :n] - products[:n, n:] @ gains[k]
        value = 0.5 * (value + value.T)
    return gains


def preview_gains(
    a: FloatArray,
    b: FloatArray,
    gains: FloatArray,
    state_cost: FloatArray,
    input_cost: FloatArray,
    terminal_cost: FloatArray,
    by_disturbance: FloatArray,
    stages: int,
) -> FloatArray:
    """Return the gains F (N, stages, m, q) of u(k) = -K_k z(k) - sum_j F_kj d(k + j).

    With the model z(k+1) = A_k z(k) + B_k u(k) + E_k d(k) these inputs minimise the cost of
    `riccati_gains`, whose gains K are given, for a disturbance that is known over `stages` stages
    from now on and 0 after them (Bryson and Ho 1975, section 5.3). With A - BK = L,

        F_kj = (R + B'PB)^-1 B_k' V_kj,   V_k0 = P_(k+1) E_k,   V_kj = L_(k+1)' V_(k+1)(j-1).

    E is (N, n, q), the other arguments are those of `riccati_gains`. Beyond the last stage there is
    no disturbance.
    """
    count, n, inputs = b.shape
    size = by_disturbance.shape[2]
    weight = np.diag(input_cost)
    result = np.empty((count, stages, inputs, size))
    value = terminal_cost
    later = np.zeros((n, stages, size))  # V of the stage after, with its L' before it
    for k in reversed(range(count)):
        costates = np.concatenate([(value @ by_disturbance[k])[:, None], later[:, :-1]], axis=1)
        curvature = weight + b[k].T @ value @ b[k]
        forces = b[k].T @ costates.reshape(n, -1)
        result[k] = (
            np.linalg.solve(curvature, forces).reshape(inputs, stages, size).transpose(1, 0, 2)
        )

        closed = a[k] - b[k] @ gains[k]
        later = (closed.T @ costates.reshape(n, -1)).reshape(n, stages, size)
        by_input = gains[k].T @ weight @ gains[k]
        value = state_cost[k] + by_input + closed.T @ value @ closed
        value = 0.5 * (value + value.T)
    return result
