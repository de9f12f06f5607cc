"""Extended Kalman filter over the articulated kinematics, for samples in any order."""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..errors import InvalidTuning
from ..models.augmented_state import (
    GYROS,
    KERNEL_INDEX,
    LENGTH,
    SIZE,
    STATES,
    AugmentedState,
    estimate_of,
    predicted_measurement,
)
from ..types import Command, Estimate, Estimator, Innovation, Measurement, Sensor, State
from ..vehicle import Vehicle
from .filter import (
    SAME_TIME_S,
    FilterState,
    HeldCommands,
    KalmanFilter,
    SampleRow,
    after_dead_times,
)
from .noise import ProcessNoise, SensorNoise

_BODIES = ((Sensor.GNSS_TRACTOR, Sensor.IMU_TRACTOR), (Sensor.GNSS_TRAILER, Sensor.IMU_TRAILER))


class LeverArm:
    """Positions of axle points from those of antennas on masts above them.

    An antenna at height h moves h sin(roll) to the right of its point and h cos(roll) sin(pitch)
    ahead of it; roll is positive with the left side up, pitch with the nose down. The attitude is
    that of the IMU sample of the body that is nearest in time; without one, and for a height of 0,
    a position stays as it is.

    Args:
        heights_m: of the antennas of tractor and trailer above the axle points [m].
        memory_s: time for which samples of the IMUs are kept, at least the latency of GNSS.

    Examples:
        >>> arm = LeverArm((2.0, 0.0), memory_s=1.0)
        >>> imu = Measurement(0.2, Sensor.IMU_TRACTOR, (0.0, 0.1, 0.0))  # left side up by 0.1 rad
        >>> gnss = Measurement(0.2, Sensor.GNSS_TRACTOR, (5.0, 3.0))
        >>> corrected, _ = arm.corrected([gnss, imu], headings=(0.0, 0.0))  # faces east
        >>> round(corrected.value[1], 3)
        3.2
    """

    def __init__(self, heights_m: tuple[float, float], memory_s: float) -> None:
        self._memory_s = memory_s
        # GNSS, IMU, height of the antenna above the axle point
        self._bodies = [(*b, h) for b, h in zip(_BODIES, heights_m, strict=True) if h > 0.0]
        self._attitudes: dict[Sensor, list[Measurement]] = {imu: [] for _, imu, _ in self._bodies}

    @property
    def corrects(self) -> bool:
        """Whether there is an antenna above its point."""
        return bool(self._bodies)

    def corrected(
        self, samples: Sequence[Measurement], headings: tuple[float, float]
    ) -> Sequence[Measurement]:
        """Return the samples with every position moved to its axle point."""
        for sensor, kept in self._attitudes.items():
            kept += [s for s in samples if s.sensor is sensor and all(map(math.isfinite, s.value))]
            newest = max((sample.time_s for sample in kept), default=0.0)
            kept[:] = [sample for sample in kept if sample.time_s >= newest - self._memory_s]
        return [self._moved(sample, headings) for sample in samples]

    def _moved(self, sample: Measurement, headings: tuple[float, float]) -> Measurement:
        for gnss, imu, height_m in self._bodies:
            attitudes = self._attitudes[imu]
            if sample.sensor is gnss and attitudes and len(sample.value) == 2:
                near = min(attitudes, key=lambda item: abs(item.time_s - sample.time_s))
                _, roll, pitch = near.value
                right = height_m * math.sin(roll)
                ahead = height_m * math.cos(roll) * math.sin(pitch)
                yaw = headings[sample.sensor is Sensor.GNSS_TRAILER]
                cos, sin = math.cos(yaw), math.sin(yaw)
                x, y = sample.value
                value = (x - ahead * cos - right * sin, y - ahead * sin + right * cos)
                return replace(sample, value=value)
        return sample


