"""Prediction and correction of the Kalman filter over the augmented state, compiled.

Arrays (4, ...) named `levels` hold a value and its derivatives by the factors of `NoiseScale`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray
from .augmented_state import DISTURBANCE_BOUND, SIZE, STATES, AugmentedState
from .augmented_state_kernel import (
    SensorIndex,
    VehicleParameter,
    advance_augmented_state,
    measure,
)
from .noise import SCALE_RANGE, SCALES

_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())
_LEVELS: Final = 1 + SCALES

_MOST_STEP: Final = 0.5  # of the logarithm of a factor at one sample; assumed


@cached_njit()
def process_noise(
    middle: FloatArray,
    scales: FloatArray,
    parameters: FloatArray,
    rates: FloatArray,
    step_s: float,
    levels: FloatArray,
) -> None:
    """Write the covariance that a step of `step_s` gathers into `levels` (4, 18, 18).

    The same as `ProcessNoise.density` times the step, at the augmented state `middle` (18,).
    `scales` (2, 3), `parameters` (10,) and `rates` (2, 4, 18) are as in `predict`.
    """
    travel = abs(middle[AugmentedState.RIM]) * step_s
    psi_t = middle[AugmentedState.PSI_T]
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    drawbar = parameters[VehicleParameter.DRAWBAR_LENGTH] * math.cos(middle[AugmentedState.DELTA_I])
    swing = -drawbar / (parameters[VehicleParameter.TRAILER_LENGTH] + drawbar)
    levels[:, :, :] = 0.0
    for level in range(_LEVELS):
        for i in range(SIZE):
            levels[level, i, i] = step_s * rates[0, level, i] + travel * rates[1, level, i]
        forward, lateral = levels[level, 0, 0], levels[level, 1, 1]
        levels[level, 0, 0] = forward * cos * cos + lateral * sin * sin
        levels[level, 1, 1] = forward * sin * sin + lateral * cos * cos
        levels[level, 0, 1] = levels[level, 1, 0] = (forward - lateral) * cos * sin
        joint = levels[level, AugmentedState.DELTA_I, AugmentedState.DELTA_I]
        levels[level, AugmentedState.PSI_I, AugmentedState.PSI_I] += swing * swing * joint
        levels[level, AugmentedState.PSI_I, AugmentedState.DELTA_I] = swing * joint
        levels[level, AugmentedState.DELTA_I, AugmentedState.PSI_I] = swing * joint
    for n in range(SCALES):
        levels[0] += scales[0, n] * levels[1 + n]


@cached_njit()
def _propagate(matrix: FloatArray, transition: FloatArray, half: FloatArray) -> None:
    """Replace M by Phi (M + N) Phi' + N; `matrix` M, `transition` Phi, `half` N are (18, 18).

    The lower rows of Phi are diagonal, those of N too.
    """
    product = np.zeros((STATES, SIZE))  # upper rows of Phi (M + N)
    columns = np.empty((SIZE, STATES))  # of the upper rows of Phi
    for i in range(SIZE):
        for j in range(SIZE):
            matrix[i, j] += half[i, j]
        for j in range(STATES):
            columns[i, j] = transition[j, i]
    for i in range(STATES):
        for k in range(SIZE):  # innermost along rows, so that it becomes vector instructions
            for j in range(SIZE):
                product[i, j] += transition[i, k] * matrix[k, j]
    row = np.empty(STATES)
    for i in range(STATES):
        for j in range(STATES):
            row[j] = half[i, j]
        for k in range(SIZE):
            for j in range(STATES):
                row[j] += product[i, k] * columns[k, j]
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = row[j]
        for j in range(STATES, SIZE):
            matrix[i, j] = matrix[j, i] = product[i, j] * transition[j, j]
    for i in range(STATES, SIZE):
        for j in range(STATES, SIZE):
            matrix[i, j] *= transition[i, i] * transition[j, j]
        matrix[i, i] += half[i, i]


@cached_njit()
def predict(
    augmented: FloatArray,
    covariances: FloatArray,
    scales: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    parameters: FloatArray,
    rates: FloatArray,
    fading: FloatArray,
    walk: float,
    span_s: float,
    steps: int,
) -> None:
    """Advance a filter by `span_s` in `steps` equal steps under the held `command` (3,), in place.

    `augmented` (4, 18) and `covariances` (4, 18, 18) hold values and derivatives; `scales` (2, 3)
    the factors of `NoiseScale` and the information on their logarithms; `valves` (2,) are set
    points [rad], `parameters` (10,) those of the vehicle, `rates` (2, 4, 18) and `fading` (2, 11)
    those of `ProcessNoise`, `walk` the variance that a metre adds to the logarithms. With Q the
    noise of a step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q acts before the step, half after it.
    """
    transition = np.empty((SIZE, SIZE))
    gathered = np.empty((_LEVELS, SIZE, SIZE))
    middle, derivative = np.empty(SIZE), np.empty(SIZE)
    step_s = span_s / steps
    for _ in range(steps):
        middle[:] = augmented[0]
        advance_augmented_state(
            augmented[0], valves, command, parameters, fading, step_s, transition
        )
        for i in range(STATES):
            middle[i] = 0.5 * (middle[i] + augmented[0, i])
        process_noise(middle, scales, parameters, rates, step_s, gathered)
        for level in range(_LEVELS):
            for i in range(SIZE):
                for j in range(SIZE):
                    gathered[level, i, j] *= 0.5
            _propagate(covariances[level], transition, gathered[level])
        for level in range(1, _LEVELS):
            derivative[:] = augmented[level]
            for i in range(SIZE):
                total = 0.0
                for j in range(SIZE):
                    total += transition[i, j] * derivative[j]
                augmented[level, i] = total
        gained = walk * abs(middle[AugmentedState.RIM]) * step_s
        for n in range(SCALES):
            scales[1, n] = scales[1, n] / (1.0 + scales[1, n] * gained)


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
    parameters: FloatArray,
) -> tuple[float, float, float, float]:
    """Correct a filter by one sample in place and return its innovation nu, normalised.

    With S = L L' the covariance of nu, that is nu' S^-1 nu, log det S and the two entries of
    L^-1 nu, of which a sample of one number has the first.

    `sensor` is a `SensorIndex` as a number, `value` the sample (the second entry unused where it
    has one), `variance` that of each entry. A sample beyond the `gate` (chi-square) changes nothing
    unless it is `forced`: then its noise is raised until it just passes. The update has Joseph's
    form, see `_reduce`; disturbances are clipped to their bounds. The likelihood of the sample
    updates the factors, see `_learn`.
    """
    x = augmented[0]
    reading, jacobian = np.zeros(2), np.empty((2, SIZE))
    m = measure(sensor, x, parameters, reading, jacobian)
    nu = np.zeros((_LEVELS, 2))  # innovation and its derivatives
    for r in range(m):
        nu[0, r] = value[r] - reading[r]
    if (
        sensor == SensorIndex.STEERING_TRACTOR
        or sensor == SensorIndex.STEERING_TRAILER
        or sensor == SensorIndex.HITCH
    ):
        nu[0, 0] -= 2.0 * math.pi * round(nu[0, 0] / (2.0 * math.pi))
    cross = np.zeros((_LEVELS, 2, SIZE))  # H P and its derivatives: rows become vectors
    spread = np.zeros((_LEVELS, 2, 2))  # S = H P H' + R and its derivatives
    for level in range(_LEVELS):
        for r in range(m):
            for k in range(SIZE):
                if jacobian[r, k] != 0.0:
                    for i in range(SIZE):
                        cross[level, r, i] += covariances[level, k, i] * jacobian[r, k]
        for r in range(m):
            for c in range(m):
                for k in range(SIZE):
                    spread[level, r, c] += jacobian[r, k] * cross[level, c, k]
    for r in range(m):
        spread[0, r, r] += variance
    precision = np.zeros((2, 2))
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
    weighted = np.zeros(2)  # S^-1 nu
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
            for k in range(SIZE):
                nu[level, r] -= jacobian[r, k] * augmented[level, k]
    if factor == 1.0:
        for n in range(SCALES):
            _learn(scales[:, n], SCALE_RANGE[n], precision, spread[1 + n], weighted, nu[1 + n], m)
    gain, gain_derivative = np.zeros((2, SIZE)), np.zeros((2, SIZE))
    for r in range(m):
        for c in range(m):
            for i in range(SIZE):
                gain[r, i] += cross[0, c, i] * (precision[c, r] / factor)
        for i in range(SIZE):
            x[i] += gain[r, i] * nu[0, r]
    for i in range(STATES, SIZE):
        x[i] = min(max(x[i], -_BOUND[i - STATES]), _BOUND[i - STATES])
    workspace = np.empty((2, SIZE))
    for level in range(1, _LEVELS):
        gain_derivative[:, :] = 0.0
        for c in range(m):
            rest = workspace[0]
            for i in range(SIZE):
                rest[i] = cross[level, c, i]
                for q in range(m):
                    rest[i] -= gain[q, i] * spread[level, q, c]
            for r in range(m):
                for i in range(SIZE):
                    gain_derivative[r, i] += rest[i] * (precision[c, r] / factor)
        for r in range(m):
            for i in range(SIZE):
                augmented[level, i] += gain[r, i] * nu[level, r] + gain_derivative[r, i] * nu[0, r]
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
    """Replace M (18, 18) by (I - K H) M (I - K H)' + K R K', written as M + K W' + W K'.

    `gain` K' (2, 18), `cross` C' = H M (2, 18), `spread` S = H M H' + R (2, 2), W = K S / 2 - C,
    written into `half` W' (2, 18). The sum is symmetric, and right for any K. Of the two
    measurements the first `m` are used.
    """
    for r in range(m):
        for i in range(SIZE):
            half[r, i] = -cross[r, i]
        for c in range(m):
            for i in range(SIZE):
                half[r, i] += 0.5 * gain[c, i] * spread[c, r]
    for i in range(SIZE):
        for r in range(m):
            for j in range(SIZE):
                matrix[i, j] += gain[r, i] * half[r, j] + half[r, i] * gain[r, j]
