"""Extended Kalman filter over the articulated kinematics, for samples in any order."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

import numpy as np

from ..errors import InvalidTuning
from ..types import Command, Estimate, Innovation, Measurement, Sensor, State
from ..vehicle import Vehicle
from .antenna_lean import AntennaLean
from .augmented_state import SIZE, STATES, AugmentedState, estimate_of
from .dead_time import HeldCommands, after_dead_times
from .kalman_filter import SAME_TIME_S, FilterState, KalmanFilter
from .measurement_model import KERNEL_INDEX, LENGTH
from .noise import ProcessNoise, SensorNoise
from .warm_up import run_all_kernels


class ExtendedKalmanFilter:
    """Estimate state and disturbance from time-stamped samples that may come late.

    Between samples the model of `augmented_state` runs under the command of that time: the
    steering valves approach the command at their rate limit, the steering angles follow the valves
    with a lag. The covariance gathers process noise. Every sample corrects the estimate at its own
    time, one after the other, in Joseph's form (Bucy and Joseph 1968).

    Samples may come late and in any order. The filter keeps the states, samples and commands of
    the last `memory_s`. A late sample takes it back to the last state before the sample's time;
    from there all samples are processed again in the order of their times. The estimate therefore
    does not depend on the order of arrival.

    The filter starts at the first time with a reading of every sensor; earlier estimates are NaN.
    The gate rejects a sample whose innovation would be exceeded with probability
    `gate_probability` only. If it has rejected a sensor for a whole second without a break, the
    filter may be wrong: it then accepts the samples, with their noise raised until they just pass.
    Samples that are not finite, older than the memory, from the future or repeated are rejected.
    Samples of sensors without a model in `measurement_model` are ignored; those of the IMUs serve
    to correct antenna positions, see `AntennaLean`.

    Each input of a command acts after its own dead time (`Vehicle.dead_times`).

    Time stamps may count from any epoch. Those that differ by less than `SAME_TIME_S` count as
    equal wherever the filter compares times of samples with times of updates.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.

    Example:
        >>> ekf = ExtendedKalmanFilter(Vehicle())
        >>> estimate = ekf.update(0.0, [], None)  # no sample yet: the state is not known
        >>> estimate.state.shape, bool(np.isnan(estimate.state).all())
        ((7,), True)
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
        self._sensor_noise = sensor_noise or SensorNoise()
        self._process_noise = process_noise or ProcessNoise()
        heights = self._sensor_noise.antenna_height_t, self._sensor_noise.antenna_height_i
        self._lean = AntennaLean(heights, memory_s)
        self._filter = KalmanFilter(
            vehicle, self._sensor_noise, self._process_noise, gate_probability
        )
        self._samples: list[Measurement] = []  # by time, then sensor
        self._accepted: dict[tuple[Sensor, float], bool] = {}  # by the gate, for each sample
        self._commands: HeldCommands = []
        self._acting = self._commands  # the same behind the dead times
        self._states: list[FilterState] = []  # after the samples of each time

    def warm_up(self) -> None:
        """Compile every kernel that an update may run; the filter's state does not change."""
        run_all_kernels(ExtendedKalmanFilter(self._vehicle), self._vehicle)

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s`, as `Estimator.update`."""
        held = None if command is None else command.as_array().astype(float)
        self._commands.append((time_s, held))
        self._acting = after_dead_times(self._commands, self._vehicle)
        usable: list[Measurement] = []
        refused: list[Innovation] = []
        for sample in self._lean.corrected(measurements, self._headings(measurements)):
            if sample.sensor not in LENGTH:
                continue
            if self._usable(sample, time_s):
                usable.append(sample)
                self._accepted[_key(sample)] = False
            else:
                refused.append(Innovation(sample.sensor, math.inf, LENGTH[sample.sensor], False))
        in_order = sorted(usable, key=_order)
        late = in_order and self._samples and _order(in_order[0]) < _order(self._samples[-1])
        self._samples += in_order
        if late:
            self._samples.sort(key=_order)
        innovations: dict[tuple[Sensor, float], Innovation] = {}
        if self._states:
            if usable:
                innovations = self._replay(in_order[0].time_s)
        elif self._start():
            self._replay(math.inf)
        self._forget(time_s)
        if not self._states:
            return self._no_estimate(time_s, tuple(refused))
        state = self._states[-1].copy()
        self.predict(state, time_s)
        new = [innovations[_key(sample)] for sample in usable if innovations]
        return self.estimate(state, (*refused, *new))

    def _headings(self, measurements: Sequence[Measurement]) -> tuple[float, float]:
        """Return the yaw of tractor and trailer [rad], before the start the line between both."""
        if self._states:
            psi_t, psi_i = self._states[-1].augmented[0, State.PSI_T : State.DELTA_T].tolist()
            return psi_t, psi_i
        place = {m.sensor: m.value for m in (*self._samples, *measurements) if len(m.value) == 2}
        if Sensor.GNSS_TRACTOR not in place or Sensor.GNSS_TRAILER not in place:
            return 0.0, 0.0
        (x, y), (x_i, y_i) = place[Sensor.GNSS_TRACTOR], place[Sensor.GNSS_TRAILER]
        line = math.atan2(y - y_i, x - x_i)
        return line, line

    def _usable(self, sample: Measurement, time_s: float) -> bool:
        """Return whether a sample is complete, finite, new and neither late nor early."""
        sampled, value = sample.time_s, sample.value
        return (
            len(value) == LENGTH[sample.sensor]
            and all(map(math.isfinite, (sampled, *value)))
            and time_s - self._memory_s - SAME_TIME_S <= sampled <= time_s + SAME_TIME_S
            and _key(sample) not in self._accepted
            and (not self._states or sampled > self._states[0].time_s)
        )

    def _start(self) -> bool:
        """Start at the first time with a reading of every sensor; return whether there is one."""
        of_sensor = {s: [m for m in self._samples if m.sensor is s] for s in LENGTH}
        if not all(of_sensor.values()):
            return False
        begin = max(samples[0].time_s for samples in of_sensor.values())
        first = {s: [m for m in of_sensor[s] if m.time_s <= begin][-1] for s in LENGTH}
        self._states = [self._filter.start(first)]
        return True

    def _replay(self, since_s: float) -> dict[tuple[Sensor, float], Innovation]:
        """Process all samples since `since_s`, and all that are newer than the newest state.

        Returns their innovations by sensor and time.
        """
        while self._states[-1].time_s >= since_s:
            self._states.pop()
        state = self._states[-1].copy()
        innovations = {}
        begin = bisect_right(self._samples, state.time_s, key=_time)
        for sample in self._samples[begin:]:
            if sample.time_s > state.time_s:
                if state.time_s > self._states[-1].time_s:
                    self._states.append(state.copy())
                self.predict(state, sample.time_s)
            innovation = self._filter.correct(state, sample)
            self._accepted[_key(sample)] = innovation.accepted
            innovations[_key(sample)] = innovation
        if state.time_s > self._states[-1].time_s:
            self._states.append(state)
        return innovations

    def estimate(self, state: FilterState, innovations: tuple[Innovation, ...]) -> Estimate:
        """Return the estimate for a controller from a state of the filter."""
        rim, scales = float(state.augmented[0, AugmentedState.RIM]), state.scales[0]
        unfollowed = np.zeros(STATES)
        unfollowed[[State.X, State.Y]] = self._sensor_noise.position_variance
        unfollowed[State.V] = self._process_noise.fast_speed_variance(rim, scales)
        return estimate_of(
            state.augmented[0],
            state.covariances[0],
            state.time_s,
            self._vehicle,
            innovations,
            unfollowed,
        )

    def predict(self, state: FilterState, time_s: float) -> None:
        """Advance `state` to `time_s` in place under the commands of the time in between."""
        for end_s, command in self.commands(state.time_s, time_s):
            self._filter.predict(state, end_s, command)
        state.time_s = time_s

    def commands(self, since_s: float, until_s: float) -> HeldCommands:
        """Return end time [s] and value (3,) of every command that acts between two times.

        None where no command is known, NaN where one is known of some inputs only.
        """
        held = []
        for end_s, command in self._acting:
            if until_s - since_s <= SAME_TIME_S:
                break
            if end_s > since_s + SAME_TIME_S:
                since_s = end_s if end_s < until_s - SAME_TIME_S else until_s
                held.append((since_s, command))
        return held

    def memory(self) -> tuple[list[FilterState], list[Measurement]]:
        """Return the states in memory and the accepted samples after the first of them."""
        if not self._states:
            return [], []
        begin = self._states[0].time_s
        samples = [s for s in self._samples if s.time_s > begin and self._accepted[_key(s)]]
        return self._states, samples

    def _forget(self, time_s: float) -> None:
        """Drop all that no sample within the memory can need."""
        oldest = time_s - self._memory_s - SAME_TIME_S
        if self._states:
            older = sum(state.time_s < oldest for state in self._states)
            del self._states[: max(0, older - 1)]
            oldest = min(oldest, self._states[0].time_s)
        else:  # the newest reading of a sensor counts until the filter starts
            newest = {sample.sensor: sample for sample in self._samples}
            kept = [s for s in self._samples if s.time_s >= oldest or newest[s.sensor] is s]
            self._samples, self._accepted = kept, {_key(sample): False for sample in kept}
            oldest = min(map(_time, kept), default=oldest)
        dropped = bisect_left(self._samples, oldest, key=_time)
        for sample in self._samples[:dropped]:
            del self._accepted[_key(sample)]
        del self._samples[:dropped]
        oldest -= float(self._vehicle.dead_times.max())
        self._commands = [item for item in self._commands if item[0] >= oldest]

    def _no_estimate(self, time_s: float, innovations: tuple[Innovation, ...]) -> Estimate:
        augmented, covariance = np.full(SIZE, math.nan), np.full((SIZE, SIZE), math.nan)
        return estimate_of(augmented, covariance, time_s, self._vehicle, innovations)


def _time(sample: Measurement) -> float:
    return sample.time_s


def _key(sample: Measurement) -> tuple[Sensor, float]:
    return sample.sensor, sample.time_s


def _order(sample: Measurement) -> tuple[float, int]:
    return sample.time_s, KERNEL_INDEX[sample.sensor]