_Key = tuple[float, int]  # time [s] and `SensorIndex` of a sample
_SENSORS: Final = {
    i: (sensor, LENGTH.get(sensor, 3)) for sensor, i in (KERNEL_INDEX | GYROS).items()
}
_WEIGHED: Final = frozenset(KERNEL_INDEX.values())  # not those of the gyros


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

    The filter starts at the first time with a reading of every sensor, the two positions being
    apart; earlier estimates are NaN.
    The gate rejects a sample whose innovation would be exceeded with probability
    `gate_probability` only. If it has rejected a sensor for a whole second without a break, the
    filter may be wrong: it then accepts the samples, with their noise raised until they just pass.
    Samples that are not finite, older than the memory, from the future or repeated are rejected.
    Samples of sensors without a model in `measurement_model` are ignored; those of the IMUs serve
    to correct antenna positions, see `LeverArm`.

    Each input of a command acts after its own dead time (`Vehicle.dead_times`).

    Time stamps may count from any epoch. Those that differ by less than `SAME_TIME_S` count as
    equal wherever the filter compares times of samples with times of updates.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.

    Examples:
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
        memory_s: float = 2.5,
    ) -> None:
        if not 0.0 < memory_s < math.inf:
            raise InvalidTuning(f"memory_s: got {memory_s}, must be finite and above 0")
        self._vehicle = vehicle
        self._memory_s = memory_s
        self._sensor_noise = sensor_noise or SensorNoise()
        self._process_noise = process_noise or ProcessNoise()
        heights = self._sensor_noise.antenna_height_t, self._sensor_noise.antenna_height_i
        self._indices = KERNEL_INDEX | (GYROS if self._sensor_noise.yaw_rate else {})
        self._arm = LeverArm(heights, memory_s)
        self._longest_dead_time_s = float(vehicle.dead_times.max())
        self._unfollowed = np.zeros(STATES)  # variances of what no state follows
        self._unfollowed[[State.X, State.Y]] = self._sensor_noise.position_variance
        self._filter = KalmanFilter(
            vehicle, self._sensor_noise, self._process_noise, gate_probability
        )
        self._samples: list[SampleRow] = []  # by time, then sensor
        self._accepted: dict[_Key, bool] = {}  # by the gate, for each sample
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
        held = None if command is None else command.as_array()
        self._commands.append((time_s, held))
        self._acting = (
            after_dead_times(self._commands, self._vehicle)
            if self._longest_dead_time_s
            else self._commands
        )
        earliest, latest = time_s - self._memory_s - SAME_TIME_S, time_s + SAME_TIME_S
        begin = self._states[0].time_s if self._states else -math.inf
        new: list[SampleRow] = []
        refused: list[Innovation] = []
        if self._arm.corrects:
            measurements = self._arm.corrected(measurements, self._headings(measurements))
        for sample in measurements:
            index = self._indices.get(sample.sensor)
            if index is None:
                continue
            sampled, value, length = sample.time_s, sample.value, _SENSORS[index][1]
            key = sampled, index
            if (
                len(value) == length
                and all(map(math.isfinite, value))
                and earliest <= sampled <= latest
                and key not in self._accepted
                and sampled > begin
            ):
                x, y, z = value if length == 3 else (value[0], value[-1], 0.0)
                new.append((sampled, index, x, y, z))
                self._accepted[key] = False
            else:
                refused.append(Innovation(sample.sensor, math.inf, length, False))
        in_order = sorted(new)
        late = in_order and self._samples and in_order[0] < self._samples[-1]
        self._samples += in_order
        if late:
            self._samples.sort()
        innovations: dict[_Key, Innovation] = {}
        if self._states:
            if new:
                innovations = self._replay(in_order[0][0])
        elif self._start():
            self._replay(math.inf)
        self._forget(time_s)
        if not self._states:
            return self._no_estimate(time_s, tuple(refused))
        state = self._states[-1]
        if time_s - state.time_s > SAME_TIME_S:
            state = state.copy()
            self.predict(state, time_s)
        weighed = [innovations[row[:2]] for row in new if row[1] in _WEIGHED] if innovations else []
        return self.estimate(state, time_s, (*refused, *weighed))

    def _headings(self, measurements: Sequence[Measurement]) -> tuple[float, float]:
        """Return the yaw of tractor and trailer [rad], before the start the line between both."""
        if self._states:
            psi_t, psi_i = self._states[-1].augmented[0, State.PSI_T : State.DELTA_T].tolist()
            return psi_t, psi_i
        kept = map(_measurement, self._samples)
        place = {m.sensor: m.value for m in (*kept, *measurements) if len(m.value) == 2}
        if Sensor.GNSS_TRACTOR not in place or Sensor.GNSS_TRAILER not in place:
            return 0.0, 0.0
        (x, y), (x_i, y_i) = place[Sensor.GNSS_TRACTOR], place[Sensor.GNSS_TRAILER]
        line = math.atan2(y - y_i, x - x_i)
        return line, line

    def _start(self) -> bool:
        kept = [_measurement(row) for row in self._samples]
        of_sensor = {s: [m for m in kept if m.sensor is s] for s in LENGTH}
        if not all(of_sensor.values()):
            return False
        begin = max(samples[0].time_s for samples in of_sensor.values())
        first = {s: [m for m in of_sensor[s] if m.time_s <= begin][-1] for s in LENGTH}
        if first[Sensor.GNSS_TRACTOR].value == first[Sensor.GNSS_TRAILER].value:
            return False  # receivers that are not ready, or too coarse, give no heading
        self._states = [self._filter.start(first)]
        return True

    def _replay(self, since_s: float) -> dict[_Key, Innovation]:
        """Process all samples since `since_s`, and all that are newer than the newest state.

        Returns their innovations.
        """
        while self._states[-1].time_s >= since_s:
            self._states.pop()
        start = self._states[-1]
        samples = self._samples[bisect_right(self._samples, start.time_s, key=_time) :]
        if not samples:
            return {}
        held = self.commands(start.time_s, samples[-1][0])
        results, states = self._filter.process(start, samples, held)
        self._states += states
        innovations: dict[_Key, Innovation] = {}
        for row, result in zip(samples, results.tolist(), strict=True):
            key, (normalised, log_determinant, first, second, passed) = row[:2], result
            self._accepted[key] = accepted = passed == 1.0
            sensor, length = _SENSORS[key[1]]
            whitened = (first, second) if length == 2 else (first,)
            item = (sensor, normalised, length, accepted, whitened, log_determinant)
            innovations[key] = Innovation._make(item)
        return innovations

    def estimate(
        self, state: FilterState, time_s: float, innovations: tuple[Innovation, ...]
    ) -> Estimate:
        """Return the estimate for a controller from a state of the filter at `time_s`."""
        augmented, scales = state.augmented[0], state.scales[0]
        rim = augmented.item(AugmentedState.RIM)
        unfollowed = self._unfollowed.copy()
        unfollowed[State.V] = self._process_noise.fast_speed_variance(rim, scales)
        return estimate_of(
            augmented,
            state.covariances[0],
            time_s,
            self._vehicle,
            innovations,
            unfollowed,
            scales.copy(),
        )

    def predict(self, state: FilterState, time_s: float) -> None:
        """Advance `state` to `time_s` in place under the commands of the time in between."""
        if time_s - state.time_s > SAME_TIME_S:
            self._filter.predict(state, time_s, self.commands(state.time_s, time_s))
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
        rows = [
            row
            for row in self._samples
            if row[0] > begin and row[1] in _WEIGHED and self._accepted[row[:2]]
        ]
        return self._states, [_measurement(row) for row in rows]

    def _forget(self, time_s: float) -> None:
        oldest = time_s - self._memory_s - SAME_TIME_S
        if self._states:
            while len(self._states) > 1 and self._states[1].time_s < oldest:
                del self._states[0]
            oldest = min(oldest, self._states[0].time_s)
        else:  # the newest reading of a sensor counts until the filter starts
            newest = {row[1]: row for row in self._samples}
            kept = [row for row in self._samples if row[0] >= oldest or newest[row[1]] is row]
            self._samples, self._accepted = kept, {row[:2]: False for row in kept}
            oldest = min(map(_time, kept), default=oldest)
        dropped = bisect_left(self._samples, oldest, key=_time)
        for row in self._samples[:dropped]:
            del self._accepted[row[:2]]
        del self._samples[:dropped]
        oldest -= self._longest_dead_time_s
        self._commands = [item for item in self._commands if item[0] >= oldest]

    def _no_estimate(self, time_s: float, innovations: tuple[Innovation, ...]) -> Estimate:
        augmented, covariance = np.full(SIZE, math.nan), np.full((SIZE, SIZE), math.nan)
        return estimate_of(augmented, covariance, time_s, self._vehicle, innovations)


def _time(row: SampleRow) -> float:
    return row[0]


def _measurement(row: SampleRow) -> Measurement:
    time_s, index, *value = row
    sensor, length = _SENSORS[index]
    return Measurement(time_s, sensor, tuple(value[:length]))


def run_all_kernels(estimator: Estimator, vehicle: Vehicle) -> None:
    """Update a new `estimator` of `vehicle` with exact readings of a vehicle at rest.

    The updates cover the start, samples of every sensor with and without a command, late samples
    and no samples: all types of arguments for which numba compiles a kernel.
    """
    stop = Command(0.0, 0.0, 0.0)

    def samples(time_s: float) -> list[Measurement]:
        values = {s: predicted_measurement(s, np.zeros(SIZE), vehicle)[0] for s in LENGTH}
        return [Measurement(time_s, s, tuple(value.tolist())) for s, value in values.items()]

    estimator.update(0.0, samples(0.0), None)
    estimator.update(0.2, samples(0.2), None)
    estimator.update(0.4, samples(0.4), stop)
    estimator.update(0.6, samples(0.3), stop)
    estimator.update(0.8, [], stop)
