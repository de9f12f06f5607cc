"""Correction of the Kalman filter over the augmented state by one sample, compiled.

Arrays (4, ...) named `levels` hold a value and its derivatives by the factors of `NoiseScale`.
"""

from __future__ import annotations

import math
from typing import Final

from ..jit import cached_njit
from ..types import FloatArray
from .augmented_state import DISTURBANCE_BOUND, STATES
from .augmented_state_kernel import SensorIndex, measure
from .noise import SCALE_RANGE, SCALES

_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())
_LEVELS: Final = 1 + SCALES

_MOST_STEP: Final = 0.5  # of the logarithm of a factor at one sample; assumed


@cached_njit()
def correct(
    augmented: FloatArray,
    covariances: FloatArray,
    scales: FloatArray,
    sensor: int,
    value: tuple[float, float],
    variance: float,
    gate: float,
    forced: bool,
    learns: bool,
    parameters: FloatArray,
    rows: FloatArray,
    pairs: FloatArray,
) -> tuple[float, float, float, float]:
    """Correct a filter by one sample in place and return its innovation nu, normalised.

    With S = L L' the covariance of nu, that is nu' S^-1 nu, log det S and the two entries of
    L^-1 nu, of which a sample of one number has the first.

    `sensor` is a `SensorIndex` as a number, `value` the sample (of a gyro, the angle turned since
    its last sample and the time since then), `variance` that of each entry. A sample beyond the
    `gate` (chi-square) changes nothing unless it is `forced`: then its noise is raised until it
    just passes. The update has Joseph's form, see `_reduce`; disturbances are clipped to their
    bounds. If it `learns`, the likelihood of the sample updates the factors, see `_learn`. `rows`
    (8, 2, 22) and `pairs` (16, 2) are workspace.
    """
    size = augmented.shape[1]  # no constant: loops over one are unrolled before they can be vector
    # instructions
    jacobian, cross = rows[0], rows[1:5]  # cross: H P and its derivatives, rows become vectors
    gain, gain_derivative, workspace = rows[5], rows[6], rows[7]
    for n in range(len(rows)):
        for i in range(size):
            rows[n, 0, i] = rows[n, 1, i] = 0.0
    for n in range(len(pairs)):
        pairs[n, 0] = pairs[n, 1] = 0.0
    reading, weighted = pairs[0], pairs[1]  # weighted: S^-1 nu
    precision, nu = pairs[2:4], pairs[4:8]  # nu: innovation and its derivatives
    spread = pairs[8:16].reshape((_LEVELS, 2, 2))  # S = H P H' + R and its derivatives
    x = augmented[0]
    m = measure(sensor, x, parameters, value[1], reading, jacobian)
    for r in range(m):
        nu[0, r] = value[r] - reading[r]
    if (
        sensor == SensorIndex.STEERING_TRACTOR
        or sensor == SensorIndex.STEERING_TRAILER
        or sensor == SensorIndex.HITCH
    ):
        nu[0, 0] -= 2.0 * math.pi * round(nu[0, 0] / (2.0 * math.pi))
    for level in range(_LEVELS):
        for r in range(m):
            for k in range(size):
                weight = jacobian[r, k]
                if weight != 0.0:
                    for i in range(size):
                        cross[level, r, i] += covariances[level, k, i] * weight
        for r in range(m):
            for c in range(m):
                for k in range(size):
                    spread[level, r, c] += jacobian[r, k] * cross[level, c, k]
    for r in range(m):
        spread[0, r, r] += variance
    root = math.sqrt(spread[0, 0, 0])
    first, second, determinant = nu[0, 0] / root, 0.0, spread[0, 0, 0]
    if m == 1:
        precision[0, 0] = 1.0 / determinant
    else:
        determinant = spread[0, 0, 0] * spread[0, 1, 1] - spread[0, 0, 1] * spread[0, 1, 0]
        precision[0, 0] = spread[0, 1, 1] / determinant
        precision[1, 1] = spread[0, 0, 0] / determinant
        precision[0, 1] = precision[1, 0] = -spread[0, 0, 1] / determinant
        second = (nu[0, 1] - spread[0, 1, 0] / root * first) * root / math.sqrt(determinant)
    normalised = 0.0
    for r in range(m):
        for c in range(m):
            weighted[r] += precision[r, c] * nu[0, c]
        normalised += weighted[r] * nu[0, r]
    result = normalised, math.log(determinant), first, second
    factor = 1.0  # by which S is raised, all of it through the noise
    if not normalised <= gate:
        if not forced:
            return result
        factor = normalised / gate
    for level in range(1, _LEVELS):
        for r in range(m):
            for k in range(size):
                nu[level, r] -= jacobian[r, k] * augmented[level, k]
    if factor == 1.0 and learns:
        for n in range(SCALES):
            _learn(scales[:, n], SCALE_RANGE[n], precision, spread[1 + n], weighted, nu[1 + n], m)
    for r in range(m):
        for c in range(m):
            weight = precision[c, r] / factor
            for i in range(size):
                gain[r, i] += cross[0, c, i] * weight
        for i in range(size):
            x[i] += gain[r, i] * nu[0, r]
    for i in range(STATES, size):
        x[i] = min(max(x[i], -_BOUND[i - STATES]), _BOUND[i - STATES])
    for level in range(1, _LEVELS):
        for i in range(size):
            gain_derivative[0, i] = gain_derivative[1, i] = 0.0
        for c in range(m):
            rest = workspace[0]
            for i in range(size):
                rest[i] = cross[level, c, i]
            for q in range(m):
                weight = spread[level, q, c]
                for i in range(size):
                    rest[i] -= gain[q, i] * weight
            for r in range(m):
                weight = precision[c, r] / factor
                for i in range(size):
                    gain_derivative[r, i] += rest[i] * weight
        for r in range(m):
            by_gain, by_derivative = nu[level, r], nu[0, r]
            for i in range(size):
                augmented[level, i] += gain[r, i] * by_gain + gain_derivative[r, i] * by_derivative
        _reduce(covariances[level], gain, cross[level], spread[level], m, workspace)
    for r in range(m):
        for c in range(m):
            spread[0, r, c] *= factor
    _reduce(covariances[0], gain, cross[0], spread[0], m, workspace)
    return result


