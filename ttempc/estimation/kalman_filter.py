"""Steps of the extended Kalman filter over the augmented state: start, process, predict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Final

import numpy as np
from scipy.special import chdtri

from ..errors import InvalidTuning
from ..types import FloatArray, Input, Measurement, Sensor
from ..vehicle import Vehicle
from . import sample_kernel
from .augmented_state import INITIAL_SD, SIZE, STATES, AugmentedState
from .augmented_state_kernel import vehicle_parameters
from .dead_time import HeldCommands
from .measurement_model import GYROS, LENGTH, first_state
from .noise import SCALES, ProcessNoise, SensorNoise

SampleRow = tuple[float, int, float, float, float]
"""Time [s], `SensorIndex` and value of a sample, entries that it does not have with any number."""

_UNKNOWN: Final = np.full(len(Input), math.nan)
_LEAST_VARIANCE: Final = (
    1e-12  # of an entry without uncertainty, so that covariances are invertible
)


class FilterState:
    """All that a filter carries from one time to the next; `KalmanFilter` changes it in place.

    Args:
        row: (`sample_kernel.ROW`,) all entries one after the other; the properties are views of it.
    """

    __slots__ = ("row",)

    def __init__(self, row: FloatArray) -> None:
        self.row = row

    @property
    def time_s(self) -> float:
        """Time of the state [s]."""
        return self.row.item(0)

    @time_s.setter
    def time_s(self, time_s: float) -> None:
        self.row[0] = time_s

    @property
    def augmented(self) -> FloatArray:
        """Augmented state, and its derivatives by the factors, (4, 22)."""
        return self.row[sample_kernel.AUGMENTED : sample_kernel.COVARIANCES].reshape(-1, SIZE)

    @property
    def covariances(self) -> FloatArray:
        """Covariance of the augmented state and its derivatives, (4, 22, 22)."""
        part = self.row[sample_kernel.COVARIANCES : sample_kernel.LEARNT_SCALES]
        return part.reshape(-1, SIZE, SIZE)

    @property
    def scales(self) -> FloatArray:
        """Factors of `NoiseScale`, information on their logarithms, (2, 3)."""
        return self.row[sample_kernel.LEARNT_SCALES : sample_kernel.VALVES].reshape(2, SCALES)

    @property
    def valves(self) -> FloatArray:
        """Set points of the steering valves [rad], (2,)."""
        return self.row[sample_kernel.VALVES : sample_kernel.REJECTED_SINCE]

    @property
    def rejected_since(self) -> FloatArray:
        """First rejection without a break [s] by `SensorIndex`, or NaN."""
        return self.row[sample_kernel.REJECTED_SINCE : sample_kernel.GYROS]

    @property
    def gyros(self) -> FloatArray:
        """Last sample of both IMUs: time [s], yaw rate, roll, pitch, or NaN, (2, 4)."""
        return self.row[sample_kernel.GYROS :].reshape(2, 4)

    def copy(self) -> FilterState:
        """Return a deep copy."""
        return FilterState(self.row.copy())


class KalmanFilter:
    """Extended Kalman filter without memory: every step takes and changes a `FilterState`.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensor_noise: SensorNoise,
        process_noise: ProcessNoise,
        gate_probability: float,
    ) -> None:
        if not 0.0 < gate_probability < 1.0:
            raise InvalidTuning(f"gate_probability: got {gate_probability}, must be in (0, 1)")
        self._vehicle = vehicle
        self._sensor_noise = sensor_noise
        self._process_noise = process_noise
        self._parameters = vehicle_parameters(vehicle)
        self._rates = process_noise.rates(sensor_noise)
        self._fading = process_noise.fading(sensor_noise)
        self._walk = process_noise.scale_walk**2
        lengths = {**LENGTH, **dict.fromkeys(GYROS, 1)}
        self._variances = np.array([float(sensor_noise.of(sensor)) ** 2 for sensor in lengths])
        self._gates = np.array([float(chdtri(m, gate_probability)) for m in lengths.values()])

    def start(self, readings: Mapping[Sensor, Measurement]) -> FilterState:
        """Return the state that follows from one reading of every sensor, at the newest of them."""
        whole_error = replace(self._sensor_noise, gnss_white_share=1.0)
        state, covariance = first_state(readings, self._vehicle, whole_error)
        slow = max(self._sensor_noise.difference_variance, _LEAST_VARIANCE)
        start = FilterState(np.zeros(sample_kernel.ROW))
        start.time_s = max(reading.time_s for reading in readings.values())
        start.augmented[0, :STATES] = state
        start.covariances[0] = np.diag(
            [
                *np.zeros(STATES),
                *INITIAL_SD**2,
                *(slow, slow),
                *[max(self._sensor_noise.yaw_rate_bias**2, _LEAST_VARIANCE)] * 2,
                *[_LEAST_VARIANCE] * 2,
            ]
        )
        start.covariances[0, :STATES, :STATES] = covariance
        noise = self._process_noise
        start.scales[:] = noise.scales, np.full(SCALES, noise.scale_sd**-2)
        start.valves[:] = state[AugmentedState.DELTA_T : AugmentedState.RIM]
        start.rejected_since[:] = math.nan
        start.gyros[:] = math.nan
        return start

    def predict(self, state: FilterState, time_s: float, held: HeldCommands) -> None:
        """Advance `state` to `time_s` in place under the commands `held` since its time.

        Unknown entries are taken as in `dead_time.acting_command`.
        """
        ends_s, commands = _arrays(held)
        sample_kernel.predict_until(
            state.augmented,
            state.covariances,
            state.scales,
            state.valves,
            float(state.time_s),
            float(time_s),
            ends_s,
            commands,
            self._parameters,
            self._rates,
            self._fading,
            self._walk,
        )
        state.time_s = time_s

    def process(
        self, start: FilterState, samples: Sequence[SampleRow], held: HeldCommands
    ) -> tuple[FloatArray, list[FilterState]]:
        """Return the results of `samples`, one after the other, and the state after each time.

        A sample corrects the state at its time, unless the gate rejects it.

        Args:
            start: the state before the samples; it stays as it is.
            samples: one at least, in order of time, none before the start.
            held: commands since the start.

        Returns:
            The rows of `sample_kernel.process`: normalised squared innovation, log-determinant of
            its covariance, whitened innovation (two entries), 1 or 0 for accepted or not, (n, 5);
            and the states after all samples of each time.
        """
        ends_s, commands = _arrays(held)
        rows = np.fromiter(chain.from_iterable(samples), float).reshape(-1, 5)
        count = 1 + len({row[0] for row in samples})
        states, results = np.empty((count, sample_kernel.ROW)), np.empty((len(rows), 5))
        states[0] = start.row
        sample_kernel.process(
            states,
            rows,
            self._variances,
            self._gates,
            ends_s,
            commands,
            self._parameters,
            self._rates,
            self._fading,
            self._walk,
            self._process_noise.gyro_sampling**2,
            results,
        )
        return results, [FilterState(state) for state in states[1:]]


def _arrays(held: HeldCommands) -> tuple[FloatArray, FloatArray]:
    """Return end times (m,) [s] and commands (m, 3), NaN where a command is not known."""
    commands = [_UNKNOWN if command is None else command for _, command in held]
    return np.array([end_s for end_s, _ in held]), np.array(commands).reshape(-1, len(Input))
