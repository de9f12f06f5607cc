"""Identification of a vehicle's lengths from the innovations of the filter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from ..estimation.filter import (
    AUGMENTED,
    FADING,
    FILTER,
    MOMENT,
    SAME_TIME_S,
    VALVES,
    correct,
    filter_parameters,
    first_moment,
    predict,
    steps_over,
)
from ..estimation.noise import NoiseScale, ProcessNoise, SensorNoise
from ..jit import cached_njit
from ..jit.rows import WIDTH
from ..layout import FLOAT, SAMPLE, measurements_of
from ..models.augmented_state import (
    DISTURBANCE_BOUND,
    SIZE,
    STATES,
    move_augmented_state,
)
from ..models.measurement import measure
from ..sensors import STARTING_SENSORS, SensorIndex
from ..types import FloatArray, Measurement, Sensor
from ..vehicle import Vehicle
from .learner import LENGTHS, TURNING, Identification, ParameterChange
from .window import COMMAND, HEADINGS, SAMPLES, TIME, RecordedTick, Window

_BOUND: Final = tuple(DISTURBANCE_BOUND.tolist())


@cached_njit(nogil=True)
def replay(
    parameters: FloatArray,
    moment: FloatArray,
    copies: FloatArray,
    events: FloatArray,
    copy_parameters: FloatArray,
    normal: FloatArray,
    gradients: FloatArray,
) -> float:
    """Run the filter over `events`; return twice the negative log-likelihood of its innovations.

    Rows of `events` (n, 9): sensor (-1 for none), span since the row before [s], the two entries
    of the sample, command (3,) of the span, number of integration steps, block. `parameters` and
    `moment` are those of the filter; a sample beyond its gate is used with its noise raised until
    it just passes. `copies` (p, 24) are the raised states, `copy_parameters` (p, 16) their
    parameters. J' J and J' r of the whitened innovations r and their derivatives J by the steps of
    the parameters are added to `normal` (p, p) and, by block, to `gradients` (blocks, p).
    """
    f = parameters.view(FILTER)[0]
    x, valves = moment[AUGMENTED : AUGMENTED + WIDTH], moment[VALVES : VALVES + 2]
    fading = parameters[FADING : FADING + 2 * (SIZE - STATES)]
    middle, inputs, faded = np.empty(WIDTH), np.empty(3), np.empty(SIZE - STATES)
    reading, other, unused = np.zeros(2), np.zeros(2), np.empty((2, SIZE))
    copy_valves = np.empty(2)
    count, size = copies.shape  # no constants, see `FILTER`
    derivative, e = np.zeros((count, 2)), np.zeros(2)
    rows = np.empty((8, 2, WIDTH))  # workspace of `correct`, which leaves gain and factor there
    gain, root = rows[1], rows[7, 1]
    cost = 0.0
    for row in range(len(events)):
        span = events[row, 1]
        if span > 0.0:
            command, steps = events[row, 4:7], int(events[row, 7])
            for j in range(count):
                copy_valves[0], copy_valves[1] = valves[0], valves[1]
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
            predict(parameters, moment, command, span, steps)
        sensor = int(events[row, 0])
        if sensor < 0:
            continue
        m = measure(sensor, x, parameters[: len(copy_parameters[0])], 0.0, reading, unused)
        always = m > 0  # no literal: numba would compile `correct` once more for it
        variance, gate = f.variances[sensor], f.gates[sensor]
        normalised, log_determinant, first, second = correct(
            parameters,
            moment,
            sensor,
            events[row, 2],
            events[row, 3],
            variance,
            always,
            always,
            rows,
        )
        factor = max(1.0, normalised / gate)
        cost += min(normalised, gate) + math.log(factor) * m + log_determinant
        e[0], e[1] = first / math.sqrt(factor), second / math.sqrt(factor)
        for j in range(count):
            measure(sensor, copies[j], copy_parameters[j], 0.0, other, unused)
            derivative[j, 0] = (reading[0] - other[0]) / root[0]
            if m == 2:
                across = reading[1] - other[1] - root[1] * derivative[j, 0]
                derivative[j, 1] = across / root[2]
            for r in range(m):
                for i in range(size):
                    copies[j, i] += gain[r, i] * (e[r] + derivative[j, r])
            for i in range(STATES, SIZE):
                bound = _BOUND[i - STATES]
                copies[j, i] = min(max(copies[j, i], -bound), bound)
        for j in range(count):
            for r in range(m):
                gradients[int(events[row, 8]), j] += derivative[j, r] * e[r]
                for i in range(count):
                    normal[i, j] += derivative[i, r] * derivative[j, r]
    return cost


_PRIOR_SD: Final = 0.2  # of each length, relative; assumed
_SHARES: Final = 0.65, 1.5  # of a given length, least and largest: true ones of +-30 % and some
_STEP: Final = 1e-4  # relative, of the derivatives
_GATE: Final = 1e-4  # as in the filter
_MOST_STEPS: Final = 8
_CONVERGED_SD: Final = 0.2  # a step of this share of the standard deviations is the last
_LEAST_S: Final = 15.0  # of driving
_BLOCK_S: Final = 5.0  # longer than innovations of a wrong model are correlated; assumed
_MEAN_S: Final = 0.2  # over which samples of a sensor are averaged; a lag of the front steering

_GEOMETRY: Final = 0.01  # relative tolerance of each length; assumed
_SLIP: Final = 0.03  # relative tolerance of what tyres can feign, see `_tolerance`; assumed
_N: Final = len(LENGTHS)
_CHANGE_M: Final = 0.03  # the same of the turning offset, whose effect is as its own; assumed
_TURN_M: Final = 0.01  # its change below which nothing is exchanged: its prior is in it; assumed
_CHANGE: Final = 0.02  # relative change of the lengths below which nothing is exchanged; assumed
_REJECTED: Final = float(chdtri(len(LENGTHS), 0.01))  # of the given lengths
KNOWN_SD: Final = 0.05
"""Relative standard deviation up to which a length counts as known; assumed."""


class LengthIdentifier:
    """Identifies the lengths of a vehicle, see `fit_lengths`.

    The given lengths stay unless the data reject them: with their fit theta, its covariance P and
    tolerances T, (theta - theta_0)' (P + T)^-1 (theta - theta_0) must be so large that it is
    exceeded with a probability of 1 % only. The tolerance is for what no length describes: slopes,
    on which horizontal distances are shorter, and tyres that slip sideways, in furrows most.
    """

    def __init__(self, vehicle: Vehicle, noise: SensorNoise) -> None:
        self._given, self._noise, self._process = vehicle, noise, ProcessNoise.of(vehicle)

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the lengths of the window, see `Identifier`."""
        fit = fit_lengths(window, vehicle, self._given, self._noise, self._process)
        if fit is None:
            return Identification(vehicle)
        given, present, covariance = _lengths(self._given), _lengths(vehicle), fit.covariance
        sd = np.sqrt(np.diag(covariance))
        wheelbase, _, _, trailer = sd[:_N] / given[:_N]
        rejected = fit.rejection > _REJECTED
        settled = bool(max(wheelbase, trailer) < (0.5 if rejected else 1.0) * KNOWN_SD) and (
            rejected or fit.rejection < 0.5 * _REJECTED
        )
        lengths = fit.lengths
        if not rejected:  # the turning offset that fits with the given lengths
            by_lengths = np.linalg.solve(covariance[:_N, :_N], (given - lengths)[:_N])
            lengths = np.append(given[:_N], (lengths + covariance[:, :_N] @ by_lengths)[_N:])
        settled &= bool((sd[_N:] < _CHANGE_M).all())
        change = lengths - present
        turned = bool((np.abs(change[_N:]) > _TURN_M).any())
        if np.linalg.norm(change[:_N] / given[:_N]) < _CHANGE and not turned:
            return Identification(vehicle, (), settled)
        rows = zip(_names(vehicle), present.tolist(), lengths.tolist(), sd.tolist(), strict=True)
        changes = tuple(ParameterChange(*row) for row in rows if row[1] != row[2] or rejected)
        return Identification(_with_lengths(vehicle, lengths), changes, settled)


