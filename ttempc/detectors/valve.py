"""Response of a steering valve to its commands, and the measured angle against it.

The dead time of the valve may not be learnt yet, or wrongly. Possible dead times are divided into
intervals of 0.1 s, each with a residual and sums of its own. A healthy valve agrees with one of
them for good, a stuck valve with none.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ..layout import SampleColumn
from ..models.augmented_state import VehicleParameter
from ..sensors import SensorIndex
from ..types import FloatArray
from ..vehicle import MAX_DEAD_TIME_S
from .board import Record, TickData
from .history import Entry, cusum, kernel, remember
from .table import DetectorIndex

_RESPONSE: Final = 402  # entries of the history of the response; assumed
_INTERVAL_S: Final = 0.1  # of dead times that share a residual
# Dead time beyond that of the model, not learnt yet: three periods of the paper; assumed.
_UNKNOWN_S: Final = 0.6
_INTERVALS: Final = math.ceil((MAX_DEAD_TIME_S + _UNKNOWN_S) / _INTERVAL_S - 1e-9)
_TICKS: Final = 3  # in which a valve that stands has not moved; assumed
_CHANGES: Final = 24  # of samples, of which the noise is estimated: a second of the paper's sensors

INTERVAL: Final = np.dtype(
    [
        ("above", "f8"),  # cumulative sums [rad] of the residual
        ("below", "f8"),
        ("residual", "f8"),  # over the scale [rad]
        ("refuted_s", "f8"),  # last time at which the valve has contradicted the interval
        ("refuted", "f8"),  # 1: the interval does not count
    ]
)
"""Memory of an interval of dead times."""

LEAST: Final = np.dtype([("sum", "f8"), ("residual", "f8")])
"""Larger sum of the interval that agrees best, and its residual [rad]."""

VALVE: Final = np.dtype(
    [
        # History of the angle [rad] of the model without a dead time, and with the least flow
        ("response", "f8", (1 + _RESPONSE, 3)),
        ("valve", "f8"),  # set point within the rate limit [rad]; NaN: no sample yet
        ("angle", "f8"),  # [rad]
        ("slow_valve", "f8"),  # both with the least flow
        ("slow_angle", "f8"),
        ("means", "f8", _TICKS),  # of the samples of the last ticks [rad]
        ("moved", "f8"),  # range of these means
        ("sample", "f8"),  # the last one [rad]
        ("changes", "f8", _CHANGES),  # ring: squares, between recent samples
        ("change_count", "f8"),  # of all so far
        ("scale", "f8"),  # of noise and play, by which residuals are divided
        ("mean_square", "f8"),  # of the residual: play and overlap of the valve
        ("compared_s", "f8"),  # time of the last comparison, or of the first sample
        ("intervals", INTERVAL, _INTERVALS),
        ("interval_count", "f8"),
        ("least_of_all", LEAST),
        ("least", LEAST),  # of the intervals that are not refuted
        # Mean response in the span of a tick's samples, late by n intervals, NaN: not known
        ("late", "f8", _INTERVALS + 1),
        ("slow_late", "f8", _INTERVALS + 1),  # the same with the least flow
        ("updated_s", "f8"),  # time of the last tick
    ]
)
"""Memory of a steering valve."""

ALLOWANCE: Final = math.radians(1.25)
"""Half of the shift of a residual that is to be detected, 2.5 deg [rad]; assumed."""

_COLD: Final = 0.6  # least share of the flow that a valve has, as with cold oil; assumed
_STEP_S: Final = 0.02  # of the model's integration: an eighth of the paper's shortest lag
_MOST_STEPS: Final = 500  # in a tick: a gap of more than 10 s has longer ones
_LATE_S: Final = 1.0  # of the response, for samples that come late
_REFUTED_S: Final = 60.0  # for which an interval does not count; assumed
_NOISE: Final = math.radians(1.0) / math.sqrt(5.0)  # sd of a mean of five of the paper's samples
# The root mean square of the residuals, that of play and overlap of a valve; all assumed.
_PLAY_S: Final = 20.0
_PLAY_AT_START: Final = math.radians(0.75)
_MOST_PLAY: Final = math.radians(1.0)


class Samples(NamedTuple):
    """Samples of an angle in a tick."""

    number: int
    mean: float  # [rad]; 0 where there are none
    earliest_s: float
    latest_s: float


def new_valve() -> FloatArray:
    """Return a record `VALVE` before the first sample, flat."""
    flat = np.zeros(VALVE.itemsize // 8)
    memory = flat.view(VALVE)[0]
    memory["valve"] = math.nan
    memory["angle"] = math.nan
    memory["sample"] = math.nan
    memory["means"] = math.inf  # of a valve that has not stood yet
    memory["moved"] = math.inf
    memory["scale"] = 1.0
    memory["mean_square"] = _PLAY_AT_START**2
    memory["least_of_all"]["residual"] = math.nan
    memory["least"]["residual"] = math.nan
    memory["updated_s"] = -math.inf
    return flat


@kernel
def compare_valve(memory: Record, board: Record, data: TickData, axis: int) -> None:
    """Advance the response of a valve by a tick, and compare the samples of its angle with it.

    A tick whose time has passed already has no effect. The first sample starts the response.

    Args:
        memory: record `VALVE`.
        board: record `BOARD`, with the sensors that are excluded.
        data: of the tick.
        axis: 0 of the front steering, 1 of the trailer's.
    """
    if not data.now > memory.updated_s:
        return
    memory.updated_s = data.now
    known = not math.isnan(memory.angle)
    if known and not math.isnan(data.command[0]):
        _advance_response(memory, data, axis)

    samples = _take_samples(memory, board, data, axis)
    if not samples.number:
        return
    if not known:
        _start_response(memory, data.now, samples.mean)
        return
    _measure_range(memory, samples.mean)
    intervals = _shift_response(memory, data, samples, axis)
    if intervals:
        sum_limit = board.limit[DetectorIndex.STEERING_FRONT + axis]
        refuted_limit = board.limit[DetectorIndex.STANDSTILL_FRONT + axis]
        _add_intervals(memory, intervals)
        _scale_residuals(memory, samples.number)
        _compare_intervals(memory, samples.mean, sum_limit)
        _refute_intervals(memory, data.now, refuted_limit)
        _learn_play(memory, data.now)


@kernel
def moves(memory: Record) -> bool:
    """Return whether the angle has moved in the last ticks by more than noise and play explain."""
    return memory.moved >= ALLOWANCE * memory.scale


@kernel
def _advance_response(memory: Record, data: TickData, axis: int) -> None:
    """Integrate the response to the command of the period before, without a dead time.

    The set point s follows the command u at most at the rate R, the angle the set point with the
    lag tau, at the full flow and at the least share c of it,

        s' = clip((u - s) / dt, -c R, c R),   a' = c (s - a) / tau,   c = 1 and 0.6.
    """
    response = memory.response
    parameters = data.parameters
    command = data.command[axis]
    begin_s = response[int(response[0, 0]), Entry.TIME_S]
    dead_time_s = parameters[VehicleParameter.DEAD_TIME_T + axis]
    oldest_s = data.now - dead_time_s - _UNKNOWN_S - _LATE_S

    steps = min(max(1, math.ceil((data.now - begin_s) / _STEP_S - 1e-9)), _MOST_STEPS)
    step_s = (data.now - begin_s) / steps
    lags = step_s / parameters[VehicleParameter.STEERING_LAG_T + axis]
    share = 1.0 - math.exp(-lags)
    slow_share = 1.0 - math.exp(-_COLD * lags)
    reach = parameters[VehicleParameter.STEERING_RATE_T + axis] * step_s
    slow_reach = _COLD * reach
    for n in range(steps):
        memory.valve = min(max(command, memory.valve - reach), memory.valve + reach)
        memory.angle += share * (memory.valve - memory.angle)
        memory.slow_valve += min(max(command - memory.slow_valve, -slow_reach), slow_reach)
        memory.slow_angle += slow_share * (memory.slow_valve - memory.slow_angle)
        time_s = begin_s + (n + 1) * step_s
        remember(response, oldest_s, time_s, memory.angle, memory.slow_angle)


@kernel
def _start_response(memory: Record, now: float, angle: float) -> None:
    """Start the response at a measured angle [rad]."""
    memory.valve = angle
    memory.angle = angle
    memory.slow_valve = angle
    memory.slow_angle = angle
    remember(memory.response, -math.inf, now, angle, angle)
    memory.compared_s = now


@kernel
def _take_samples(memory: Record, board: Record, data: TickData, axis: int) -> Samples:
    """Return the samples of the angle in a tick; keep the squares of their changes."""
    sensor = SensorIndex.STEERING_TRACTOR + axis
    known = not math.isnan(memory.angle)
    count = 0
    total = 0.0
    earliest_s = math.inf
    latest_s = -math.inf
    for row in range(len(data.rows) if board.excluded[sensor] == 0.0 else 0):
        time_s = data.rows[row, SampleColumn.TIME_S]
        angle = data.rows[row, SampleColumn.FIRST]
        if data.rows[row, SampleColumn.SENSOR] != sensor or not math.isfinite(time_s + angle):
            continue
        count += 1
        total += angle
        earliest_s = min(earliest_s, time_s)
        latest_s = max(latest_s, time_s)
        change = angle - memory.sample
        if not math.isnan(change):
            memory.changes[int(memory.change_count) % _CHANGES] = change * change
            memory.change_count += 1.0
        memory.sample = angle if known else math.nan
    return Samples(count, total / max(1, count), earliest_s, latest_s)


@kernel
def _measure_range(memory: Record, mean: float) -> None:
    """Add the mean angle of a tick to the last ones, and write their range."""
    low = mean
    high = mean
    for n in range(1, _TICKS):
        low = min(low, memory.means[n])
        high = max(high, memory.means[n])
        memory.means[n - 1] = memory.means[n]
    memory.means[_TICKS - 1] = mean
    memory.moved = high - low


@kernel
def _shift_response(memory: Record, data: TickData, samples: Samples, axis: int) -> int:
    """Write the mean response in the span of the samples, late by 0, 1, 2, ... intervals.

    Returns the number of intervals, 0 where the response does not reach back that far. Row 0 of a
    history has the count of its entries, which are 1 to count; `first` and `last` only move back.
    """
    response = memory.response
    longest_s = data.parameters[VehicleParameter.DEAD_TIME_T + axis] + _UNKNOWN_S
    intervals = min(_INTERVALS, math.ceil(longest_s / _INTERVAL_S - 1e-9))
    count = int(response[0, 0])
    first = count + 1
    last = count
    for n in range(intervals + 1):
        begin_s = samples.earliest_s - n * _INTERVAL_S
        end_s = samples.latest_s - n * _INTERVAL_S
        while first > 1 and response[first - 1, Entry.TIME_S] >= begin_s - _STEP_S:
            first -= 1
        while last > 0 and response[last, Entry.TIME_S] > end_s:
            last -= 1
        if response[1, Entry.TIME_S] > begin_s or first > last:
            return 0

        total = 0.0
        slow_total = 0.0
        for entry in range(first, last + 1):
            total += response[entry, Entry.FIRST]
            slow_total += response[entry, Entry.SECOND]
        memory.late[n] = total / (last + 1 - first)
        memory.slow_late[n] = slow_total / (last + 1 - first)
    return intervals


@kernel
def _add_intervals(memory: Record, intervals: int) -> None:
    """Begin the intervals that a longer dead time of the model adds."""
    for n in range(int(memory.interval_count), intervals):
        interval = memory.intervals[n]
        interval.above = 0.0
        interval.below = 0.0
        interval.refuted_s = -math.inf
        interval.refuted = 0.0
    memory.interval_count = intervals


@kernel
def _scale_residuals(memory: Record, samples: int) -> None:
    """Write the scale by which residuals are divided, so that the allowance grows.

    It is the noise of the mean of the samples over that of the paper's sensor, or twice the root
    mean square of the residuals of a valve with play over the allowance, and 1 at least.
    """
    total = 0.0
    count = min(int(memory.change_count), _CHANGES)
    for n in range(count):
        total += memory.changes[n]
    noise = math.sqrt(total / (2.0 * max(1, count) * samples))
    play = 2.0 * math.sqrt(memory.mean_square) / ALLOWANCE
    memory.scale = max(1.0, play, noise / _NOISE)


@kernel
def _compare_intervals(memory: Record, mean: float, limit: float) -> None:
    """Add the residual of each interval to its sums.

    It is the distance of the mean angle from the range that the response has covered between both
    ends of the interval, at full or at the least flow.
    """
    for n in range(int(memory.interval_count)):
        interval = memory.intervals[n]
        begin = memory.late[n]
        end = memory.late[n + 1]
        slow_begin = memory.slow_late[n]
        slow_end = memory.slow_late[n + 1]
        low = min(begin, end, slow_begin, slow_end)
        high = max(begin, end, slow_begin, slow_end)
        residual = (mean - min(max(mean, low), high)) / memory.scale
        interval.residual = residual
        interval.above = cusum(interval.above, residual, ALLOWANCE, limit)
        interval.below = cusum(interval.below, -residual, ALLOWANCE, limit)


@kernel
def _find_least(least: Record, memory: Record, possible: bool) -> None:
    """Write the larger sum of the interval that agrees best, of equal ones the nearest.

    `possible`: intervals that are refuted do not count, unless all are.
    """
    any_possible = False
    for n in range(int(memory.interval_count)):
        any_possible = any_possible or (possible and memory.intervals[n].refuted == 0.0)
    best = math.inf
    residual = math.nan
    for n in range(int(memory.interval_count)):
        interval = memory.intervals[n]
        larger = max(interval.above, interval.below)
        nearer = larger == best and abs(interval.residual) < abs(residual)
        counts = not (any_possible and interval.refuted > 0.0)
        if counts and (larger < best or nearer):
            best = larger
            residual = interval.residual
    least.sum = best
    least.residual = residual


@kernel
def _refute_intervals(memory: Record, now: float, limit: float) -> None:
    """Find the intervals that agree best, and those that the valve contradicts.

    While the best interval is within the limit, every interval with a sum above it is refuted for a
    minute. Where the valve moves, no possible interval agrees and a
    refuted one does, the refutations were mistaken.
    """
    _find_least(memory.least_of_all, memory, False)
    _find_least(memory.least, memory, True)
    best = memory.least.sum
    mistaken = memory.least_of_all.sum <= limit < best and moves(memory)
    for n in range(int(memory.interval_count)):
        interval = memory.intervals[n]
        if best <= limit < max(interval.above, interval.below):
            interval.refuted_s = now
        if mistaken:
            interval.refuted_s = -math.inf
        interval.refuted = 1.0 if now - interval.refuted_s < _REFUTED_S else 0.0
    _find_least(memory.least, memory, True)


@kernel
def _learn_play(memory: Record, now: float) -> None:
    """Take the residual of the best interval into the mean square, that of play and overlap."""
    square = min(memory.scale * abs(memory.least.residual), _MOST_PLAY) ** 2
    weight = min(1.0, (now - memory.compared_s) / _PLAY_S)
    memory.mean_square += weight * (square - memory.mean_square)
    memory.compared_s = now
