"""Correction of a snapshot by one reading, and learning of the noise factors from it."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ...jit import cached_njit, record
from ...jit.rows import WIDTH, add_row, add_rows, clear_row, set_row
from ...models.augmented_state import DISTURBANCE_BOUND, SIZE, STATES
from ...models.measurement import measure
from ...sensors import SENSOR_KINDS, SensorKind
from ...types import FloatArray
from ..noise import SCALE_RANGE
from .records import FILTER, LEVELS, SNAPSHOT, matrix_row

_TURN: Final = 2.0 * math.pi
_MOST_STEP: Final = 0.5  # of the logarithm of a factor at one sample; assumed
_BOUNDS: Final = tuple(DISTURBANCE_BOUND.tolist())

CORRECTION: Final = np.dtype(
    [
        ("jacobian", "f8", (2, WIDTH)),  # H, the derivative of the reading by the state
        ("projected", "f8", (LEVELS, 2, WIDTH)),  # H P of each level; then G' and the C
        ("half", "f8", (2, WIDTH)),  # W', half of the change of a derivative
        ("reading", "f8", 2),  # h(x), the noise-free reading
        ("spread", "f8", (3, LEVELS)),  # H P H' of each level: entries (0, 0), (1, 0), (1, 1)
        ("slope", "f8", (2, LEVELS)),  # derivatives of the innovation, by level
        ("root", "f8", 3),  # L: entries (0, 0), (1, 0), (1, 1)
        ("whitened", "f8", 2),  # L^-1 nu, the whitened innovation
    ]
)
"""Workspace of `correct`, with the symbols of its docstring; it leaves the gain G' in
`projected[0]` and L in `root`."""

CORRECTION_SIZE: Final = CORRECTION.itemsize // 8


class Reading(NamedTuple):
    """What a sample tells: one or two numbers of the same variance."""

    sensor: int  # number of the sensor, see `SensorIndex`
    first: float  # of an IMU, the angle turned since its last sample
    second: float  # of an IMU, the time since then [s]
    variance: float


class Comparison(NamedTuple):
    """Innovation nu ~ N(0, S) of a reading, S = L L'."""

    normalised_squared: float  # nu' S^-1 nu, chi-square for a right model
    log_determinant: float  # log det S, as in the logarithm of the likelihood
    first: float  # entries of L^-1 nu; a reading of one number has the first
    second: float


@cached_njit(error_model="numpy")
def correct(
    parameters: FloatArray,
    snapshot: FloatArray,
    reading: Reading,
    forced: bool,
    learns: bool,
    workspace: FloatArray,
) -> Comparison:
    """Correct a `SNAPSHOT` by one reading in place and return the `Comparison`.

    A reading beyond the gate (chi-square) changes nothing unless it is `forced`: then its noise is
    raised until it just passes, S by all of the factor. In the whitened measurement L^-1 H, the
    gain is G = P H' L^-T and, with C = L^-1 H dP and D = L^-1 H dP H' L^-T of a derivative dP,

        P <- P - G G',    dP <- dP + G W' + W G',    W = G D / 2 - C',

    which are symmetric. Disturbances are clipped to their bounds. If it `learns`, the factors of
    the noise are updated too, see `_learn_factor`. `workspace` is a `CORRECTION`. A sensor without
    an equation changes nothing.
    """
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    w = record(workspace, CORRECTION)
    sensor = reading.sensor
    size = measure(sensor, now.augmented[0], f.vehicle, reading.second, w.reading, w.jacobian)
    if size == 0:
        return Comparison(math.inf, math.nan, math.nan, math.nan)
    _project(snapshot, workspace, size)
    comparison = _compare(workspace, reading, size)

    raised = not comparison.normalised_squared <= f.gates[sensor]
    if raised:
        if not forced:
            return comparison
        factor = math.sqrt(comparison.normalised_squared / f.gates[sensor])
        for i in range(3):
            w.root[i] *= factor
        w.whitened[0] /= factor
        w.whitened[1] /= factor

    _whiten(workspace, size)
    for level in range(1, LEVELS):
        _correct_derivative(snapshot, workspace, size, level, learns and not raised)
    for r in range(size):
        gain = matrix_row(0, 2, r)
        add_row(now.augmented, 0, w.whitened[r], w.projected, gain)
        for i in range(SIZE):
            to = matrix_row(0, SIZE, i)
            add_row(now.covariances, to, -w.projected[0, r, i], w.projected, gain)
    for i in range(STATES, SIZE):
        bound = _BOUNDS[i - STATES]
        now.augmented[0, i] = min(max(now.augmented[0, i], -bound), bound)
    return comparison


