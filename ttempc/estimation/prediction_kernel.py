"""Prediction of the Kalman filter over the augmented state, compiled.

Arrays (4, ...) named `levels` hold a value and its derivatives by the factors of `NoiseScale`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray
from .augmented_state import SIZE, STATES, AugmentedState
from .augmented_state_kernel import VehicleParameter, advance_augmented_state
from .noise import SCALES

_LEVELS: Final = 1 + SCALES
_ENTRIES: Final = SIZE + 2  # of a covariance of `process_noise`
_XY: Final = SIZE
_JOINT: Final = SIZE + 1

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: four times the resolution of a double at Unix time [s]."""

_LONGEST_STEP_S: Final = 0.05  # a third of the front steering's lag


@cached_njit()
def steps_over(span_s: float) -> int:
    """Return the number of integration steps over a span of time [s], at least 1."""
    return max(1, math.ceil((span_s - SAME_TIME_S) / _LONGEST_STEP_S))


@cached_njit()
def process_noise(
    middle: FloatArray,
    scales: FloatArray,
    parameters: FloatArray,
    rates: FloatArray,
    step_s: float,
    levels: FloatArray,
) -> None:
    """Write the covariance that a step of `step_s` gathers into `levels` (4, 24).

    The same as `ProcessNoise.density` times the step, at the augmented state `middle` (22,): the
    diagonal, then the entries (x, y) and (psi_i, delta_i), the only others.
    `scales` (2, 3), `parameters` (10,) and `rates` (2, 4, 22) are as in `predict`.
    """
    travel = abs(middle[AugmentedState.RIM]) * step_s
    psi_t = middle[AugmentedState.PSI_T]
    cos, sin = math.cos(psi_t), math.sin(psi_t)
    drawbar = parameters[VehicleParameter.DRAWBAR_LENGTH] * math.cos(middle[AugmentedState.DELTA_I])
    swing = -drawbar / (parameters[VehicleParameter.TRAILER_LENGTH] + drawbar)
    for level in range(_LEVELS):
        for i in range(SIZE):
            levels[level, i] = step_s * rates[0, level, i] + travel * rates[1, level, i]
        forward, lateral = levels[level, 0], levels[level, 1]
        levels[level, 0] = forward * cos * cos + lateral * sin * sin
        levels[level, 1] = forward * sin * sin + lateral * cos * cos
        levels[level, _XY] = (forward - lateral) * cos * sin
        joint = levels[level, AugmentedState.DELTA_I]
        levels[level, AugmentedState.PSI_I] += swing * swing * joint
        levels[level, _JOINT] = swing * joint
    for n in range(SCALES):
        for i in range(_ENTRIES):
            levels[0, i] += scales[0, n] * levels[1 + n, i]


@cached_njit()
def _add_half(matrix: FloatArray, noise: FloatArray) -> None:
    """Add half a covariance of `process_noise` (24,) to `matrix` (22, 22)."""
    for i in range(SIZE):
        matrix[i, i] += 0.5 * noise[i]
    matrix[0, 1] += 0.5 * noise[_XY]
    matrix[1, 0] += 0.5 * noise[_XY]
    matrix[AugmentedState.PSI_I, AugmentedState.DELTA_I] += 0.5 * noise[_JOINT]
    matrix[AugmentedState.DELTA_I, AugmentedState.PSI_I] += 0.5 * noise[_JOINT]


@cached_njit()
def _propagate(
    matrix: FloatArray, transition: FloatArray, noise: FloatArray, workspace: FloatArray
) -> None:
    """Replace M by Phi (M + N) Phi' + N; `matrix` M, `transition` Phi are (22, 22).

    N is half of `noise` (24,). The lower rows of Phi are diagonal, most entries of its upper rows
    are 0. The upper rows of Phi (M + N) are written into `workspace` (7, 22).
    """
    size = len(matrix)  # no constant, see `correct`
    _add_half(matrix, noise)
    workspace[:, :] = 0.0
    for i in range(STATES):
        for k in range(size):  # innermost along rows, so that it becomes vector instructions
            weight = transition[i, k]
            if weight != 0.0:
                for j in range(size):
                    workspace[i, j] += weight * matrix[k, j]
    matrix[:STATES, :STATES] = 0.0
    for i in range(STATES, size):
        for j in range(STATES, size):
            matrix[i, j] *= transition[i, i] * transition[j, j]
    _add_half(matrix, noise)
    for i in range(STATES):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(size):
                total += workspace[i, k] * transition[j, k]
            matrix[i, j] = matrix[j, i] = total
        for j in range(STATES, size):
            matrix[i, j] = matrix[j, i] = workspace[i, j] * transition[j, j]


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

    `augmented` (4, 22) and `covariances` (4, 22, 22) hold values and derivatives; `scales` (2, 3)
    the factors of `NoiseScale` and the information on their logarithms; `valves` (2,) are set
    points [rad], `parameters` (10,) those of the vehicle, `rates` (2, 4, 22) and `fading` (2, 15)
    those of `ProcessNoise`, `walk` the variance that a metre adds to the logarithms. With Q the
    noise of a step, P <- Phi (P + Q/2) Phi' + Q/2: half of Q acts before the step, half after it.
    """
    transition = np.empty((SIZE, SIZE))
    gathered, workspace = np.empty((_LEVELS, _ENTRIES)), np.empty((STATES, SIZE))
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
            _propagate(covariances[level], transition, gathered[level], workspace)
        for level in range(1, _LEVELS):
            derivative[:] = augmented[level]
            for i in range(STATES):
                augmented[level, i] = 0.0
                for j in range(SIZE):
                    augmented[level, i] += transition[i, j] * derivative[j]
            for i in range(STATES, SIZE):
                augmented[level, i] *= transition[i, i]
        gained = walk * abs(middle[AugmentedState.RIM]) * step_s
        for n in range(SCALES):
            scales[1, n] = scales[1, n] / (1.0 + scales[1, n] * gained)
