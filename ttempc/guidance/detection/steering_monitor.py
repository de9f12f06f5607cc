"""Steering command against measured angle: valves that are stuck, hard over, slow or free."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque
from typing import Final

from ...types import Command, Input, Sensor
from ...vehicle import Vehicle
from .detector import Alarm, Cusum, Observation, Reaction
from .limits import STEERING, STEERING_ALLOWANCE

_UNKNOWN_S: Final = 0.4  # of dead time that was not learnt: two periods of the paper; assumed
_STEP_S: Final = 0.02  # of the model's integration: an eighth of the paper's shortest lag
_KEPT_S: Final = 1.0  # of the response, for samples that come late
_SCATTER: Final = 25  # samples of which the noise is estimated: a second of the paper's sensors
_QUIET: Final = math.radians(1.0) / math.sqrt(5.0)  # sd of a mean of five of the paper's samples
_SENSORS: Final = {
    Input.DELTA_T: Sensor.STEERING_TRACTOR,
    Input.DELTA_I: Sensor.STEERING_TRAILER,
}
_NAMES: Final = {Input.DELTA_T: "front steering", Input.DELTA_I: "trailer steering"}


class SteeringMonitor:
    """Compares one measured steering angle with the response of a model to the commands.

    The model is that of the vehicle: dead time, rate limit, lag, with the parameters learnt so far.
    The residual is the distance of the mean sample of a tick from the interval that the response
    has covered in the last 0.4 s, since a dead time may not be learnt yet; a `Cusum` sums it up. It
    is divided by the noise of that mean over that of the paper's sensor where it is larger, so that
    allowance and limit remain the same multiples of the noise. A valve that is stuck shows as soon
    as the command leaves its angle by more than the allowance.
    """

    def __init__(self, axis: Input) -> None:
        self.name = _NAMES[axis]
        self.limit = STEERING
        self._axis = axis
        self._cusum = Cusum(STEERING_ALLOWANCE, STEERING)
        self._sent: deque[tuple[float, float]] = deque()  # start of a command [s], its value
        self._times: list[float] = []  # of the response [s]
        self._angles: list[float] = []  # the response at these times [rad]
        self._valve = self._angle = math.nan
        self._sample = math.nan  # the last one [rad]
        self._changes = deque[float](maxlen=_SCATTER - 1)  # squares, between recent samples

    @property
    def statistic(self) -> float:
        """Larger sum of the residuals [rad]."""
        return self._cusum.largest

    @property
    def residual(self) -> float:
        """Latest residual [rad]."""
        return self._cusum.residual

    def observe(self, observation: Observation) -> None:
        """Advance the model by the last command and compare it with the samples."""
        if observation.command is not None:
            self._advance(observation.time_s, observation.command, observation.vehicle)
        of_sensor = observation.of(_SENSORS[self._axis])
        samples = [sample for sample in of_sensor if math.isfinite(sample.value[0])]
        if not samples:
            return
        values = [sample.value[0] for sample in samples]
        mean = sum(values) / len(values)
        if math.isnan(self._angle):
            self._valve = self._angle = mean
            self._times.append(observation.time_s)
            self._angles.append(mean)
            return
        for value in values:
            change = value - self._sample
            if not math.isnan(change):
                self._changes.append(change * change)
            self._sample = value
        sampled = [sample.time_s for sample in samples]
        begin = bisect_left(self._times, min(sampled) - _UNKNOWN_S)
        band = self._angles[begin : bisect_right(self._times, max(sampled) + _STEP_S)]
        if band:
            residual = mean - min(max(mean, min(band)), max(band))
            self._cusum.add(residual / max(1.0, self._noise(len(values)) / _QUIET))

    def _noise(self, count: int) -> float:
        """Return the sd of the mean of `count` samples, from the differences of recent ones."""
        return math.sqrt(sum(self._changes) / (2.0 * max(1, len(self._changes)) * count))

    def _advance(self, time_s: float, command: Command, vehicle: Vehicle) -> None:
        """Continue the response to `time_s` under the `command` sent at the tick before."""
        if not self._times:
            return
        now, sent, valve, angle = self._times[-1], self._sent, self._valve, self._angle
        front = self._axis is Input.DELTA_T
        sent.append((now, command.delta_t if front else command.delta_i))
        lag = vehicle.steering_lag_t if front else vehicle.steering_lag_i
        rate = vehicle.steering_rate_t if front else vehicle.steering_rate_i
        dead_time = vehicle.dead_time_t if front else vehicle.dead_time_i
        steps = max(1, math.ceil((time_s - now) / _STEP_S - 1e-9))
        step = (time_s - now) / steps
        share, reach = 1.0 - math.exp(-step / lag), rate * step
        for n in range(steps):
            acting_s = now + n * step - dead_time + 1e-9
            while len(sent) > 1 and sent[1][0] <= acting_s:
                sent.popleft()
            begun_s, target = sent[0]
            if begun_s <= acting_s:
                valve = min(max(target, valve - reach), valve + reach)
            angle += share * (valve - angle)
            self._times.append(now + (n + 1) * step)
            self._angles.append(angle)
        self._valve, self._angle = valve, angle
        dropped = bisect_left(self._times, time_s - _UNKNOWN_S - _KEPT_S)
        del self._times[:dropped], self._angles[:dropped]

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that cannot be steered stops."""
        return Alarm(self.name, f"{self.name} does not follow its command", Reaction.STOP)
