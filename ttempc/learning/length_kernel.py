"""Replay of the filter with the derivatives of its innovations by the vehicle's lengths, compiled.

The filter runs as in `ttempc.estimation.sample_kernel`, without the gyros. Beside it run four
copies of its state, each with one length raised by a small step, under the gains K of the filter:

    x_j <- f(x_j, theta_j),    nu_j = z - h(x_j, theta_j),    x_j <- x_j + K nu_j.

(nu_j - nu) / step is the derivative of the innovation. That of K is left out: it multiplies
innovations, which are white at the true lengths.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..estimation.augmented_state import DISTURBANCE_BOUND, SIZE, STATES
from ..estimation.augmented_state_kernel import measure, move_augmented_state
from ..estimation.correction_kernel import correct
from ..estimation.prediction_kernel import predict
from ..jit import cached_njit
from ..types import FloatArray

PARAMETERS: Final = 4  # lengths, the first of `VehicleParameter`
_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())


@cached_njit(nogil=True)
def replay(
    augmented: FloatArray,
    covariances: FloatArray,
    scales: FloatArray,
    valves: FloatArray,
    copies: FloatArray,
    events: FloatArray,
    variances: FloatArray,
    gates: FloatArray,
    parameters: FloatArray,
    copy_parameters: FloatArray,
    rates: FloatArray,
    fading: FloatArray,
    walk: float,
    normal: FloatArray,
    gradients: FloatArray,
) -> float:
    """Run the filter over `events`; return twice the negative log-likelihood of its innovations.

    Rows of `events` (n, 9): sensor (-1 for none), span since the row before [s], the two entries
    of the sample, command (3,) of the span, number of integration steps, block. `variances`
    (sensors,) and `gates` (2,), by the length of a sample, are those of the filter; a sample beyond
    its gate is used with its noise raised until it just passes. `copies` (4, 22) are the raised
    states, `copy_parameters` (4, 10) their parameters. J' J and J' r of the whitened innovations r
    and their derivatives J by the steps of the parameters are added to `normal` (4, 4) and, by
    block, to `gradients` (blocks, 4). The rest is as in `predict` and changed in place.
    """
    middle, inputs, faded = np.empty(SIZE), np.empty(3), np.empty(SIZE - STATES)
    reading, jacobian = np.zeros(2), np.empty((2, SIZE))
    other, unused = np.zeros(2), np.empty((2, SIZE))
    copy_valves = np.empty(2)
    derivative = np.zeros((PARAMETERS, 2))
    nu, whitened = np.zeros(2), np.zeros(2)
    cross, gain, root = np.zeros((2, SIZE)), np.zeros((2, SIZE)), np.zeros((2, 2))
    rows, pairs = np.empty((8, 2, SIZE)), np.empty((16, 2))  # workspace of `correct`
    size = augmented.shape[1]  # no constant, see `correct`
    cost = 0.0
    for row in range(len(events)):
        span = events[row, 1]
        if span > 0.0:
            command, steps = events[row, 4:7], int(events[row, 7])
            for j in range(PARAMETERS):
                copy_valves[:] = valves
                for _ in range(steps):
                    move_augmented_state(
                        copies[j],
                        copy_valves,
                        command,
                        copy_parameters[j],
                        fading,
                        span / steps,
                        middle,
                        inputs,
                        faded,
                    )
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
                span,
                steps,
            )
        sensor = int(events[row, 0])
        if sensor < 0:
            continue
        x = augmented[0]
        m = measure(sensor, x, parameters, 0.0, reading, jacobian)
        covariance = covariances[0]
        for r in range(m):
            cross[r, :] = 0.0
            for k in range(size):
                weight = jacobian[r, k]
                if weight != 0.0:
                    for i in range(size):
                        cross[r, i] += covariance[k, i] * weight
        # Cholesky factor of S = H P H' + R
        spread_00, spread_01, spread_11 = variances[sensor], 0.0, variances[sensor]
        for k in range(size):
            spread_00 += jacobian[0, k] * cross[0, k]
            if m == 2:
                spread_01 += jacobian[0, k] * cross[1, k]
                spread_11 += jacobian[1, k] * cross[1, k]
        root[0, 0] = math.sqrt(spread_00)
        root[1, 0] = spread_01 / root[0, 0]
        root[1, 1] = math.sqrt(spread_11 - root[1, 0] * root[1, 0]) if m == 2 else 1.0
        value = (events[row, 2], events[row, 3])
        normalised, log_determinant, first, second = correct(
            augmented,
            covariances,
            scales,
            sensor,
            value,
            variances[sensor],
            gates[m - 1],
            True,
            True,
            parameters,
            rows,
            pairs,
        )
        factor = max(1.0, normalised / gates[m - 1])
        cost += min(normalised, gates[m - 1]) + math.log(factor) * m + log_determinant
        raised = math.sqrt(factor)
        whitened[0], whitened[1] = first / raised, second / raised
        nu[0] = root[0, 0] * first
        nu[1] = root[1, 0] * first + root[1, 1] * second
        for i in range(size):  # K' = S^-1 H P
            lower = cross[0, i] / root[0, 0]
            gain[1, i] = 0.0
            if m == 2:
                upper = (cross[1, i] - root[1, 0] * lower) / root[1, 1]
                gain[1, i] = upper / root[1, 1] / factor
                lower -= root[1, 0] * upper / root[1, 1]
            gain[0, i] = lower / root[0, 0] / factor
        for j in range(PARAMETERS):
            measure(sensor, copies[j], copy_parameters[j], 0.0, other, unused)
            for r in range(m):
                derivative[j, r] = reading[r] - other[r]
            for i in range(size):
                for r in range(m):
                    copies[j, i] += gain[r, i] * (nu[r] + derivative[j, r])
            for i in range(STATES, size):
                bound = _BOUND[i - STATES]
                copies[j, i] = min(max(copies[j, i], -bound), bound)
            derivative[j, 0] /= root[0, 0] * raised
            if m == 2:
                derivative[j, 1] = (derivative[j, 1] / raised - root[1, 0] * derivative[j, 0]) / (
                    root[1, 1]
                )
        for j in range(PARAMETERS):
            for r in range(m):
                gradients[int(events[row, 8]), j] += derivative[j, r] * whitened[r]
                for i in range(PARAMETERS):
                    normal[i, j] += derivative[i, r] * derivative[j, r]
    return cost
