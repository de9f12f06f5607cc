"""Saturated LQ robust law and one-step monitor of one tick, compiled."""

from __future__ import annotations

import math

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray

_TINY = 1e-30  # keeps the autocorrelation of a signal of zeros finite
# Largest argument of tanh in the tube reading. Beyond it the law cannot bring the vehicle back.
_EXHAUSTED = 3.0


@cached_njit(error_model="numpy", boundscheck=False)
def autocorrelation(memory: FloatArray, forgetting: float, signal: FloatArray) -> FloatArray:
    """Return the lag-one autocorrelation of each entry of a signal, clipped to [0, 1], (n,).

    Older samples weigh less by the factor `forgetting` with each sample. `memory` (3, n) holds the
    previous sample and the averages of product and power; the sample `signal` (n,) enters them.
    """
    result = np.empty_like(signal)
    for i in range(signal.size):
        last, now = memory[0, i], signal[i]
        memory[1, i] = forgetting * memory[1, i] + now * last
        memory[2, i] = forgetting * memory[2, i] + 0.5 * (now * now + last * last)
        memory[0, i] = now
        result[i] = min(max(memory[1, i] / max(memory[2, i], _TINY), 0.0), 1.0)
    return result


@cached_njit(error_model="numpy", boundscheck=False)
def robust_action(
    k: int,
    error: FloatArray,
    nominal: FloatArray,
    gains: FloatArray,
    outputs: FloatArray,
    limit: FloatArray,
    memory: FloatArray,
    forgetting: float,
    one_step: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return deviation (n,), modelling error (p,), action (m,), and whether the law is exhausted.

    Args:
        k: the tick.
        error: z_e (n,), or more entries, which do not count.
        nominal: zbar_e (n,).
        gains: K in units of `limit` (N, m, n).
        outputs: C (N, p, n).
        limit: k_s (m,).
        memory: see `autocorrelation`.
        forgetting: see `autocorrelation`.
        one_step: whether the autocorrelation scales the action; else the law may be exhausted.
    """
    inputs, n = gains.shape[1:]
    deviation, action = np.empty(n), np.zeros(inputs)
    for j in range(n):
        deviation[j] = error[j] - nominal[j]
    for i in range(inputs):
        for j in range(n):
            action[i] += gains[k, i, j] * deviation[j]
    exhausted = False
    if one_step:
        action *= autocorrelation(memory, forgetting, action)
    else:
        exhausted = np.abs(action).max() > _EXHAUSTED
        if exhausted:
            deviation[:], action[:] = 0.0, 0.0
    modelling = np.zeros(outputs.shape[1])
    for i in range(modelling.size):
        for j in range(n):
            modelling[i] += outputs[k, i, j] * deviation[j]
    for i in range(inputs):
        action[i] = limit[i] * math.tanh(action[i])
    return deviation, modelling, action, exhausted


@cached_njit(error_model="numpy", boundscheck=False)
def predict_nominal(
    k: int, a: FloatArray, b: FloatArray, state: FloatArray, inputs: FloatArray, n: int
) -> FloatArray:
    """Return the first `n` entries of A_k z + B_k u, (n,)."""
    result = np.zeros(n)
    for i in range(n):
        for j in range(state.size):
            result[i] += a[k, i, j] * state[j]
        for j in range(inputs.size):
            result[i] += b[k, i, j] * inputs[j]
    return result


@cached_njit(error_model="numpy", boundscheck=False)
def containment(
    k: int,
    inverse: FloatArray,
    ellipsoid: bool,
    rows: FloatArray,
    nominal: FloatArray,
    deviation: FloatArray,
) -> tuple[float, FloatArray]:
    """Return the gauge of the `deviation` (n,), and `rows` (T, r, n) of tick `k` on the nominal.

    `inverse` (n, n) is that of the axes of a disturbance set, see `DisturbanceSet.gauge`.
    """
    n = nominal.size
    energy = 0.0
    for i in range(n):
        along = 0.0
        for j in range(n):
            along += inverse[i, j] * deviation[j]
        energy = energy + along * along if ellipsoid else max(energy, along * along)
    errors = np.zeros(rows.shape[1])
    for i in range(errors.size):
        for j in range(n):
            errors[i] += rows[k, i, j] * nominal[j]
    return math.sqrt(energy), errors
