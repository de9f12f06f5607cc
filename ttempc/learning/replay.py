"""Replay of recorded samples through the filter, for the fit of a vehicle's parameters.

The likelihood of a log is that of the filter's innovations. `Replay` has the samples and commands
of a window; `Replay.run` gives the likelihood for one vehicle and how it changes with others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from ..estimation.filter.correct import CORRECTION, CORRECTION_SIZE, Reading, correct
from ..estimation.filter.predict import predict, steps_over
from ..estimation.filter.records import FILTER, SAME_TIME_S, SNAPSHOT, filter_parameters
from ..estimation.filter.start import initial_snapshot
from ..estimation.noise import NoiseScale, ProcessNoise, SensorNoise
from ..jit import cached_njit, record
from ..jit.rows import WIDTH
from ..layout import FLOAT, SAMPLE, SampleColumn, measurements_of
from ..models.augmented_state import (
    DISTURBANCE_BOUND,
    SIZE,
    STATES,
    Step,
    move_augmented_state,
)
from ..models.measurement import measure
from ..sensors import (
    GNSS_OF_BODY,
    IMU_OF_BODY,
    INNOVATION_SIZES,
    ROW_OF,
    SENSOR_COUNT,
    STARTING_SENSORS,
)
from ..types import FloatArray, Input, Measurement, Sensor
from ..vehicle import Vehicle
from .window import COMMAND, HEADINGS, SAMPLES, TIME, RecordedTick, Window

_BOUNDS: Final = tuple(DISTURBANCE_BOUND.tolist())
_INPUTS: Final = len(Input)
_GATE: Final = 1e-4  # as in the filter
_LEAST_S: Final = 15.0  # of driving that a fit needs
_BLOCK_S: Final = 5.0  # longer than innovations of a wrong model are correlated; assumed
_MEAN_S: Final = 0.2  # over which samples of a sensor are averaged; a lag of the front steering


class EventColumn(IntEnum):
    """Columns of an event of `replay`: a span of time and, at its end, a sample or none."""

    SENSOR = 0  # number of the sensor, see `SensorIndex`, or `NO_SAMPLE`
    SPAN_S = 1  # since the event before
    FIRST = 2  # entries of the sample
    SECOND = 3
    DELTA_T = 4  # command that acts in the span, as `Input`
    DELTA_I = 5
    HP = 6
    STEPS = 7  # of integration over the span
    BLOCK = 8  # number of the block of time to which the event belongs


EVENT: Final = len(EventColumn)
"""Number of columns of an event."""
NO_SAMPLE: Final = -1.0
"""`EventColumn.SENSOR` of an event without a sample."""


@cached_njit(nogil=True)
def replay(
    parameters: FloatArray,
    snapshot: FloatArray,
    copies: FloatArray,
    events: FloatArray,
    copy_parameters: FloatArray,
    normal: FloatArray,
    gradients: FloatArray,
) -> float:
    """Run the filter over `events`; return twice the negative log-likelihood of its innovations.

    `events` (n, `EVENT`) are as in `EventColumn`. `parameters` and `snapshot` are those of the
    filter; a sample beyond its gate is used with its noise raised until it just passes. A copy of
    the state runs along with the filter for each parameter of the fit, raised by a small step:
    `copies` (p, 24) are these states, `copy_parameters` (p, 16) their vehicles. With the whitened
    innovations r and their derivatives J by the steps of the parameters, J' J is added to `normal`
    (p, p) and J' r, block by block, to `gradients` (blocks, p).
    """
    f = record(parameters, FILTER)
    workspace = np.empty(CORRECTION_SIZE)
    count = len(copies)
    derivative = np.zeros((count, 2))  # rows of J of one event
    residual = np.zeros(2)  # entries of r of one event
    cost = 0.0
    for n in range(len(events)):
        event = events[n]
        span_s = event[EventColumn.SPAN_S]
        if span_s > 0.0:
            command = event[EventColumn.DELTA_T : EventColumn.STEPS]
            steps = int(event[EventColumn.STEPS])
            _advance_copies(parameters, snapshot, copies, copy_parameters, event)
            predict(parameters, snapshot, command, span_s, steps)
        if event[EventColumn.SENSOR] == NO_SAMPLE:
            continue
        sensor = int(event[EventColumn.SENSOR])
        first = event[EventColumn.FIRST]
        second = event[EventColumn.SECOND]
        reading = Reading(sensor, first, second, f.variances[sensor])
        always = count > 0  # no literal: numba would compile `correct` once more for it
        comparison = correct(parameters, snapshot, reading, always, always, workspace)

        # A sample beyond the gate counts as one whose noise is larger
        size = INNOVATION_SIZES[sensor]
        squared = comparison.normalised_squared
        factor = max(1.0, squared / f.gates[sensor])
        cost += min(squared, f.gates[sensor]) + math.log(factor) * size + comparison.log_determinant
        residual[0] = comparison.first / math.sqrt(factor)
        residual[1] = comparison.second / math.sqrt(factor)
        _compare_copies(copies, copy_parameters, sensor, workspace, derivative)
        _correct_copies(copies, workspace, size, residual, derivative)

        # J' J and J' r
        block = int(event[EventColumn.BLOCK])
        for j in range(count):
            for r in range(size):
                gradients[block, j] += derivative[j, r] * residual[r]
                for i in range(count):
                    normal[i, j] += derivative[i, r] * derivative[j, r]
    return cost


@cached_njit(nogil=True)
def _advance_copies(
    parameters: FloatArray,
    snapshot: FloatArray,
    copies: FloatArray,
    copy_parameters: FloatArray,
    event: FloatArray,
) -> None:
    """Advance the copies of the state over the span of an event, from the filter's set points."""
    f = record(parameters, FILTER)
    now = record(snapshot, SNAPSHOT)
    step = Step(np.empty(WIDTH), np.empty(_INPUTS), np.empty(SIZE - STATES))
    valves = np.empty(2)
    command = event[EventColumn.DELTA_T : EventColumn.STEPS]
    steps = int(event[EventColumn.STEPS])
    step_s = event[EventColumn.SPAN_S] / steps
    for j in range(len(copies)):
        valves[0] = now.valves[0]
        valves[1] = now.valves[1]
        for _ in range(steps):
            vehicle = copy_parameters[j]
            move_augmented_state(copies[j], valves, command, vehicle, f.fading, step_s, step)