@dataclass(frozen=True, slots=True)
class LengthFit:
    """Lengths that fit recorded samples and commands best."""

    lengths: FloatArray  # (p,) [m] in the order of `LENGTHS`, then `TURNING` of one with a tool
    covariance: FloatArray  # (p, p) [m^2] of their error
    rejection: float  # of the given lengths, see `LengthIdentifier`


def fit_lengths(
    window: Sequence[RecordedTick],
    vehicle: Vehicle,
    given: Vehicle,
    noise: SensorNoise,
    process: ProcessNoise,
) -> LengthFit | None:
    """Return the lengths of largest posterior density; None where the search finds none.

    The window must contain every sensor and 15 s of driving.

    Gauss-Newton on the whitened innovations r(theta) of the filter,

        (J' J + P0^-1) d = -(J' r + P0^-1 (theta - theta_0)),    theta <- theta + d,

    with theta_0 the lengths of `given` and P0 = diag(0.2 theta_0)^2, where that of the turning
    offset c is a fifth of the tool's distance behind the axle. Side slip and the bias of the
    front steering, which the filter estimates beside, could pass for a wrong wheelbase on a steady
    curve; curves to both sides, or a curve and a straight, tell them apart. On a straight the
    samples see the sum of hitch offset, drawbar and trailer length alone.

    `vehicle` is where the search starts.
    """
    data = _Replay.of(window, vehicle, noise, process)
    if data is None:
        return None
    mean, lengths = _lengths(given), _lengths(vehicle)
    sizes = _sizes(given)
    prior = np.diag((_PRIOR_SD * sizes) ** -2.0)
    least, most = _SHARES[0] * mean, _SHARES[1] * mean
    least[_N:], most[_N:] = 0.0, sizes[_N:]

    def rejection(lengths: FloatArray, covariance: FloatArray, roughness: float) -> float:
        offset, spread = (lengths - mean)[:_N], covariance[:_N, :_N]
        return float(offset @ np.linalg.solve(spread + _tolerance(mean[:_N], roughness), offset))

    def evaluate(lengths: FloatArray) -> tuple[float, FloatArray, FloatArray, float]:
        cost, normal, gradients, roughness = data.run(_with_lengths(vehicle, lengths))
        offset = lengths - mean
        return cost + float(offset @ prior @ offset), normal + prior, gradients, roughness

    cost, normal, gradients, roughness = evaluate(lengths)
    for _ in range(_MOST_STEPS):
        gradient = gradients.sum(axis=0) + prior @ (lengths - mean)
        trial = lengths - np.linalg.solve(normal, gradient)
        trial = np.clip(trial, least, most)
        step = trial - lengths
        covariance = _covariance(normal, gradients)
        right = (lengths == mean).all() and rejection(trial, covariance, 1.0) < 0.5 * _REJECTED
        if right or step @ normal @ step < _CONVERGED_SD**2:
            return LengthFit(trial, covariance, rejection(trial, covariance, roughness))
        result = evaluate(trial)
        while result[0] > cost and step @ normal @ step >= _CONVERGED_SD**2:
            step = 0.5 * step
            trial = lengths + step
            result = evaluate(trial)
        lengths, (cost, normal, gradients, roughness) = trial, result
    return None


