"""The two steps of a filter over a belief, compiled: predict and correct.

A test holds them to a filter written plainly. numba's cache looks at this file alone: whoever
changes `augmented_state` or `augmented_state_kernel` deletes `ttempc/__pycache__`.
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np

from ..types import FloatArray
from .augmented_state import LARGEST, LEAST_ROUGHNESS, MOST_ROUGHNESS, SIZE, STATES
from .augmented_state_kernel import advance_belief, expect

_N: Final = STATES
_ALL: Final = SIZE
_LARGEST: Final = tuple(LARGEST.tolist())
_LEAST_ROUGHNESS: Final = LEAST_ROUGHNESS
_MOST_ROUGHNESS: Final = MOST_ROUGHNESS


@numba.njit(cache=True)
def noise_of(
    belief: FloatArray,
    roughness: float,
    noise: FloatArray,
    step_s: float,
    gathered: FloatArray,
) -> None:
    """Write what a step adds to covariance and slope, (2, 16, 16): `ProcessNoise.density`."""
    travel = abs(belief[6]) * step_s
    cos, sin = math.cos(belief[2]), math.sin(belief[2])
    forward, lateral = noise[0] * travel, noise[1] * travel
    gathered[:, :, :] = 0.0
    by_roughness = gathered[1]
    by_roughness[0, 0] = forward * cos * cos + lateral * sin * sin
    by_roughness[1, 1] = forward * sin * sin + lateral * cos * cos
    by_roughness[0, 1] = by_roughness[1, 0] = (forward - lateral) * cos * sin
    by_roughness[2, 2], by_roughness[3, 3] = noise[2] * travel, noise[3] * travel
    gathered[0] = roughness * by_roughness
    for i in range(4, _ALL):
        over_time = i <= 6 or i == 10
        gathered[0, i, i] = noise[i] * (step_s if over_time else travel)


@numba.njit(cache=True)
def _carry(matrix: FloatArray, transition: FloatArray, half: FloatArray) -> None:
    """Put Phi (M + N) Phi' + N in the place of M; all of them (16, 16)."""
    product = np.zeros((_ALL, _ALL))  # Phi (M + N); the lower rows of Phi are diagonal
    columns = np.empty((_ALL, _N))  # Phi' but for its diagonal part
    for i in range(_ALL):
        for j in range(_ALL):
            matrix[i, j] += half[i, j]
        for j in range(_N):
            columns[i, j] = transition[j, i]
    for i in range(_N):
        for k in range(_ALL):  # innermost along rows, so that it becomes vector instructions
            for j in range(_ALL):
                product[i, j] += transition[i, k] * matrix[k, j]
    for i in range(_N, _ALL):
        for j in range(_ALL):
            product[i, j] = transition[i, i] * matrix[i, j]
    row = np.empty(_ALL)
    for i in range(_ALL):
        row[:] = half[i]
        for k in range(_ALL):
            for j in range(_N):
                row[j] += product[i, k] * columns[k, j]
        for j in range(_N, _ALL):
            row[j] += product[i, j] * transition[j, j]
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = row[j]


@numba.njit(cache=True)
def predict(
    beliefs: FloatArray,
    covariances: FloatArray,
    roughness: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    table: FloatArray,
    noise: FloatArray,
    memory: FloatArray,
    span_s: float,
    steps: int,
) -> None:
    """Run a filter on by `span_s` under the held `command` (3,), all in place.

    `beliefs` (2, 16) and `covariances` (2, 16, 16) hold the values, then their slopes by the
    roughness r; `roughness` (2,) is r and its precision. With Q the noise of a step,
    P <- Phi (P + Q/2) Phi' + Q/2: half of it came before the step, half comes after.
    """
    transition = np.empty((_ALL, _ALL))
    gathered = np.empty((2, _ALL, _ALL))
    middle, slope = np.empty(_ALL), np.empty(_ALL)
    step_s = span_s / steps
    for _ in range(steps):
        middle[:] = beliefs[0]
        advance_belief(beliefs[0], valves, command, table, memory, step_s, transition)
        for i in range(_N):
            middle[i] = 0.5 * (middle[i] + beliefs[0, i])
        noise_of(middle, roughness[0], noise, step_s, gathered)
        for level in range(2):
            for i in range(_ALL):
                for j in range(_ALL):
                    gathered[level, i, j] *= 0.5
            _carry(covariances[level], transition, gathered[level])
        slope[:] = beliefs[1]
        for i in range(_ALL):
            total = 0.0
            for j in range(_ALL):
                total += transition[i, j] * slope[j]
            beliefs[1, i] = total
        walked = noise[_ALL] * abs(middle[6]) * step_s
        roughness[1] = roughness[1] / (1.0 + roughness[1] * walked)