@cached_njit(nogil=True)
def _compare_copies(
    copies: FloatArray,
    copy_parameters: FloatArray,
    sensor: int,
    workspace: FloatArray,
    derivative: FloatArray,
) -> None:
    """Write the difference of each copy's whitened innovation from the filter's, (p, 2)."""
    w = record(workspace, CORRECTION)
    reading = np.zeros(2)
    unused = np.empty((2, SIZE))
    for j in range(len(copies)):
        size = measure(sensor, copies[j], copy_parameters[j], 0.0, reading, unused)
        derivative[j, 0] = (w.reading[0] - reading[0]) / w.root[0]
        if size == 2:
            rest = w.reading[1] - reading[1] - w.root[1] * derivative[j, 0]
            derivative[j, 1] = rest / w.root[2]


@cached_njit(nogil=True)
def _correct_copies(
    copies: FloatArray,
    workspace: FloatArray,
    size: int,
    residual: FloatArray,
    derivative: FloatArray,
) -> None:
    """Correct each copy by its own innovation with the gain of the filter."""
    w = record(workspace, CORRECTION)
    for j in range(len(copies)):
        for r in range(size):
            for i in range(copies.shape[1]):
                copies[j, i] += w.projected[0, r, i] * (residual[r] + derivative[j, r])
        for i in range(STATES, SIZE):
            bound = _BOUNDS[i - STATES]
            copies[j, i] = min(max(copies[j, i], -bound), bound)


@dataclass(frozen=True, slots=True)
class Misfit:
    """How a vehicle fits recorded samples; r are the whitened innovations, J their derivatives."""

    cost: float  # twice the negative log-likelihood
    normal: FloatArray  # (p, p), J' J
    block_gradients: FloatArray  # (blocks, p), J' r of each block of time
    roughness: float  # factor `NoiseScale.GROUND` at the end


