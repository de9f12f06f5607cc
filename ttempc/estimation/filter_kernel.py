"""Prediction and correction of the Kalman filter over the augmented state, compiled.

Arrays (2, ...) hold a value and its derivative by the roughness r of the ground.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray
from .augmented_state import (
    DISTURBANCE_BOUND,
    LEAST_ROUGHNESS,
    MOST_ROUGHNESS,
    SIZE,
    STATES,
    AugmentedState,
)
from .augmented_state_kernel import SensorIndex, advance_augmented_state, measure

_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())
_ROUGHNESS_WALK: Final = SIZE  # index of the roughness in `ProcessNoise.variances`


@cached_njit()
def process_noise(
    middle: FloatArray,
    roughness: float,
    variances: FloatArray,
    step_s: float,
    covariances: FloatArray,
) -> None:
    """Write the covariance that a step of `step_s` gathers, and its derivative, (2, 16, 16).

    The same as `ProcessNoise.density` times the step, at the augmented state `middle` (16,).
    """
    travel = abs(middle[AugmentedState.RIM]) * step_s
    psi_t = middle[AugmentedState.PSI_T]
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    forward = variances[AugmentedState.X] * travel
    lateral = variances[AugmentedState.Y] * travel
    covariances[:, :, :] = 0.0
    derivative = covariances[1]
    derivative[0, 0] = forward * cos * cos + lateral * sin * sin
    derivative[1, 1] = forward * sin * sin + lateral * cos * cos
    derivative[0, 1] = derivative[1, 0] = (forward - lateral) * cos * sin
    for i in range(AugmentedState.PSI_T, AugmentedState.DELTA_T):
        derivative[i, i] = variances[i] * travel
    covariances[0] = roughness * derivative
    for i in range(AugmentedState.DELTA_T, SIZE):
        over_time = i <= AugmentedState.RIM or i == AugmentedState.DRIVE
        covariances[0, i, i] = variances[i] * (step_s if over_time else travel)


@cached_njit()
def _propagate(matrix: FloatArray, transition: FloatArray, half: FloatArray) -> None:
    """Replace M by Phi (M + N) Phi' + N; `matrix` M, `transition` Phi, `half` N are (16, 16)."""
    product = np.zeros((SIZE, SIZE))  # Phi (M + N); the lower rows of Phi are diagonal
    columns = np.empty((SIZE, STATES))  # Phi' but for its diagonal part
    for i in range(SIZE):
        for j in range(SIZE):
            matrix[i, j] += half[i, j]
        for j in range(STATES):
            columns[i, j] = transition[j, i]
    for i in range(STATES):
        for k in range(SIZE):  # innermost along rows, so that it becomes vector instructions
            for j in range(SIZE):
                product[i, j] += transition[i, k] * matrix[k, j]
    for i in range(STATES, SIZE):
        for j in range(SIZE):
            product[i, j] = transition[i, i] * matrix[i, j]
    row = np.empty(SIZE)
    for i in range(SIZE):
        row[:] = half[i]
        for k in range(SIZE):
            for j in range(STATES):
                row[j] += product[i, k] * columns[k, j]
        for j in range(STATES, SIZE):
            row[j] += product[i, j] * transition[j, j]
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = row[j]


@cached_njit()
def predict(
    augmented: FloatArray,
    covariances: FloatArray,
    roughness: FloatArray,
    valves: FloatArray,
    command: FloatArray,
    parameters: FloatArray,
    variances: FloatArray,
    fading_m: FloatArray,
    span_s: float,
    steps: int,
) -> None:
    """Advance a filter by `span_s` in `steps` equal steps under the held `command` (3,), in place.

    `augmented` (2, 16) and `covariances` (2, 16, 16) hold values and derivatives; `roughness` (2,)
    is r and its precision, `valves` (2,) are set points [rad], `parameters` (10,) those of the
    vehicle, `variances` (17,) and `fading_m` (9,) those of `ProcessNoise`. With Q the noise of a
    step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q acts before the step, half after it.
    """
    transition = np.empty((SIZE, SIZE))
    gathered = np.empty((2, SIZE, SIZE))
    middle, derivative = np.empty(SIZE), np.empty(SIZE)
    step_s = span_s / steps
    for _ in range(steps):
        middle[:] = augmented[0]
        advance_augmented_state(
            augmented[0], valves, command, parameters, fading_m, step_s, transition
        )
        for i in range(STATES):
            middle[i] = 0.5 * (middle[i] + augmented[0, i])
        process_noise(middle, roughness[0], variances, step_s, gathered)
        for level in range(2):
            for i in range(SIZE):
                for j in range(SIZE):
                    gathered[level, i, j] *= 0.5
            _propagate(covariances[level], transition, gathered[level])
        derivative[:] = augmented[1]
        for i in range(SIZE):
            total = 0.0
            for j in range(SIZE):
                total += transition[i, j] * derivative[j]
            augmented[1, i] = total
        walk = variances[_ROUGHNESS_WALK] * abs(middle[AugmentedState.RIM]) * step_s
        roughness[1] = roughness[1] / (1.0 + roughness[1] * walk)


