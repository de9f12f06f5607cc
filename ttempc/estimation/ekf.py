"""Extended Kalman filter over the articulated kinematics, from samples in any order."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

import numpy as np

from ..errors import InvalidTuning
from ..types import Command, Estimate, FloatArray, Innovation, Measurement, Sensor
from ..vehicle import Vehicle
from .augmented_state import SIZE, estimate_of
from .kalman_filter import BeliefFilter, FilterState
from .measurement_model import LENGTH, PLACE
from .noise import ProcessNoise, SensorNoise

_SAME_TIME_S = 1e-9


class ExtendedKalmanFilter:
    """Estimate state and disturbance from samples at their own times, whenever they come.

    Between samples the model of `augmented_state` runs under the command that was held then, which
    the steering valves approach at their rate limit and the steering angles with their lag behind
    that. The covariance gathers process noise, and every sample is taken in at its own time, one
    after the other, in Joseph's form (Bucy and Joseph 1968).

    Samples may come late and in any order. The filter keeps its states, the samples and the
    commands of the last `memory_s`; a late sample takes it back to the last state before that
    sample's time, from where all samples since are taken in again in the order of their times.
    The estimate therefore does not depend on the order in which they came. One that is older than
    the memory is kept out.

    The filter starts with the first time at which there is a reading of every sensor; until then
    estimates are NaN. A sample whose innovation would be exceeded with probability
    `gate_probability` only is kept out. A sensor that has been kept out for a whole second
    without a break may be right and the filter wrong: its samples are then taken in, with their
    noise raised until they just pass. Samples that are not finite, too late, from the future or
    of a time that the sensor has given already are kept out, too; those of sensors without a
    model in `ttempc.estimation.measurement_model` are passed over.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensor_noise: SensorNoise | None = None,
        process_noise: ProcessNoise | None = None,
        gate_probability: float = 1e-4,
        memory_s: float = 1.0,
    ) -> None:
        if not 0.0 < memory_s < math.inf:
            raise InvalidTuning(f"memory_s: got {memory_s}, must be finite and above 0")
        self._vehicle = vehicle
        self._memory_s = memory_s
        self._filter = BeliefFilter(
            vehicle,
            sensor_noise or SensorNoise(),
            process_noise or ProcessNoise(),
            gate_probability,
        )
        self._samples: list[Measurement] = []  # by time, then sensor
        self._known: dict[tuple[Sensor, float], bool] = {}  # whether the gate let each of them in
        self._commands: list[tuple[float, FloatArray | None]] = []  # until when each was held
        self._states: list[FilterState] = []  # after the samples of each time

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s` after all `measurements` up to it."""
        self._commands.append((time_s, None if command is None else command.as_array()))
        found: dict[tuple[Sensor, float], Innovation] = {}  # of what came in now
        refused: list[Innovation] = []
        taken: list[Measurement] = []
        for sample in measurements:
            if sample.sensor not in LENGTH:  # as an IMU's: there is no model of it
                continue
            if self._usable(sample, time_s):
                taken.append(sample)
                self._known[sample.sensor, sample.time_s] = False
            else:
                refused.append(Innovation(sample.sensor, math.inf, LENGTH[sample.sensor], False))
        in_order = sorted(taken, key=_order)
        late = in_order and self._samples and _order(in_order[0]) < _order(self._samples[-1])
        self._samples += in_order
        if late:
            self._samples.sort(key=_order)
        if self._states:
            fresh = {(sample.sensor, sample.time_s) for sample in taken}
            if taken:
                found = self._replay(min(sample.time_s for sample in taken), fresh)
        elif self._start():
            self._replay(math.inf, set())
        self._forget(time_s)
        if not self._states:
            return self._nothing_known(time_s, tuple(refused))
        now = self._states[-1].copy()
        self.predict(now, time_s)
        innovations = (*refused, *(found[s.sensor, s.time_s] for s in taken if found))
        return estimate_of(now.beliefs[0], now.covariances[0], time_s, self._vehicle, innovations)

    def _usable(self, sample: Measurement, time_s: float) -> bool:
        """Whether a sample is complete, finite, and neither late, early nor there already."""
        sampled, value = sample.time_s, sample.value
        return (
            len(value) == LENGTH[sample.sensor]
            and all(map(math.isfinite, (sampled, *value)))
            and time_s - self._memory_s - _SAME_TIME_S <= sampled <= time_s + _SAME_TIME_S
            and (sample.sensor, sampled) not in self._known
            and (not self._states or sampled > self._states[0].time_s)
        )

    def _start(self) -> bool:
        """Start from the first time at which there is a reading of every sensor, if there is."""
        of = {s: [m for m in self._samples if m.sensor is s] for s in LENGTH}
        if not all(of.values()):
            return False
        begin = max(readings[0].time_s for readings in of.values())
        first = {s: [m for m in of[s] if m.time_s <= begin][-1] for s in LENGTH}
        self._states = [self._filter.start(first)]
        return True

    def _replay(
        self, since_s: float, wanted: set[tuple[Sensor, float]]
    ) -> dict[tuple[Sensor, float], Innovation]:
        """Take in all samples from `since_s` on, and those never taken in; say what is `wanted`."""
        while self._states[-1].time_s >= since_s:
            self._states.pop()
        now = self._states[-1].copy()
        said = {}
        begin = bisect_right(self._samples, now.time_s, key=lambda sample: sample.time_s)
        for sample in self._samples[begin:]:
            if sample.time_s > now.time_s:
                if now.time_s > self._states[-1].time_s:
                    self._states.append(now.copy())
                self.predict(now, sample.time_s)
            innovation = self._filter.take_in(now, sample)
            key = sample.sensor, sample.time_s
            self._known[key] = innovation.accepted
            if key in wanted:
                said[key] = innovation
        if now.time_s > self._states[-1].time_s:
            self._states.append(now)
        return said

    def predict(self, now: FilterState, time_s: float) -> None:
        """Run `now` on to `time_s` under the commands that were held on the way."""
        for reached, command in self.commands(now.time_s, time_s):
            self._filter.predict(now, reached, command)
        now.time_s = time_s

    def commands(self, since_s: float, until_s: float) -> list[tuple[float, FloatArray | None]]:
        """Return the commands (3,) held between two times, each with the time until which."""
        held = []
        for until, command in self._commands:
            if until_s - since_s <= _SAME_TIME_S:
                break
            if until > since_s + _SAME_TIME_S:
                since_s = until if until < until_s - _SAME_TIME_S else until_s
                held.append((since_s, command))
        return held

    def memory(self) -> tuple[list[FilterState], list[Measurement]]:
        """Return the states that are remembered and the samples let in after the first of them."""
        if not self._states:
            return [], []
        begin = self._states[0].time_s
        let_in = [
            sample
            for sample in self._samples
            if sample.time_s > begin and self._known[sample.sensor, sample.time_s]
        ]
        return self._states, let_in

    def _forget(self, time_s: float) -> None:
        """Drop what no sample that may still come can need."""
        oldest = time_s - self._memory_s - _SAME_TIME_S
        if self._states:
            last = sum(state.time_s < oldest for state in self._states)
            del self._states[: max(0, last - 1)]
            oldest = min(oldest, self._states[0].time_s)
        else:  # the newest reading of a sensor counts until the filter starts
            newest = {sample.sensor: sample for sample in self._samples}
            kept = [s for s in self._samples if s.time_s >= oldest or newest[s.sensor] is s]
            self._samples, self._known = kept, {(s.sensor, s.time_s): False for s in kept}
            oldest = min((s.time_s for s in kept), default=oldest)
        gone = bisect_left(self._samples, oldest, key=lambda sample: sample.time_s)
        for sample in self._samples[:gone]:
            del self._known[sample.sensor, sample.time_s]
        del self._samples[:gone]
        self._commands = [item for item in self._commands if item[0] >= oldest]

    def _nothing_known(self, time_s: float, innovations: tuple[Innovation, ...]) -> Estimate:
        belief, covariance = np.full(SIZE, math.nan), np.full((SIZE, SIZE), math.nan)
        return estimate_of(belief, covariance, time_s, self._vehicle, innovations)


def _order(sample: Measurement) -> tuple[float, int]:
    return sample.time_s, PLACE[sample.sensor]