@dataclass(frozen=True)
class Replay:
    """Samples and commands of a window as the rows that the kernel reads."""

    first: Mapping[Sensor, Measurement]  # of every sensor, before the events
    events: FloatArray
    counts: FloatArray  # (sensors,) number of samples of which one of the events is the mean
    squared_speed: float  # mean square of the wheel speed [m^2/s^2]
    noise: SensorNoise
    process: ProcessNoise

    @classmethod
    def of(
        cls,
        window: Sequence[RecordedTick],
        vehicle: Vehicle,
        noise: SensorNoise,
        process: ProcessNoise,
    ) -> Replay | None:
        """Return the window from the first reading of every sensor on, None if it is too short."""
        flat = Window.of(window)
        arrived = np.diff(flat.ticks[:, SAMPLES], prepend=0.0).astype(int)
        headings = np.repeat(flat.ticks[:, HEADINGS], arrived, axis=0)
        heights = noise.antenna_height_t, noise.antenna_height_i
        samples, counts = _means(axle_points(flat.samples, headings, heights))
        ticks = flat.ticks[~np.isnan(flat.ticks[:, COMMAND]).any(axis=1)]
        of_sensor = [
            samples[samples[:, SampleColumn.SENSOR] == ROW_OF[sensor].index]
            for sensor in STARTING_SENSORS
        ]
        if len(ticks) < 2 or not all(map(len, of_sensor)):
            return None

        # From the first reading of every sensor on, and from the first command that acts
        times = samples[:, SampleColumn.TIME_S]
        end_s = ticks[-1, TIME]
        starts = [own[0, SampleColumn.TIME_S] for own in of_sensor]
        begin_s = max(ticks[0, TIME] + vehicle.dead_times.min(), *starts)
        first = measurements_of(
            np.array([own[own[:, SampleColumn.TIME_S] <= begin_s][-1] for own in of_sensor])
        )
        rest = samples[(times > begin_s) & (times <= end_s)]
        if not len(rest) or end_s - rest[0, SampleColumn.TIME_S] < _LEAST_S:
            return None
        events = _events(rest, ticks, begin_s, vehicle.dead_times)
        wheels = rest[rest[:, SampleColumn.SENSOR] == ROW_OF[Sensor.ENCODER].index]
        speeds = wheels[:, SampleColumn.FIRST]
        squared_speed = float(np.square(speeds).mean()) if len(speeds) else 0.0
        start = {reading.sensor: reading for reading in first}
        return cls(start, events, counts, squared_speed, noise, process)

    def run(self, vehicle: Vehicle, raised: Sequence[Vehicle]) -> Misfit:
        """Return how `vehicle` fits, with derivatives along the steps to each of `raised`."""
        snapshot, *copies = (
            initial_snapshot(self.first, item, self.noise, self.process)
            for item in (vehicle, *raised)
        )
        own, *others = (
            filter_parameters(item, self.noise, self.process, _GATE) for item in (vehicle, *raised)
        )
        own.view(FILTER)[0]["variances"][:] /= self.counts

        count = len(raised)
        normal = np.zeros((count, count))
        blocks = int(self.events[:, EventColumn.BLOCK].max()) + 1
        gradients = np.zeros((blocks, count))
        cost = replay(
            own,
            snapshot,
            np.array([copy.view(SNAPSHOT)[0]["augmented"][0] for copy in copies]),
            self.events,
            np.array([item.view(FILTER)[0]["vehicle"] for item in others]),
            normal,
            gradients,
        )
        roughness = float(snapshot.view(SNAPSHOT)[0]["scales"][NoiseScale.GROUND])
        return Misfit(cost, normal, gradients, roughness)