@numba.njit(cache=True)
def correct(
    beliefs: FloatArray,
    covariances: FloatArray,
    roughness: FloatArray,
    sensor: int,
    value: tuple[float, float],
    variance: float,
    gate: float,
    forced: bool,
    table: FloatArray,
) -> float:
    """Take one sample in, in place, and return its normalised innovation squared.

    A sample beyond the `gate` changes nothing unless it is `forced` in: then with its noise
    raised until it just passes. Joseph's form, P <- (I - K H) P (I - K H)' + K R K'; disturbances
    stay within their bounds. The sample's likelihood moves the roughness, see `_learn`.
    """
    belief, covariance = beliefs[0], covariances[0]
    reading, by_belief = np.zeros(2), np.empty((2, _ALL))
    m = expect(sensor, belief, table, reading, by_belief)
    difference = np.zeros(2)
    for r in range(m):
        difference[r] = value[r] - reading[r]
    if sensor == 2 or sensor == 3 or sensor == 4:
        difference[0] -= 2.0 * math.pi * round(difference[0] / (2.0 * math.pi))
    cross = np.zeros((2, _ALL, 2))  # P H' and its slope
    spread = np.zeros((2, 2, 2))  # S = H P H' + R and its slope
    for level in range(2):
        for r in range(m):
            for i in range(_ALL):
                for k in range(_N):  # sensors read the state alone
                    cross[level, i, r] += covariances[level, i, k] * by_belief[r, k]
        for r in range(m):
            for c in range(m):
                for k in range(_N):
                    spread[level, r, c] += by_belief[r, k] * cross[level, k, c]
    for r in range(m):
        spread[0, r, r] += variance
    precision = np.zeros((2, 2))
    if m == 1:
        precision[0, 0] = 1.0 / spread[0, 0, 0]
    else:
        determinant = spread[0, 0, 0] * spread[0, 1, 1] - spread[0, 0, 1] * spread[0, 1, 0]
        precision[0, 0] = spread[0, 1, 1] / determinant
        precision[1, 1] = spread[0, 0, 0] / determinant
        precision[0, 1] = precision[1, 0] = -spread[0, 0, 1] / determinant
    weighed = np.zeros(2)  # S^-1 nu
    normalised = 0.0
    for r in range(m):
        for c in range(m):
            weighed[r] += precision[r, c] * difference[c]
        normalised += weighed[r] * difference[r]
    raised = 1.0  # S is raised by this factor, all of it noise
    if not normalised <= gate:
        if not forced:
            return normalised
        raised = normalised / gate
    moved = np.zeros(2)  # d nu / d r
    for r in range(m):
        for k in range(_N):
            moved[r] -= by_belief[r, k] * beliefs[1, k]
    if raised == 1.0:
        _learn(roughness, precision, spread[1], weighed, moved, m)
    gain, gain_slope = np.zeros((_ALL, 2)), np.zeros((_ALL, 2))
    for i in range(_ALL):
        for r in range(m):
            for c in range(m):
                gain[i, r] += cross[0, i, c] * precision[c, r] / raised
        for r in range(m):
            for c in range(m):
                rest = cross[1, i, c]
                for q in range(m):
                    rest -= gain[i, q] * spread[1, q, c]
                gain_slope[i, r] += rest * precision[c, r] / raised
    for i in range(_ALL):
        for r in range(m):
            belief[i] += gain[i, r] * difference[r]
            beliefs[1, i] += gain[i, r] * moved[r] + gain_slope[i, r] * difference[r]
        if i >= _N:
            belief[i] = min(max(belief[i], -_LARGEST[i - _N]), _LARGEST[i - _N])
    noise = np.zeros((2, 2))
    for r in range(m):
        for c in range(m):
            noise[r, c] = (raised - 1.0) * spread[0, r, c] + (variance if r == c else 0.0)
    _joseph(covariance, gain, cross[0], by_belief, noise, m)
    _joseph(covariances[1], gain, cross[1], by_belief, np.zeros((2, 2)), m)
    return normalised


@numba.njit(cache=True)
def _learn(
    roughness: FloatArray,
    precision: FloatArray,
    spread_slope: FloatArray,
    weighed: FloatArray,
    moved: FloatArray,
    m: int,
) -> None:
    """Move the roughness by a sample's score over the Fisher information gathered, in place.

    For nu ~ N(0, S) with slopes dS and dnu by r: score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2
    - nu' S^-1 dnu, information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu (Astrom 1980).
    """
    score, information = 0.0, 0.0
    shaped = np.zeros((2, 2))  # S^-1 dS
    for r in range(m):
        for c in range(m):
            score += 0.5 * weighed[r] * spread_slope[r, c] * weighed[c]
            information += moved[r] * precision[r, c] * moved[c]
            for q in range(m):
                shaped[r, c] += precision[r, q] * spread_slope[q, c]
        score -= weighed[r] * moved[r]
    for r in range(m):
        score -= 0.5 * shaped[r, r]
        for c in range(m):
            information += 0.5 * shaped[r, c] * shaped[c, r]
    roughness[1] += information
    roughness[0] += score / roughness[1]
    roughness[0] = min(max(roughness[0], _LEAST_ROUGHNESS), _MOST_ROUGHNESS)


@numba.njit(cache=True)
def _joseph(
    matrix: FloatArray,
    gain: FloatArray,
    cross: FloatArray,
    by_belief: FloatArray,
    noise: FloatArray,
    m: int,
) -> None:
    """Put (I - K H) M (I - K H)' + K R K' in the place of M (16, 16), whose M H' is `cross`."""
    kept = np.empty((_ALL, _ALL))  # (I - K H) M
    for i in range(_ALL):
        for j in range(_ALL):
            total = matrix[i, j]
            for r in range(m):
                total -= gain[i, r] * cross[j, r]
            kept[i, j] = total
    back = np.empty(2)  # K R - (I - K H) M H', a row
    for i in range(_ALL):
        for r in range(m):
            total = 0.0
            for c in range(m):
                total += gain[i, c] * noise[c, r]
            for k in range(_N):
                total -= kept[i, k] * by_belief[r, k]
            back[r] = total
        for j in range(i + 1):
            total = kept[i, j]
            for r in range(m):
                total += back[r] * gain[j, r]
            matrix[i, j] = matrix[j, i] = total
