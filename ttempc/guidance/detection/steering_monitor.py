"""Steering command against measured angle: valves that are stuck, hard over, slow or free."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from ...types import Command, Input, Sensor
from ...vehicle import Vehicle
from .detector import Alarm, Cusum, Observation, Reaction
from .limits import STEERING, STEERING_ALLOWANCE

# Dead time beyond that of the model, not learnt yet: three periods of the paper; assumed.
_UNKNOWN_S: Final = 0.6
_INTERVAL_S: Final = 0.1  # of dead times that share a residual
_REFUTED_S: Final = 60.0  # for which an interval is out once its sum has passed the limit; assumed
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

    sum: Cusum = field(default_factory=lambda: Cusum(STEERING_ALLOWANCE, STEERING))
    refuted_s: float = -math.inf  # time at which its sum was above the limit
    refuted: bool = False


class SteeringMonitor:
    """Compares one measured steering angle with the response of a model to the commands.

    The model is that of the vehicle: rate limit and lag, with the parameters learnt so far. The
    dead time may not be learnt yet, or wrongly: each interval of possible ones has a residual of
    its own, the distance of the mean sample of a tick from what the response has covered in it, and
    a `Cusum` that sums it up. The statistic is the least of the sums, since a healthy valve agrees
    with one of them for good, and a stuck valve with none. An interval that the valve contradicts
    while it follows another one is left out for a minute. Allowance and limit grow with the noise
    of that mean, where it is above that of the paper's sensor, and the allowance is at least twice
    the root mean square of the residuals of a healthy valve with play. A valve that is stuck shows
    as soon as the command leaves its angle by more than the allowance.
    """

    def __init__(self, axis: Input) -> None:
        self.name = _NAMES[axis]
        self.limit = STEERING
        self._front = axis is Input.DELTA_T
        self._sensor = _SENSORS[axis]
        self._intervals = [_Interval()]
        self._times: list[float] = []  # of the response [s]
        self._angles: list[float] = []  # the response at these times [rad]
        self._valve = self._angle = math.nan
        self._sample = math.nan  # the last one [rad]
        self._changes = deque[float](maxlen=_SCATTER - 1)  # squares, between recent samples
        self._mean_square = _PLAY_AT_START**2  # of the residual
        self._compared_s = math.nan  # time of the last comparison, or of the first sample

    @property
    def statistic(self) -> float:
        """Least of the sums of residuals [rad]."""
        return self._least.largest

    @property
    def residual(self) -> float:
        """Latest residual in the interval with the least sum [rad]."""
        return self._least.residual

    @property
    def _least(self) -> Cusum:
        possible = [item.sum for item in self._intervals if not item.refuted]
        return min(possible, key=lambda item: (item.largest, abs(item.residual)))

    def _refute(self, time_s: float) -> None:
        """Leave out intervals whose sums are above the limit while that of another one is not."""
        follows = self._least.largest <= STEERING
        for item in self._intervals:
            if follows and item.sum.largest > STEERING:
                item.refuted_s = time_s
            item.refuted = time_s - item.refuted_s < _REFUTED_S

    def observe(self, observation: Observation) -> None:
        """Advance the model by the last command and compare it with the samples."""
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
        if math.isnan(means[-1]):
            return
        while len(self._intervals) < count:
            self._intervals.append(_Interval())
        del self._intervals[count:]
        play = 2.0 * math.sqrt(self._mean_square) / STEERING_ALLOWANCE
        scale = max(1.0, play, self._noise(len(values)) / _QUIET)
        for interval, (one, other) in zip(self._intervals, pairwise(means), strict=True):
            residual = mean - min(max(mean, min(one, other)), max(one, other))
            interval.sum.add(residual / scale)
        self._refute(observation.time_s)
        elapsed = observation.time_s - self._compared_s
        square = min(scale * abs(self._least.residual), _MOST_PLAY) ** 2
        self._mean_square += min(1.0, elapsed / _PLAY_S) * (square - self._mean_square)
        self._compared_s = observation.time_s

    def _response(self, begin_s: float, end_s: float) -> float:
        """Return the mean response of a time, NaN where it is not kept."""
        if begin_s < self._times[0]:
            return math.nan
        begin, end = bisect_left(self._times, begin_s - _STEP_S), bisect_right(self._times, end_s)
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

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that cannot be steered stops."""
        return Alarm(self.name, f"{self.name} does not follow its command", Reaction.STOP)