@cached_njit()
def correct(
    augmented: FloatArray,
    covariances: FloatArray,
    roughness: FloatArray,
    sensor: int,
    value: tuple[float, float],
    variance: float,
    gate: float,
    forced: bool,
    parameters: FloatArray,
) -> float:
    """Correct a filter by one sample in place and return its normalised innovation squared.

    `sensor` is a `SensorIndex` as a number, `value` the sample (the second entry unused where it
    has one), `variance` that of each entry. A sample beyond the `gate` (chi-square) changes nothing
    unless it is `forced`: then its noise is raised until it just passes. The update has Joseph's
    form, P <- (I - K H) P (I - K H)' + K R K'; disturbances are clipped to their bounds. The
    likelihood of the sample updates the roughness, see `_update_roughness`.
    """
    x, covariance = augmented[0], covariances[0]
    reading, jacobian = np.zeros(2), np.empty((2, SIZE))
    m = measure(sensor, x, parameters, reading, jacobian)
    innovation = np.zeros(2)
    for r in range(m):
        innovation[r] = value[r] - reading[r]
    if (
        sensor == SensorIndex.STEERING_TRACTOR
        or sensor == SensorIndex.STEERING_TRAILER
        or sensor == SensorIndex.HITCH
    ):
        innovation[0] -= 2.0 * math.pi * round(innovation[0] / (2.0 * math.pi))
    cross = np.zeros((2, SIZE, 2))  # P H' and its derivative
    spread = np.zeros((2, 2, 2))  # S = H P H' + R and its derivative
    for level in range(2):
        for r in range(m):
            for i in range(SIZE):
                for k in range(STATES):  # sensors read the state alone
                    cross[level, i, r] += covariances[level, i, k] * jacobian[r, k]
        for r in range(m):
            for c in range(m):
                for k in range(STATES):
                    spread[level, r, c] += jacobian[r, k] * cross[level, k, c]
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
    weighted = np.zeros(2)  # S^-1 nu
    normalised = 0.0
    for r in range(m):
        for c in range(m):
            weighted[r] += precision[r, c] * innovation[c]
        normalised += weighted[r] * innovation[r]
    factor = 1.0  # by which S is raised, all of it through the noise
    if not normalised <= gate:
        if not forced:
            return normalised
        factor = normalised / gate
    innovation_derivative = np.zeros(2)  # d nu / d r
    for r in range(m):
        for k in range(STATES):
            innovation_derivative[r] -= jacobian[r, k] * augmented[1, k]
    if factor == 1.0:
        _update_roughness(roughness, precision, spread[1], weighted, innovation_derivative, m)
    gain, gain_derivative = np.zeros((SIZE, 2)), np.zeros((SIZE, 2))
    for i in range(SIZE):
        for r in range(m):
            for c in range(m):
                gain[i, r] += cross[0, i, c] * precision[c, r] / factor
        for r in range(m):
            for c in range(m):
                rest = cross[1, i, c]
                for q in range(m):
                    rest -= gain[i, q] * spread[1, q, c]
                gain_derivative[i, r] += rest * precision[c, r] / factor
    for i in range(SIZE):
        for r in range(m):
            x[i] += gain[i, r] * innovation[r]
            augmented[1, i] += (
                gain[i, r] * innovation_derivative[r] + gain_derivative[i, r] * innovation[r]
            )
        if i >= STATES:
            x[i] = min(max(x[i], -_BOUND[i - STATES]), _BOUND[i - STATES])
    noise = np.zeros((2, 2))
    for r in range(m):
        for c in range(m):
            noise[r, c] = (factor - 1.0) * spread[0, r, c] + (variance if r == c else 0.0)
    _joseph(covariance, gain, cross[0], jacobian, noise, m)
    _joseph(covariances[1], gain, cross[1], jacobian, np.zeros((2, 2)), m)
    return normalised


@cached_njit()
def _update_roughness(
    roughness: FloatArray,
    precision: FloatArray,
    spread_derivative: FloatArray,
    weighted: FloatArray,
    innovation_derivative: FloatArray,
    m: int,
) -> None:
    """Update the roughness r by a sample's score over the Fisher information gathered, in place.

    For nu ~ N(0, S) with derivatives dS and dnu by r (Astrom 1980),

        score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2 - nu' S^-1 dnu
        information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu.
    """
    score, information = 0.0, 0.0
    relative = np.zeros((2, 2))  # S^-1 dS
    for r in range(m):
        for c in range(m):
            score += 0.5 * weighted[r] * spread_derivative[r, c] * weighted[c]
            information += innovation_derivative[r] * precision[r, c] * innovation_derivative[c]
            for q in range(m):
                relative[r, c] += precision[r, q] * spread_derivative[q, c]
        score -= weighted[r] * innovation_derivative[r]
    for r in range(m):
        score -= 0.5 * relative[r, r]
        for c in range(m):
            information += 0.5 * relative[r, c] * relative[c, r]
    roughness[1] += information
    roughness[0] += score / roughness[1]
    roughness[0] = min(max(roughness[0], LEAST_ROUGHNESS), MOST_ROUGHNESS)


@cached_njit()
def _joseph(
    matrix: FloatArray,
    gain: FloatArray,
    cross: FloatArray,
    jacobian: FloatArray,
    noise: FloatArray,
    m: int,
) -> None:
    """Replace M (16, 16) by (I - K H) M (I - K H)' + K R K'.

    `gain` K (16, 2), `cross` M H' (16, 2), `jacobian` H (2, 16), `noise` R (2, 2). Of the
    two measurements the first `m` are used.
    """
    reduced = np.empty((SIZE, SIZE))  # (I - K H) M
    for i in range(SIZE):
        for j in range(SIZE):
            total = matrix[i, j]
            for r in range(m):
                total -= gain[i, r] * cross[j, r]
            reduced[i, j] = total
    row = np.empty(2)  # K R - (I - K H) M H', a row
    for i in range(SIZE):
        for r in range(m):
            total = 0.0
            for c in range(m):
                total += gain[i, c] * noise[c, r]
            for k in range(STATES):
                total -= reduced[i, k] * jacobian[r, k]
            row[r] = total
        for j in range(i + 1):
            total = reduced[i, j]
            for r in range(m):
                total += row[r] * gain[j, r]
            matrix[i, j] = matrix[j, i] = total