@cached_njit(error_model="numpy")
def _project(snapshot: FloatArray, workspace: FloatArray, size: int) -> None:
    """Write H P, H P H' and -H dx of all levels; H has few entries that are not 0."""
    now = record(snapshot, SNAPSHOT)
    w = record(workspace, CORRECTION)
    for level in range(LEVELS):
        for r in range(size):
            clear_row(w.projected, matrix_row(level, 2, r))
            w.spread[2 * r, level] = 0.0
            w.spread[1, level] = 0.0
            w.slope[r, level] = 0.0
    for r in range(size):
        for k in range(SIZE):
            weight = w.jacobian[r, k]
            if weight != 0.0:
                for level in range(LEVELS):
                    to = matrix_row(level, 2, r)
                    at = matrix_row(level, SIZE, k)
                    add_row(w.projected, to, weight, now.covariances, at)
                    w.slope[r, level] -= weight * now.augmented[level, k]
    for r in range(size):
        for k in range(SIZE):
            weight = w.jacobian[r, k]
            if weight != 0.0:
                for column in range(r + 1):
                    for level in range(LEVELS):
                        w.spread[r + column, level] += weight * w.projected[level, column, k]


@cached_njit(error_model="numpy")
def _compare(workspace: FloatArray, reading: Reading, size: int) -> Comparison:
    """Write L, the root of S = H P H' + R, and the whitened innovation; return the comparison."""
    w = record(workspace, CORRECTION)
    nu = reading.first - w.reading[0]
    if SENSOR_KINDS[reading.sensor] == SensorKind.ANGLE:
        nu -= _TURN * round(nu / _TURN)
    root = math.sqrt(w.spread[0, 0] + reading.variance)
    below = 0.0
    corner = 1.0
    first = nu / root
    second = 0.0
    if size == 2:
        below = w.spread[1, 0] / root
        corner = math.sqrt(w.spread[2, 0] + reading.variance - below * below)
        second = (reading.second - w.reading[1] - below * first) / corner
    w.root[0] = root
    w.root[1] = below
    w.root[2] = corner
    w.whitened[0] = first
    w.whitened[1] = second
    normalised = first * first + second * second
    return Comparison(normalised, 2.0 * math.log(root * corner), first, second)


@cached_njit(error_model="numpy")
def _whiten(workspace: FloatArray, size: int) -> None:
    """Multiply H P of all levels by L^-1: they become the gain G' and the C."""
    w = record(workspace, CORRECTION)
    root = w.root[0]
    below = w.root[1]
    corner = w.root[2]
    for level in range(LEVELS):
        first = matrix_row(level, 2, 0)
        set_row(w.projected, first, 1.0 / root, w.projected, first)
        if size == 2:
            second = matrix_row(level, 2, 1)
            set_row(w.projected, second, 1.0 / corner, w.projected, second)
            add_row(w.projected, second, -below / corner, w.projected, first)


