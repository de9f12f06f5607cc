"""Steering command against measured angle: valves that are stuck, hard over, slow or free."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from ...types import Command, Input, Sensor
from ...vehicle import Vehicle
from .detector import Alarm, Cusum, Observation, Reaction
from .limits import STEERING, STEERING_ALLOWANCE, STEERING_STOP

# Dead time beyond that of the model, not learnt yet: three periods of the paper; assumed.
_UNKNOWN_S: Final = 0.6
_INTERVAL_S: Final = 0.1  # of dead times that share a residual
_REFUTED_S: Final = 60.0  # for which an interval is out once its sum has passed the limit; assumed
_STANDING_TICKS: Final = 3  # in which a valve that stands has not moved; assumed
_STEP_S: Final = 0.02  # of the model's integration: an eighth of the paper's shortest lag
_KEPT_S: Final = 1.0  # of the response, for samples that come late
_SCATTER: Final = 25  # samples of which the noise is estimated: a second of the paper's sensors
_QUIET: Final = math.radians(1.0) / math.sqrt(5.0)  # sd of a mean of five of the paper's samples
# The root mean square of the residuals, that of play and overlap of a valve, is one over a time; at
# the start, and at most; all assumed.
_PLAY_S: Final = 20.0
_PLAY_AT_START: Final = math.radians(0.75)
_MOST_PLAY: Final = math.radians(1.0)
_SENSORS: Final = {
    Input.DELTA_T: Sensor.STEERING_TRACTOR,
    Input.DELTA_I: Sensor.STEERING_TRAILER,
}
_NAMES: Final = {Input.DELTA_T: "front steering", Input.DELTA_I: "trailer steering"}


@dataclass(slots=True)
class _Interval:
    """Dead times that share a residual."""

    sum: Cusum = field(default_factory=lambda: Cusum(STEERING_ALLOWANCE, STEERING_STOP))
    refuted_s: float = -math.inf  # time at which its sum was above the limit
    refuted: bool = False


class SteeringResponse:
    """Compares one measured steering angle with the response of a model to the commands.

    The model is that of the vehicle: rate limit and lag, with the parameters learnt so far. The
    dead time may not be learnt yet, or wrongly: each interval of possible ones has a residual of
    its own, the distance of the mean sample of a tick from what the response has covered in it, and
    a `Cusum` that sums it up. A healthy valve agrees with one of the intervals for good, a stuck
    valve with none. One that the valve contradicts while it follows another is refuted for a
    minute, or until the valve moves as it says and as no other. The allowance grows with the noise
    of that mean, where it is above that of the paper's sensor, and is at least twice the root mean
    square of the residuals of a valve with play.

    Args:
        axis: the steering, `DELTA_T` or `DELTA_I`.
    """

    def __init__(self, axis: Input) -> None:
        self._front = axis is Input.DELTA_T
        self._sensor = _SENSORS[axis]
        self._seen_s = -math.inf  # time of the last observation
        self._intervals = [_Interval()]
        # Read several times a tick and found once. The least of the sums of all intervals; that of
        # the intervals that are not refuted, of all if there are none: the last one is gone where a
        # shorter dead time was learnt.
        self.least = self.least_possible = self._intervals[0].sum
        self._means = deque[float](maxlen=_STANDING_TICKS)  # of the samples of the last ticks [rad]
        self._times: list[float] = []  # of the response [s]
        self._angles: list[float] = []  # the response at these times [rad]
        self._valve = self._angle = math.nan
        self._sample = math.nan  # the last one [rad]
        self._changes = deque[float](maxlen=_SCATTER - 1)  # squares, between recent samples
        self._mean_square = _PLAY_AT_START**2  # of the residual
        self._compared_s = math.nan  # time of the last comparison, or of the first sample
        self._scale = 1.0  # of noise and play, by which residuals are divided

    @property
    def stands(self) -> bool:
        """Whether the measured angle has not moved in the last ticks."""
        means = self._means
        return (
            len(means) == _STANDING_TICKS
            and max(means) - min(means) < STEERING_ALLOWANCE * self._scale
        )

    def observe(self, observation: Observation) -> None:
        """Advance the model by the last command and compare it with the samples, once a tick."""
        if observation.time_s <= self._seen_s:
            return
        self._seen_s = observation.time_s
        if observation.command is not None:
            self._advance(observation.time_s, observation.command, observation.vehicle)
        of_sensor = observation.of(self._sensor)
        samples = [sample for sample in of_sensor if math.isfinite(sample.value[0])]
        if not samples:
            return
        values = [sample.value[0] for sample in samples]
        mean = sum(values) / len(values)
        if math.isnan(self._angle):
            self._valve = self._angle = mean
            self._times.append(observation.time_s)
            self._angles.append(mean)
            self._compared_s = observation.time_s
            return
        self._means.append(mean)
        for value in values:
            change = value - self._sample
            if not math.isnan(change):
                self._changes.append(change * change)
            self._sample = value
        sampled = [sample.time_s for sample in samples]
        longest = self._dead_time(observation.vehicle) + _UNKNOWN_S
        count = math.ceil(longest / _INTERVAL_S - 1e-9)
        delays = [n * _INTERVAL_S for n in range(count + 1)]
        means = [self._response(min(sampled) - s, max(sampled) - s) for s in delays]
        if math.isnan(sum(means)):
            return
        while len(self._intervals) < count:
            self._intervals.append(_Interval())
        del self._intervals[count:]
        play = 2.0 * math.sqrt(self._mean_square) / STEERING_ALLOWANCE
        self._scale = max(1.0, play, self._noise(len(values)) / _QUIET)
        for interval, (one, other) in zip(self._intervals, pairwise(means), strict=True):
            residual = mean - min(max(mean, min(one, other)), max(one, other))
            interval.sum.add(residual / self._scale)
        self._refute(observation.time_s)
        elapsed = observation.time_s - self._compared_s
        square = min(self._scale * abs(self.least_possible.residual), _MOST_PLAY) ** 2
        self._mean_square += min(1.0, elapsed / _PLAY_S) * (square - self._mean_square)
        self._compared_s = observation.time_s

    def _refute(self, time_s: float) -> None:
        """Find the least sums, and refute intervals or take that back."""
        self.least, self.least_possible = _least(self._intervals), self._possible()
        follows = self.least_possible.largest <= STEERING
        mistaken = not follows and self.least.largest <= STEERING and not self.stands
        for item in self._intervals:
            if follows and item.sum.largest > STEERING:
                item.refuted_s = time_s
            if mistaken:
                item.refuted_s = -math.inf
            item.refuted = time_s - item.refuted_s < _REFUTED_S
        self.least_possible = self._possible()

    def _possible(self) -> Cusum:
        return _least([item for item in self._intervals if not item.refuted] or self._intervals)

    def _response(self, begin_s: float, end_s: float) -> float:
        """Return the mean response of a time, NaN where it is not kept or lies in the future."""
        begin, end = bisect_left(self._times, begin_s - _STEP_S), bisect_right(self._times, end_s)
        if begin_s < self._times[0] or end <= begin:
            return math.nan
        return sum(self._angles[begin:end]) / (end - begin)

    def _noise(self, count: int) -> float:
        """Return the sd of the mean of `count` samples, from the differences of recent ones."""
        return math.sqrt(sum(self._changes) / (2.0 * max(1, len(self._changes)) * count))

    def _dead_time(self, vehicle: Vehicle) -> float:
        return vehicle.dead_time_t if self._front else vehicle.dead_time_i

    def _advance(self, time_s: float, command: Command, vehicle: Vehicle) -> None:
        """Continue the response without a dead time to `time_s` under the last `command`."""
        if not self._times:
            return
        now, valve, angle = self._times[-1], self._valve, self._angle
        target = command.delta_t if self._front else command.delta_i
        lag = vehicle.steering_lag_t if self._front else vehicle.steering_lag_i
        rate = vehicle.steering_rate_t if self._front else vehicle.steering_rate_i
        steps = max(1, math.ceil((time_s - now) / _STEP_S - 1e-9))
        step = (time_s - now) / steps
        share, reach = 1.0 - math.exp(-step / lag), rate * step
        for n in range(steps):
            valve = min(max(target, valve - reach), valve + reach)
            angle += share * (valve - angle)
            self._times.append(now + (n + 1) * step)
            self._angles.append(angle)
        self._valve, self._angle = valve, angle
        dropped = bisect_left(self._times, time_s - self._dead_time(vehicle) - _UNKNOWN_S - _KEPT_S)
        del self._times[:dropped], self._angles[:dropped]


class SteeringMonitor:
    """Notices a valve that does not follow its command, whatever its dead time.

    Args:
        axis: the steering.
        response: of this axis, if another monitor uses it too.
    """

    limit = STEERING_STOP

    def __init__(self, axis: Input, response: SteeringResponse | None = None) -> None:
        self.name = _NAMES[axis]
        self._response = response or SteeringResponse(axis)

    @property
    def statistic(self) -> float:
        """Least of the sums of residuals [rad]."""
        return self._response.least.largest

    @property
    def residual(self) -> float:
        """Latest residual of the interval with the least sum, over its scale [rad]."""
        return self._response.least.residual

    def observe(self, observation: Observation) -> None:
        """Compare the samples with the response."""
        self._response.observe(observation)

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that cannot be steered stops."""
        return Alarm(self.name, f"{self.name} does not follow its command", Reaction.STOP)


