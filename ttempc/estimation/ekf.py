"""Extended Kalman filter over the articulated kinematics, for samples in any order."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..layout import (
    ESTIMATE,
    INNOVATION,
    SAMPLE,
    Innovations,
    estimate_view,
    measurements_of,
    sample_rows,
)
from ..models.augmented_state import MAPPED, STATES, AugmentedState
from ..sensors import STARTING_SENSORS
from ..types import Command, Estimate, Estimator, FloatArray, Input, Measurement, Sensor
from ..vehicle import Vehicle
from .filter.history import HISTORY, new_memory, with_space
from .filter.observe import observe_filter
from .filter.records import SNAPSHOT, filter_parameters
from .filter.start import initial_snapshot
from .noise import ProcessNoise, SensorNoise

_ESTIMATE_SIZE: Final = ESTIMATE.itemsize // 8
NO_CHANGE: Final = np.zeros(MAPPED)
_NOT_KNOWN: Final = np.full(len(Input), math.nan)


class ExtendedKalmanFilter(Estimator):
    """Estimate state and disturbance from time-stamped samples that may come late.

    Between samples the model of `augmented_state` runs under the command of that time: the
    steering valves approach the command at their rate limit, the steering angles follow the valves
    with a lag. The covariance gathers process noise. Every sample corrects the estimate at its own
    time, one after the other.

    Samples may come late and in any order. The filter remembers the states, samples and commands of
    the last `memory_s`. A late sample takes it back to the last state before the sample's time;
    from there all samples are processed again in the order of their times. The estimate therefore
    does not depend on the order of arrival.

    The filter starts at the first time with a reading of every sensor in
    `ttempc.sensors.STARTING_SENSORS`, the two positions being apart; earlier estimates are NaN.
    The gate rejects a sample whose innovation would be exceeded with probability
    `gate_probability` only. If it has rejected a sensor for a whole second without a break, the
    filter may be wrong: it then accepts the samples, with their noise raised until they just pass.
    Samples that are not finite, older than the memory, from the future or repeated are rejected.
    Samples of sensors that `ttempc.sensors.SENSORS` does not name are ignored. Those of the IMUs
    also correct antenna positions, see `ttempc.learning.replay.axle_points`.

    Each input of a command acts after its own dead time (`Vehicle.dead_times`). After a gap without
    updates and samples the filter starts anew, see `observe_filter`, at a cost that does not depend
    on the length of the gap.

    Time stamps may count from any epoch. Those that differ by less than `SAME_TIME_S` count as
    equal wherever the filter compares times of samples with times of updates.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1, or the memory not above 0.
        UnknownSensor: the table of sensors has one for which the filter has no equation.

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
        self._vehicle = vehicle
        self._sensors = sensor_noise or SensorNoise()
        self._process = process_noise or ProcessNoise.of(vehicle)
        self.parameters = filter_parameters(
            vehicle, self._sensors, self._process, gate_probability, memory_s
        )
        self._memory = new_memory()

    def warm_up(self) -> None:
        """Compile or load what an update needs; the filter's state does not change."""
        ExtendedKalmanFilter(self._vehicle).update(0.0, [], None)

    def update(
        self,
        time_s: float,
        measurements: Sequence[Measurement] | FloatArray,
        command: Command | None,
    ) -> Estimate:
        """Return the estimate at `time_s`, as `Estimator.update`.

        The samples may also be rows (n, 5), see `ttempc.layout.SampleColumn`.

        Raises:
            InvalidSamples: rows of another shape, or of a sensor that does not exist.
        """
        rows = sample_rows(measurements)
        inputs = _NOT_KNOWN if command is None else command.as_array()
        estimate, innovations = self.observe(float(time_s), rows, inputs)
        return estimate_view(estimate, Innovations(innovations))

    def observe(
        self, time_s: float, rows: FloatArray, command: FloatArray, change: FloatArray = NO_CHANGE
    ) -> tuple[FloatArray, FloatArray]:
        """Do `update` on flat arrays; return `ESTIMATE` and rows (n, `INNOVATION`).

        `rows` are samples (n, `SAMPLE`), `command` is NaN where none is known, `change` (3,) is by
        how much the mapped disturbances change over its period [rad], see `predict_until`.
        """
        self._memory = with_space(self._memory, len(rows))
        estimate = np.empty(_ESTIMATE_SIZE)
        innovations = np.zeros((len(rows), INNOVATION))
        tick = (time_s, np.concatenate([command, change]), estimate)
        if observe_filter(self.parameters, self._memory, rows, *tick, innovations):
            self._start()
            observe_filter(self.parameters, self._memory, rows[:0], *tick, innovations[:0])
        return estimate, innovations

    def _start(self) -> None:
        """Write the first snapshot, from the first readings with one of every sensor.

        Receivers that are not ready, or too coarse, give no heading: then there is none.
        """
        h = self._memory.history.view(HISTORY)[0]
        samples = measurements_of(self._memory.samples[: h["samples"], :SAMPLE])
        of_sensor = {
            sensor: [sample for sample in samples if sample.sensor is sensor]
            for sensor in STARTING_SENSORS
        }
        begin_s = max(own[0].time_s for own in of_sensor.values())
        first = {
            sensor: [sample for sample in own if sample.time_s <= begin_s][-1]
            for sensor, own in of_sensor.items()
        }
        if first[Sensor.GNSS_TRACTOR].value == first[Sensor.GNSS_TRAILER].value:
            return
        row = initial_snapshot(first, self._vehicle, self._sensors, self._process)
        if h["resumes"]:
            start = row.view(SNAPSHOT)[0]
            before = self._memory.snapshots[-1].view(SNAPSHOT)[0]
            disturbances = slice(STATES, AugmentedState.GYRO_T)
            start["augmented"][0, disturbances] = before["augmented"][0, disturbances]
            for name in ("scales", "information", "slopes"):
                start[name] = before[name]
        self._memory.snapshots[0] = row
        h["oldest"] = 0
        h["snapshots"] = 1
        h["resumes"] = 0

    def snapshots(self) -> NDArray[np.void]:
        """Return every `SNAPSHOT` in memory, oldest first."""
        h = self._memory.history.view(HISTORY)[0]
        ring = len(self._memory.snapshots) - 1
        order = (h["oldest"] + np.arange(h["snapshots"])) % ring
        return self._memory.snapshots[order].view(SNAPSHOT)[:, 0]
