"""A sequence of samples through the Kalman filter in one call, compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..types import FloatArray, Input
from .augmented_state import SIZE, AugmentedState
from .augmented_state_kernel import SensorIndex, VehicleParameter
from .correction_kernel import correct
from .noise import SCALES
from .prediction_kernel import SAME_TIME_S, predict, steps_over

# Begin of each part in the row of a state, see `FilterState`; the time [s] is its first entry.
AUGMENTED: Final = 1
COVARIANCES: Final = AUGMENTED + (1 + SCALES) * SIZE
LEARNT_SCALES: Final = COVARIANCES + (1 + SCALES) * SIZE * SIZE
VALVES: Final = LEARNT_SCALES + 2 * SCALES
REJECTED_SINCE: Final = VALVES + 2
GYROS: Final = REJECTED_SINCE + len(SensorIndex)
ROW: Final = GYROS + 2 * 4
"""Entries of a row."""

_PATIENCE_S: Final = 1.0  # for which the gate may reject a sensor
_LONGEST_SPAN_S: Final = (
    0.1  # between two samples of a gyro, for their mean to be that of the yaw rate
)


@cached_njit()
def predict_until(
    augmented: FloatArray,
    covariances: FloatArray,
    scales: FloatArray,
    valves: FloatArray,
    since_s: float,
    until_s: float,
    ends_s: FloatArray,
    commands: FloatArray,
    parameters: FloatArray,
    rates: FloatArray,
    fading: FloatArray,
    walk: float,
) -> None:
    """Advance a filter from `since_s` to `until_s` under the commands held in between, in place.

    Command n of `commands` (m, 3) ends at `ends_s[n]`; where an entry is NaN, that steering or the
    speed is taken as constant. All else is as in `predict`.
    """
    command = np.empty(3)
    for n in range(len(ends_s)):
        if until_s - since_s <= SAME_TIME_S:
            break
        if ends_s[n] > since_s + SAME_TIME_S:
            end_s = ends_s[n] if ends_s[n] < until_s - SAME_TIME_S else until_s
            command[:] = commands[n]
            for i in range(len(valves)):
                if math.isnan(command[i]):
                    command[i] = valves[i]
            if math.isnan(command[Input.HP]):
                rim = augmented[0, AugmentedState.RIM]
                command[Input.HP] = rim / parameters[VehicleParameter.SPEED_GAIN]
            span_s = end_s - since_s
            predict(
                augmented,
                covariances,
                scales,
                valves,
                command,
                parameters,
                rates,
                fading,
                walk,
                span_s,
                steps_over(span_s),
            )
            since_s = end_s


@cached_njit()
def _turned(last: FloatArray, sample: FloatArray) -> float:
    """Return the angle by which the heading turned between two samples of an IMU [rad].

    `last` is (4,) as in `process`, `sample` (5,). The yaw rate w of an IMU is that about the
    vertical; a vehicle that rolls while it stands at a pitch changes its heading beside it. From
    the angular velocity of the angles yaw, pitch and roll (Diebel 2006, sec. 5.6),

        psi' = w + roll' sin(pitch).

    The integral of the second term keeps no memory of the noise of roll.
    """
    pitch = 0.5 * (last[3] + sample[4])
    rate = 0.5 * (last[1] + sample[2])
    return rate * (sample[0] - last[0]) + (sample[3] - last[2]) * math.sin(pitch)


@cached_njit()
def _keep_yaw(augmented: FloatArray, covariances: FloatArray, body: int) -> None:
    """Make the yaw of a body, 0 or 1, that at the last sample of its gyro (`PAST_*`), in place."""
    psi, past = AugmentedState.PSI_T + body, AugmentedState.PAST_T + body
    for level in range(len(augmented)):
        augmented[level, past] = augmented[level, psi]
        for i in range(SIZE):
            covariances[level, past, i] = covariances[level, psi, i]
        for i in range(SIZE):
            covariances[level, i, past] = covariances[level, i, psi]


@cached_njit()
def process(
    states: FloatArray,
    samples: FloatArray,
    variances: FloatArray,
    gates: FloatArray,
    ends_s: FloatArray,
    commands: FloatArray,
    parameters: FloatArray,
    rates: FloatArray,
    fading: FloatArray,
    walk: float,
    sampling: float,
    results: FloatArray,
) -> None:
    """Predict and correct a filter through all `samples` (n, 5), which are in order of time.

    A sample is its time [s], its `SensorIndex` and its value of one to three entries. Of the
    `states` (k, `ROW`), see `FilterState`, the first is that of the start; one after the other is
    filled with the state after all samples of one time. `variances` and `gates` (sensors,) are
    those of each entry of a sample, `sampling` that of the yaw of a gyro over a metre. `results`
    (n, 5) receives what `correct` returns, and whether the sample was accepted. All else is as in
    `predict_until`.
    """
    rows, pairs = np.empty((8, 2, SIZE)), np.empty((16, 2))
    levels = 1 + SCALES
    k = 0
    state = states[k]
    for n in range(len(samples)):
        time_s, sensor = samples[n, 0], int(samples[n, 1])
        begins = n == 0 or time_s > state[0]
        if begins:
            k += 1
            state = states[k]
            state[:] = states[k - 1]
            state[0] = time_s
        augmented = state[AUGMENTED:COVARIANCES].reshape((levels, SIZE))
        covariances = state[COVARIANCES:LEARNT_SCALES].reshape((levels, SIZE, SIZE))
        scales = state[LEARNT_SCALES:VALVES].reshape((2, SCALES))
        if begins:
            predict_until(
                augmented,
                covariances,
                scales,
                state[VALVES:REJECTED_SINCE],
                states[k - 1, 0],
                time_s,
                ends_s,
                commands,
                parameters,
                rates,
                fading,
                walk,
            )
        value, variance = (samples[n, 2], samples[n, 3]), variances[sensor]
        gyro = sensor >= SensorIndex.IMU_TRACTOR
        if gyro:
            body = sensor - SensorIndex.IMU_TRACTOR
            last = state[GYROS + 4 * body : GYROS + 4 * body + 4]
            span_s = time_s - last[0]
            value = _turned(last, samples[n]), span_s
            travel = abs(augmented[0, AugmentedState.RIM]) * span_s
            variance = variance * span_s * span_s + sampling * travel
            last[0], last[1:] = time_s, samples[n, 2:]
            if not span_s <= _LONGEST_SPAN_S:
                _keep_yaw(augmented, covariances, body)
                results[n, :] = 0.0
                continue
        rejected = state[REJECTED_SINCE:GYROS]
        gate = gates[sensor]
        forced = time_s - rejected[sensor] >= _PATIENCE_S - SAME_TIME_S
        result = correct(
            augmented,
            covariances,
            scales,
            sensor,
            value,
            variance,
            gate,
            forced,
            not gyro,
            parameters,
            rows,
            pairs,
        )
        if gyro:
            _keep_yaw(augmented, covariances, sensor - SensorIndex.IMU_TRACTOR)
        inside = result[0] <= gate
        if inside:
            rejected[sensor] = math.nan
        elif math.isnan(rejected[sensor]):
            rejected[sensor] = time_s
        results[n, :4] = result
        results[n, 4] = inside or forced