class StandstillMonitor:
    """Notices steering that stands still while its command asks for motion, as with a stuck valve.

    Only dead times that the valve has not contradicted so far count, so that it is earlier than
    `SteeringMonitor`. Commands that are late or lost for a moment show as well.

    Args:
        axis: the steering.
        response: of this axis, if another monitor uses it too.
    """

    limit = STEERING

    def __init__(self, axis: Input, response: SteeringResponse | None = None) -> None:
        self.name = f"{_NAMES[axis]} at standstill"
        self._what = _NAMES[axis]
        self._response = response or SteeringResponse(axis)

    @property
    def statistic(self) -> float:
        """Least of the sums of the dead times that are possible [rad]; 0 while the angle moves."""
        return self._response.least_possible.largest if self._response.stands else 0.0

    @property
    def residual(self) -> float:
        """Latest residual of the interval with that sum, over its scale [rad]."""
        return self._response.least_possible.residual

    def observe(self, observation: Observation) -> None:
        """Compare the samples with the response."""
        self._response.observe(observation)

    def alarm(self) -> Alarm:
        """Return the alarm: the vehicle slows down until it is known whether the valve is stuck."""
        return Alarm(self.name, f"{self._what} stands still against its command", Reaction.SLOW)


def _least(intervals: Sequence[_Interval]) -> Cusum:
    sums = [item.sum for item in intervals]
    return min(sums, key=lambda item: (item.largest, abs(item.residual)))