def _events(
    samples: FloatArray, ticks: FloatArray, begin_s: float, dead_times: FloatArray
) -> FloatArray:
    """Return the rows `EventColumn` of samples and of the changes of what acts, by time.

    `samples` are rows of `SampleColumn` after `begin_s`, `ticks` those of a `Window` with known
    commands. A sample goes before a change at the same time.
    """
    ends = ticks[:, TIME]
    sent = ticks[:, COMMAND]
    changes = np.unique(np.append(ends[:, None] + dead_times, ends[-1]))
    changes = changes[(changes > begin_s) & (changes <= ends[-1])]
    times = np.append(samples[:, SampleColumn.TIME_S], changes)
    order = np.argsort(times, kind="stable")
    times = times[order]
    spans = np.diff(times, prepend=begin_s)
    was_sent_s = times[:, None] - dead_times - SAME_TIME_S
    acting = np.searchsorted(ends, was_sent_s)

    events = np.zeros((len(times), EVENT))
    events[len(samples) :, EventColumn.SENSOR] = NO_SAMPLE
    events[: len(samples), EventColumn.SENSOR] = samples[:, SampleColumn.SENSOR]
    events[: len(samples), EventColumn.FIRST] = samples[:, SampleColumn.FIRST]
    events[: len(samples), EventColumn.SECOND] = samples[:, SampleColumn.SECOND]
    events = events[order]
    events[:, EventColumn.SPAN_S] = spans
    events[:, EventColumn.DELTA_T : EventColumn.STEPS] = sent[acting, range(_INPUTS)]
    events[:, EventColumn.STEPS] = [steps_over(span) for span in spans.tolist()]
    events[:, EventColumn.BLOCK] = (times - begin_s) // _BLOCK_S
    return events


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
    sensors = samples[:, SampleColumn.SENSOR]
    for body, height_m in enumerate(heights_m):
        imu = samples[sensors == IMU_OF_BODY[body]]
        imu = imu[np.isfinite(imu).all(axis=1)]
        if height_m == 0.0 or not len(imu):
            continue
        own = sensors == GNSS_OF_BODY[body]
        nearest = _nearest(samples[own, SampleColumn.TIME_S], imu)
        roll = nearest[:, SampleColumn.SECOND]
        pitch = nearest[:, SampleColumn.THIRD]
        yaw = headings[own, body]
        right = height_m * np.sin(roll)
        ahead = height_m * np.cos(roll) * np.sin(pitch)
        result[own, SampleColumn.FIRST] -= ahead * np.cos(yaw) + right * np.sin(yaw)
        result[own, SampleColumn.SECOND] -= ahead * np.sin(yaw) - right * np.cos(yaw)
    return result


def _nearest(times: FloatArray, samples: FloatArray) -> FloatArray:
    """Return of rows of samples, in any order, the one nearest to each time, (n, `SAMPLE`)."""
    samples = samples[np.argsort(samples[:, SampleColumn.TIME_S])]
    known = samples[:, SampleColumn.TIME_S]
    after = np.clip(np.searchsorted(known, times), 1, None).clip(None, len(known) - 1)
    before_is_nearer = times - known[after - 1] < known[after] - times
    return samples[after - before_is_nearer]


def _means(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means of samples that follow each other within `_MEAN_S`, by time, then sensor.

    The samples are rows (n, `SAMPLE`) in any order; means of white noise tell as much of a vehicle
    that hardly turns meanwhile. Each mean is one of as many samples as `counts` (sensors,) has for
    its sensor, so that its variance is known; what is left over at a gap is dropped, and so are
    float solutions.
    """
    result = [np.empty((0, SAMPLE))]
    counts = np.ones(SENSOR_COUNT)
    usable = np.isfinite(rows).all(axis=1) & (rows[:, SampleColumn.THIRD] != FLOAT)
    for sensor in STARTING_SENSORS:
        index = ROW_OF[sensor].index
        own = rows[(rows[:, SampleColumn.SENSOR] == index) & usable]
        times, first = np.unique(own[:, SampleColumn.TIME_S], return_index=True)
        own = own[first]
        period_s = np.median(np.diff(times)) if len(own) > 1 else math.inf
        count = max(1, round(_MEAN_S / period_s))
        counts[index] = count
        groups = own[: len(own) // count * count].reshape(-1, count, SAMPLE)
        spans = groups[:, -1, SampleColumn.TIME_S] - groups[:, 0, SampleColumn.TIME_S]
        result.append(groups[spans < 1.5 * _MEAN_S].mean(axis=1))
    means = np.concatenate(result)
    order = np.lexsort((means[:, SampleColumn.SENSOR], means[:, SampleColumn.TIME_S]))
    return means[order], counts
