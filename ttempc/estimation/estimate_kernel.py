"""Covariance of an estimate from that of its augmented state, compiled."""

from __future__ import annotations

from ..jit import cached_njit
from ..types import FloatArray, State


@cached_njit()
def state_covariance(
    covariance: FloatArray,
    entries: tuple[int, int, int, int, int],
    slopes: tuple[float, float, float, float, float],
    unfollowed: FloatArray,
    result: FloatArray,
) -> None:
    """Write J P J' + diag(`unfollowed`) into `result` (7, 7), `covariance` P (22, 22).

    J picks the state (`State`) out of the augmented state, but for the speed, which depends on the
    five `entries` with the derivatives `slopes`.
    """
    speed = State.V
    for i in range(speed):
        for j in range(speed):
            result[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
    for i in range(speed):
        total = 0.0
        for n in range(len(entries)):
            total += slopes[n] * 0.5 * (covariance[entries[n], i] + covariance[i, entries[n]])
        result[speed, i] = result[i, speed] = total
    variance = 0.0
    for n in range(len(entries)):
        for m in range(len(entries)):
            variance += slopes[n] * slopes[m] * covariance[entries[n], entries[m]]
    result[speed, speed] = variance
    for i in range(len(unfollowed)):
        result[i, i] += unfollowed[i]
