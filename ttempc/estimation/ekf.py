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
from ..types import Command, Estimate, FloatArray, Input, Measurement, Sensor
from ..vehicle import Vehicle
from .filter import (
    HELD,
    HISTORY,
    MOMENT,
    ROW,
    filter_parameters,
    first_moment,
    observe_filter,
)
from .noise import ProcessNoise, SensorNoise

_ESTIMATE_SIZE: Final = ESTIMATE.itemsize // 8
NO_CHANGE: Final = np.zeros(MAPPED)
_NOT_KNOWN: Final = np.full(len(Input), math.nan)


class ExtendedKalmanFilter:
    """Estimate state and disturbance from time-stamped samples that may come late.

    Between samples the model of `augmented_state` runs under the command of that time: the
    steering valves approach the command at their rate limit, the steering angles follow the valves
    with a lag. The covariance gathers process noise. Every sample corrects the estimate at its own
    time, one after the other.

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
    to correct antenna positions, see `ttempc.learning.lengths.axle_points`.

    Each input of a command acts after its own dead time (`Vehicle.dead_times`). After a gap without
    updates and samples the filter starts anew, see `observe_filter`, at a cost that does not depend
    on the length of the gap.

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
        sensors, process = sensor_noise or SensorNoise(), process_noise or ProcessNoise.of(vehicle)
        self._vehicle, self._sensors, self._process = vehicle, sensors, process
        self.parameters = filter_parameters(vehicle, sensors, process, gate_probability, memory_s)
        history = np.zeros(HISTORY.itemsize // 8)
        history.view(HISTORY)["now_s"] = math.nan
        self._state = (
            history,
            np.empty((17, ROW)),
            np.empty((512, HELD)),
            np.zeros((32, 1 + len(Input) + MAPPED)),
        )

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

        The samples may also be rows (n, 5), see `ttempc.layout.SAMPLE`.

        Raises:
            InvalidSamples: rows of another shape, or of a sensor that does not exist.
        """
        rows = sample_rows(measurements)
        held = _NOT_KNOWN if command is None else command.as_array()
        estimate, innovations = self.observe(float(time_s), rows, held)
        return estimate_view(estimate, Innovations(innovations))

    def observe(
        self, time_s: float, rows: FloatArray, command: FloatArray, change: FloatArray = NO_CHANGE
    ) -> tuple[FloatArray, FloatArray]:
        """Do `update` on flat arrays; return `ESTIMATE` and rows (n, `INNOVATION`).

        `rows` are samples (n, `SAMPLE`), `command` is NaN where none is known, `change` (3,) is by
        how much the mapped disturbances change over its period [rad], see `predict_until`.
        """
        self.reserve(len(rows))
        estimate, innovations = np.empty(_ESTIMATE_SIZE), np.zeros((len(rows), INNOVATION))
        tick = time_s, np.concatenate([command, change]), estimate
        if observe_filter(self.parameters, *self._state, rows, *tick, innovations):
            self.start()
            observe_filter(self.parameters, *self._state, rows[:0], *tick, innovations[:0])
        return estimate, innovations

    def reserve(self, rows: int) -> None:
        """Make space for the samples and the command of an update: an array that is full doubles.

        The ring of moments begins at its first row then.
        """
        history, moments, samples, commands = self._state
        h = history.view(HISTORY)[0]
        more, ring = max(16, rows + 1), len(moments) - 1
        if h["moments"] + more > ring:
            order = (h["begin"] + np.arange(ring)) % ring
            larger = np.empty((2 * ring + more + 1, ROW))
            larger[:ring], larger[-1], h["begin"] = moments[order], moments[-1], 0
            moments = larger
        if h["samples"] + rows > len(samples):
            samples = np.concatenate([samples, np.empty((len(samples) + rows, HELD))])
        if h["commands"] + 1 > len(commands):
            commands = np.concatenate([commands, np.empty_like(commands)])
        self._state = history, moments, samples, commands

    def start(self) -> None:
        """Write the first moment, from the first readings with one of every sensor.

        Receivers that are not ready, or too coarse, give no heading: then there is none.
        """
        history, moments, rows, _ = self._state
        h = history.view(HISTORY)[0]
        kept = measurements_of(rows[: h["samples"], :SAMPLE])
        of_sensor = {s: [m for m in kept if m.sensor is s] for s in STARTING_SENSORS}
        begin = max(samples[0].time_s for samples in of_sensor.values())
        first = {s: [m for m in of_sensor[s] if m.time_s <= begin][-1] for s in STARTING_SENSORS}
        if first[Sensor.GNSS_TRACTOR].value == first[Sensor.GNSS_TRAILER].value:
            return
        row = first_moment(first, self._vehicle, self._sensors, self._process)
        if h["resumes"]:
            start, before = row.view(MOMENT)[0], moments[-1].view(MOMENT)[0]
            disturbances = slice(STATES, AugmentedState.GYRO_T)
            start["augmented"][0, disturbances] = before["augmented"][0, disturbances]
            start["scales"], start["slopes"] = before["scales"], before["slopes"]
        moments[0] = row
        h["begin"], h["moments"], h["resumes"] = 0, 1, 0

    def moments(self) -> NDArray[np.void]:
        """Return every `MOMENT` in memory, oldest first."""
        history, moments, _, _ = self._state
        h = history.view(HISTORY)[0]
        order = (h["begin"] + np.arange(h["moments"])) % (len(moments) - 1)
        return moments[order].view(MOMENT)[:, 0]