@dataclass(frozen=True)
class _Replay:
    """Samples and commands of a window as the rows that the kernel reads."""

    first: Mapping[Sensor, Measurement]  # of every sensor, before the events
    events: FloatArray
    counts: FloatArray  # (sensors,) of which a sample of the events is the mean
    noise: SensorNoise
    process: ProcessNoise

    @classmethod
    def of(
        cls,
        window: Sequence[RecordedTick],
        vehicle: Vehicle,
        noise: SensorNoise,
        process: ProcessNoise,
    ) -> _Replay | None:
        """Return the window from the first reading of every sensor on, None if it is too short."""
        flat = Window.of(window)
        arrived = np.diff(flat.ticks[:, SAMPLES], prepend=0.0).astype(int)
        headings = np.repeat(flat.ticks[:, HEADINGS], arrived, axis=0)
        heights = noise.antenna_height_t, noise.antenna_height_i
        samples, counts = _means(axle_points(flat.samples, headings, heights))
        ticks = flat.ticks[~np.isnan(flat.ticks[:, COMMAND]).any(axis=1)]
        ends, sent, dead_times = ticks[:, TIME], ticks[:, COMMAND], vehicle.dead_times
        of_sensor = [samples[samples[:, 1] == index] for index in range(len(STARTING_SENSORS))]
        if len(ends) < 2 or not all(map(len, of_sensor)):
            return None
        begin = max(ends[0] + dead_times.min(), *(own[0, 0] for own in of_sensor))
        first = measurements_of(np.array([own[own[:, 0] <= begin][-1] for own in of_sensor]))
        rest = samples[(samples[:, 0] > begin) & (samples[:, 0] <= ends[-1])]
        if not len(rest) or ends[-1] - rest[0, 0] < _LEAST_S:
            return None
        # Samples and changes of what acts in order of time, a sample before a change
        changes = np.unique(np.append(ends[:, None] + dead_times, ends[-1]))
        later = changes[(changes > begin) & (changes <= ends[-1])]
        times = np.append(rest[:, 0], later)
        order = np.argsort(times, kind="stable")
        events = np.zeros((len(times), 9))
        events[:, 0] = np.append(rest[:, 1], np.full(len(later), -1.0))[order]
        events[:, 1] = spans = np.diff(times[order], prepend=begin)
        events[:, 2:4] = np.append(rest[:, 2:4], np.zeros((len(later), 2)), axis=0)[order]
        was_sent_s = times[order][:, None] - dead_times - SAME_TIME_S
        events[:, 4:7] = sent[np.searchsorted(ends, was_sent_s), range(len(dead_times))]
        events[:, 7] = [steps_over(span) for span in spans.tolist()]
        events[:, 8] = (times[order] - begin) // _BLOCK_S
        return cls({reading.sensor: reading for reading in first}, events, counts, noise, process)

    def run(self, vehicle: Vehicle) -> tuple[float, FloatArray, FloatArray, float]:
        """Return cost, J' J and the blocks of J' r by the lengths of `vehicle`, and the roughness.

        The roughness is the factor `NoiseScale.GROUND` at the end.
        """
        lengths = _lengths(vehicle)
        count = len(lengths)
        step = _STEP * _sizes(vehicle)
        raised = [_with_lengths(vehicle, lengths + row) for row in np.diag(step)]
        vehicles = vehicle, *raised
        state, *copies = (
            first_moment(self.first, item, self.noise, self.process) for item in vehicles
        )
        own, *others = (
            filter_parameters(item, self.noise, self.process, _GATE) for item in vehicles
        )
        own.view(FILTER)[0]["variances"][: len(self.counts)] /= self.counts
        normal = np.zeros((count, count))
        gradients = np.zeros((int(self.events[:, -1].max()) + 1, count))
        cost = replay(
            own,
            state,
            np.array([copy[AUGMENTED : AUGMENTED + WIDTH] for copy in copies]),
            self.events,
            np.array([item[:FADING] for item in others]),
            normal,
            gradients,
        )
        roughness = float(state.view(MOMENT)[0]["scales"][0, NoiseScale.GROUND])
        return cost, normal / np.outer(step, step), gradients / step, roughness


