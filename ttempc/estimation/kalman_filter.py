"""Steps of the extended Kalman filter over the augmented state: start, predict, correct."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from ..errors import InvalidTuning
from ..types import FloatArray, Innovation, Measurement, Sensor
from ..vehicle import Vehicle
from . import filter_kernel
from .augmented_state import INITIAL_SD, SIZE, STATES, AugmentedState
from .augmented_state_kernel import vehicle_parameters
from .measurement_model import KERNEL_INDEX, LENGTH, first_state
from .noise import SCALES, ProcessNoise, SensorNoise

SAME_TIME_S: Final = 1e-6
"""Times that differ by less are one: four times the resolution of a double at Unix time [s]."""

_LONGEST_STEP_S = 0.05  # a third of the front steering's lag
_GATE_PATIENCE_S = 1.0
_LEAST_VARIANCE = 1e-12  # of an entry without uncertainty, so that covariances are invertible


def steps_over(span_s: float) -> int:
    """Return the number of integration steps over a span of time [s], at least 1."""
    return max(1, math.ceil((span_s - SAME_TIME_S) / _LONGEST_STEP_S))


def acting_command(
    command: FloatArray | None, valves: FloatArray, rim: float, vehicle: Vehicle
) -> FloatArray:
    """Return `command` (3,) with what steadies the vehicle in the place of entries that are NaN.

    Where no command is known (NaN; None for all three), steering and speed are taken as constant:
    at the set points `valves` (2,) [rad] and the speed `rim` [m/s].
    """
    steady = np.array([*valves, rim / vehicle.speed_gain])
    return steady if command is None else np.where(np.isnan(command), steady, command)


@dataclass(slots=True)
class FilterState:
    """All that a filter carries from one time to the next; `KalmanFilter` changes it in place."""

    time_s: float
    augmented: FloatArray  # (4, 18) augmented state, and its derivatives by the factors
    covariances: FloatArray  # (4, 18, 18) likewise
    scales: FloatArray  # (2, 3) factors of `NoiseScale`, information on their logarithms
    valves: FloatArray  # (2,) set points of the steering valves [rad]
    rejected_since: dict[Sensor, float]  # sensor -> time of the first rejection without a break [s]

    def copy(self) -> FilterState:
        """Return a deep copy."""
        return FilterState(
            self.time_s,
            self.augmented.copy(),
            self.covariances.copy(),
            self.scales.copy(),
            self.valves.copy(),
            self.rejected_since.copy(),
        )


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
        self._sensor_variance = {s: float(sensor_noise.of(s)) ** 2 for s in LENGTH}
        self._gate = {m: float(chdtri(m, gate_probability)) for m in (1, 2)}

    def start(self, readings: Mapping[Sensor, Measurement]) -> FilterState:
        """Return the state that follows from one reading of every sensor, at the newest of them."""
        whole_error = replace(self._sensor_noise, gnss_white_share=1.0)
        state, covariance = first_state(readings, self._vehicle, whole_error)
        levels = 1 + SCALES
        slow = max(self._sensor_noise.slow_variance, _LEAST_VARIANCE)
        augmented, covariances = np.zeros((levels, SIZE)), np.zeros((levels, SIZE, SIZE))
        augmented[0, :STATES] = state
        covariances[0] = np.diag([*np.zeros(STATES), *INITIAL_SD**2, slow, slow])
        covariances[0, :STATES, :STATES] = covariance
        noise = self._process_noise
        return FilterState(
            time_s=max(reading.time_s for reading in readings.values()),
            augmented=augmented,
            covariances=covariances,
            scales=np.array([noise.scales, np.full(SCALES, noise.scale_sd**-2)]),
            valves=state[AugmentedState.DELTA_T : AugmentedState.RIM].copy(),
            rejected_since={},
        )

    def predict(self, state: FilterState, time_s: float, command: FloatArray | None) -> None:
        """Advance `state` to `time_s` under the held `command` (3,), see `acting_command`."""
        span = float(time_s - state.time_s)
        if span <= 0.0:
            return
        command = acting_command(
            command, state.valves, state.augmented[0, AugmentedState.RIM], self._vehicle
        )
        filter_kernel.predict(
            state.augmented,
            state.covariances,
            state.scales,
            state.valves,
            command,
            self._parameters,
            self._rates,
            self._fading,
            self._process_noise.scale_walk**2,
            span,
            steps_over(span),
        )
        state.time_s = time_s

    def correct(self, state: FilterState, sample: Measurement) -> Innovation:
        """Correct `state` by a sample of its time, unless the gate rejects the sample."""
        sensor = sample.sensor
        m = LENGTH[sensor]
        rejected_for = sample.time_s - state.rejected_since.get(sensor, math.inf)
        forced = bool(rejected_for >= _GATE_PATIENCE_S - SAME_TIME_S)
        normalised, log_determinant, *whitened = filter_kernel.correct(
            state.augmented,
            state.covariances,
            state.scales,
            KERNEL_INDEX[sensor],
            (float(sample.value[0]), float(sample.value[1]) if m == 2 else 0.0),
            self._sensor_variance[sensor],
            self._gate[m],
            forced,
            self._parameters,
        )
        inside = normalised <= self._gate[m]
        if inside:
            state.rejected_since.pop(sensor, None)
        else:
            state.rejected_since.setdefault(sensor, sample.time_s)
        return Innovation(
            sensor, normalised, m, inside or forced, tuple(whitened[:m]), log_determinant
        )