@cached_njit()
def _learn(
    scale: FloatArray,
    allowed: tuple[float, float],
    precision: FloatArray,
    spread_derivative: FloatArray,
    weighted: FloatArray,
    innovation_derivative: FloatArray,
    m: int,
) -> None:
    """Update a factor s and the information I on its logarithm, `scale` (2,), by a sample.

    For nu ~ N(0, S) with derivatives dS and dnu by s (Astrom 1980),

        score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2 - nu' S^-1 dnu
        information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu,

    s^2 times this information is gathered in I, and s <- s (1 + s score / I), within the range
    `allowed`.
    """
    score, information = 0.0, 0.0
    for r in range(m):
        score -= weighted[r] * innovation_derivative[r]
        for c in range(m):
            score += 0.5 * weighted[r] * spread_derivative[r, c] * weighted[c]
            information += innovation_derivative[r] * precision[r, c] * innovation_derivative[c]
            one, other = 0.0, 0.0  # S^-1 dS at (r, c) and (c, r)
            for q in range(m):
                one += precision[r, q] * spread_derivative[q, c]
                other += precision[c, q] * spread_derivative[q, r]
            information += 0.5 * one * other
            if r == c:
                score -= 0.5 * one
    scale[1] += scale[0] * scale[0] * information
    step = min(max(scale[0] * score / scale[1], -_MOST_STEP), _MOST_STEP)
    scale[0] = min(max(scale[0] * (1.0 + step), allowed[0]), allowed[1])


@cached_njit()
def _reduce(
    matrix: FloatArray,
    gain: FloatArray,
    cross: FloatArray,
    spread: FloatArray,
    m: int,
    half: FloatArray,
) -> None:
    """Replace M (22, 22) by (I - K H) M (I - K H)' + K R K', written as M + K W' + W K'.

    `gain` K' (2, 22), `cross` C' = H M (2, 22), `spread` S = H M H' + R (2, 2), W = K S / 2 - C,
    written into `half` W' (2, 22). The sum is symmetric, and right for any K. Of the two
    measurements the first `m` are used.
    """
    size = len(matrix)
    for r in range(m):
        for i in range(size):
            half[r, i] = -cross[r, i]
        for c in range(m):
            for i in range(size):
                half[r, i] += 0.5 * gain[c, i] * spread[c, r]
    for i in range(size):
        for r in range(m):
            by_gain, by_half = gain[r, i], half[r, i]  # for the compiler: `matrix` is not they
            for j in range(size):
                matrix[i, j] += by_gain * half[r, j] + by_half * gain[r, j]