@cached_njit(error_model="numpy")
def _correct_derivative(
    snapshot: FloatArray, workspace: FloatArray, size: int, level: int, learns: bool
) -> None:
    """Correct the derivatives of state and covariance by one factor, and learn that factor.

    With e = L^-1 nu and s = L^-1 dnu, dx <- dx + G (s - D e) + C' e.
    """
    now = record(snapshot, SNAPSHOT)
    w = record(workspace, CORRECTION)
    root = w.root[0]
    below = w.root[1]
    corner = w.root[2]
    e_1 = w.whitened[0]
    e_2 = w.whitened[1]

    # s = L^-1 slope, and D = L^-1 M L^-T = [[d_11, d_21], [d_21, d_22]] column by column, with
    # M = [[spread_0, spread_1], [spread_1, spread_2]]
    d_11 = w.spread[0, level] / root / root
    d_21 = 0.0
    d_22 = 0.0
    s_1 = w.slope[0, level] / root
    s_2 = 0.0
    if size == 2:
        d_21 = (w.spread[1, level] / root - below * d_11) / corner
        d_22 = (w.spread[2, level] / corner - below * w.spread[1, level] / root / corner) / corner
        d_22 -= below * d_21 / corner
        s_2 = (w.slope[1, level] - below * s_1) / corner
    d_e_1 = d_11 * e_1 + d_21 * e_2
    d_e_2 = d_21 * e_1 + d_22 * e_2
    if learns:
        score = 0.5 * (e_1 * d_e_1 + e_2 * d_e_2 - d_11 - d_22) - e_1 * s_1 - e_2 * s_2
        information = 0.5 * (d_11 * d_11 + d_22 * d_22) + d_21 * d_21
        information += s_1 * s_1 + s_2 * s_2
        _learn_factor(snapshot, level - 1, score, information)

    # dx, and W' = D G' / 2 - C
    to = level * WIDTH
    gain_1 = matrix_row(0, 2, 0)
    gain_2 = matrix_row(0, 2, 1)
    c_1 = matrix_row(level, 2, 0)
    c_2 = matrix_row(level, 2, 1)
    half_2 = WIDTH  # second row of W'
    add_rows(now.augmented, to, s_1 - d_e_1, w.projected, gain_1, e_1, w.projected, c_1)
    set_row(w.half, 0, 0.5 * d_11, w.projected, gain_1)
    add_row(w.half, 0, -1.0, w.projected, c_1)
    if size == 2:
        add_rows(now.augmented, to, s_2 - d_e_2, w.projected, gain_2, e_2, w.projected, c_2)
        add_row(w.half, 0, 0.5 * d_21, w.projected, gain_2)
        set_row(w.half, half_2, -1.0, w.projected, c_2)
        by = 0.5 * d_22
        add_rows(w.half, half_2, 0.5 * d_21, w.projected, gain_1, by, w.projected, gain_2)

    # dP <- dP + G W' + W G'
    for r in range(size):
        gain = matrix_row(0, 2, r)
        half = r * WIDTH
        for i in range(SIZE):
            row = matrix_row(level, SIZE, i)
            weight = w.projected[0, r, i]
            add_rows(now.covariances, row, weight, w.half, half, w.half[r, i], w.projected, gain)


@cached_njit(error_model="numpy")
def _learn_factor(snapshot: FloatArray, n: int, score: float, information: float) -> None:
    """Update the n-th factor s of `NoiseScale` and the information I on its logarithm.

    For nu ~ N(0, S) with derivatives dS and dnu by s (Astrom 1980),

        score = (nu' S^-1 dS S^-1 nu - tr S^-1 dS) / 2 - nu' S^-1 dnu
        information = tr (S^-1 dS)^2 / 2 + dnu' S^-1 dnu.

    s^2 times this information is gathered in I, and s <- s (1 + s score / I), within its range.
    """
    now = record(snapshot, SNAPSHOT)
    scale = now.scales[n]
    now.information[n] += scale * scale * information
    step = min(max(scale * score / now.information[n], -_MOST_STEP), _MOST_STEP)
    least, most = SCALE_RANGE[n]
    now.scales[n] = min(max(scale * (1.0 + step), least), most)