def _covariance(normal: FloatArray, gradients: FloatArray) -> FloatArray:
    """Return A^-1 + A^-1 B A^-1 with A = J' J + P0^-1 and B from the blocks g_b of J' r.

    B = sum (g_b - mean)(g_b - mean)' is A where the innovations are white with variance 1, and
    larger where ground outside the model makes them correlated (White 1982, "Maximum likelihood
    estimation of misspecified models", Econometrica 50).
    """
    inverse = np.linalg.inv(normal)
    deviation = (gradients - gradients.mean(axis=0)) @ inverse
    return inverse + deviation.T @ deviation


def _tolerance(lengths: FloatArray, roughness: float) -> FloatArray:
    """Return T (4, 4) [m^2], the covariance of what the fit finds beside the true `lengths`.

    1 % of each length for the geometry. For side slip, 3 % of each length times the root of the
    roughness factor that the filter has learnt (at least 1), but for the sum of hitch offset,
    drawbar and trailer: the distance of both receivers shows it, whatever the tyres do.
    """
    keep_sum = np.eye(len(lengths))
    keep_sum[1:, 1:] -= 1.0 / 3.0
    slip = keep_sum @ np.diag((_SLIP * lengths) ** 2) @ keep_sum.T
    return np.diag((_GEOMETRY * lengths) ** 2) + max(1.0, roughness) * slip


def axle_points(
    samples: FloatArray, headings: FloatArray, heights_m: tuple[float, float]
) -> FloatArray:
    """Return sample rows (n, 5) with every position moved from its antenna to its axle point.

    An antenna at height h moves h sin(roll) to the right of its point and h cos(roll) sin(pitch)
    ahead of it; roll is positive with the left side up, pitch with the nose down. The attitude is
    that of the IMU sample of the body that is nearest in time; without one a position stays as it
    is. `headings` (n, 2) are the yaw of tractor and trailer [rad] at each sample.
    """
    result = samples.copy()
    for body, height_m in enumerate(heights_m):
        imu = samples[samples[:, 1] == SensorIndex.IMU_TRACTOR + body]
        imu = imu[np.isfinite(imu).all(axis=1)]
        if height_m == 0.0 or not len(imu):
            continue
        imu = imu[np.argsort(imu[:, 0])]
        own = samples[:, 1] == body
        at = samples[own, 0]
        after = np.clip(np.searchsorted(imu[:, 0], at), 1, None).clip(None, len(imu) - 1)
        near = after - (at - imu[after - 1, 0] < imu[after, 0] - at)
        roll, pitch, yaw = imu[near, 3], imu[near, 4], headings[own, body]
        right, ahead = height_m * np.sin(roll), height_m * np.cos(roll) * np.sin(pitch)
        result[own, 2] -= ahead * np.cos(yaw) + right * np.sin(yaw)
        result[own, 3] -= ahead * np.sin(yaw) - right * np.cos(yaw)
    return result


def _means(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means of samples that follow each other within `_MEAN_S`, by time, then sensor.

    The samples are rows (n, 5) of `SAMPLE` in any order; means of white noise tell as much of a
    vehicle that hardly turns meanwhile. Each mean is one of as many samples as `counts` (sensors,)
    has for its sensor, so that its variance is known; what is left over at a gap is dropped, and so
    are float solutions.
    """
    result, counts = [np.empty((0, SAMPLE))], np.ones(len(STARTING_SENSORS))
    for index in range(len(STARTING_SENSORS)):
        usable = np.isfinite(rows).all(axis=1) & (rows[:, 4] != FLOAT)
        own = rows[(rows[:, 1] == index) & usable]
        own = own[np.unique(own[:, 0], return_index=True)[1]]
        every = np.median(np.diff(own[:, 0])) if len(own) > 1 else math.inf
        counts[index] = n = max(1, round(_MEAN_S / every))
        groups = own[: len(own) // n * n].reshape(-1, n, SAMPLE)
        together = groups[:, -1, 0] - groups[:, 0, 0] < 1.5 * _MEAN_S
        result.append(groups[together].mean(axis=1))
    means = np.concatenate(result)
    return means[np.lexsort((means[:, 1], means[:, 0]))], counts


def _names(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the fields that are fitted: where there is a tool, its effect on the trailer, too."""
    return (*LENGTHS, TURNING) if vehicle.tool_behind else LENGTHS


def _lengths(vehicle: Vehicle) -> FloatArray:
    return np.array([getattr(vehicle, name) for name in _names(vehicle)])


def _sizes(vehicle: Vehicle) -> FloatArray:
    """Return lengths that are large against their errors: of the turning offset, the tool's."""
    return np.append(_lengths(vehicle)[:_N], [vehicle.tool_behind] if vehicle.tool_behind else [])


def _with_lengths(vehicle: Vehicle, lengths: FloatArray) -> Vehicle:
    return replace(vehicle, **dict(zip(_names(vehicle), lengths.tolist(), strict=True)))
