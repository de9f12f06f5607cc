"""One extended Kalman filter over a belief: start, predict, take a sample in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from ..errors import InvalidTuning
from ..types import FloatArray, Innovation, Measurement, Sensor
from ..vehicle import Vehicle
from .augmented_state import AT_START, SIZE, STATES, Belief
from .augmented_state_kernel import vehicle_table
from .filter_kernel import correct, predict
from .measurement_model import LENGTH, PLACE, first_state
from .noise import ProcessNoise, SensorNoise

_LONGEST_STEP_S = 0.05  # a third of the front steering's lag
_SAME_TIME_S = 1e-9
_GATE_PATIENCE_S = 1.0


@dataclass(slots=True)
class FilterState:
    """Everything that a filter remembers at one time; its steps change it in place."""

    time_s: float
    beliefs: FloatArray  # (2, 16) belief, and its slope by the roughness
    covariances: FloatArray  # (2, 16, 16) likewise
    roughness: FloatArray  # (2,) value and precision (Fisher information)
    valves: FloatArray  # (2,) set points of the steering valves [rad]
    kept_out_since: dict[Sensor, float]  # sensors that the gate keeps out without a break

    def copy(self) -> FilterState:
        """Return one that shares nothing with this one."""
        return FilterState(
            self.time_s,
            self.beliefs.copy(),
            self.covariances.copy(),
            self.roughness.copy(),
            self.valves.copy(),
            self.kept_out_since.copy(),
        )


class BeliefFilter:
    """The steps of the filter; it remembers nothing but its tuning.

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
        self._table = vehicle_table(vehicle)
        self._noise, self._memories = process_noise.table(), process_noise.memories()
        self._variance = {sensor: sensor_noise.of(sensor) ** 2 for sensor in LENGTH}
        self._gate = {m: float(chdtri(m, gate_probability)) for m in (1, 2)}

    def start(self, readings: Mapping[Sensor, Measurement]) -> FilterState:
        """Return the state that one reading of every sensor implies, at the newest of them."""
        state, certain = first_state(readings, self._vehicle, self._sensor_noise)
        beliefs, covariances = np.zeros((2, SIZE)), np.zeros((2, SIZE, SIZE))
        beliefs[0, :STATES] = state
        covariances[0] = np.diag([*np.zeros(STATES), *AT_START**2])
        covariances[0, :STATES, :STATES] = certain
        noise = self._process_noise
        return FilterState(
            time_s=max(reading.time_s for reading in readings.values()),
            beliefs=beliefs,
            covariances=covariances,
            roughness=np.array([noise.roughness, noise.roughness_sd**-2]),
            valves=state[Belief.DELTA_T : Belief.RIM].copy(),
            kept_out_since={},
        )

    def predict(self, now: FilterState, time_s: float, command: FloatArray | None) -> None:
        """Run `now` on to `time_s` under the held `command` (3,)."""
        span = time_s - now.time_s
        if span <= 0.0:
            return
        if command is None:  # nothing is known to have moved: steering and speed stay
            hp = now.beliefs[0, Belief.RIM] / self._vehicle.speed_gain
            command = np.array([*now.valves, hp])
        predict(
            *(now.beliefs, now.covariances, now.roughness, now.valves, command),
            *(self._table, self._noise, self._memories, span),
            max(1, math.ceil(span / _LONGEST_STEP_S - _SAME_TIME_S)),
        )
        now.time_s = time_s

    def take_in(self, now: FilterState, sample: Measurement) -> Innovation:
        """Correct `now` by a sample of its time, unless the gate keeps it out."""
        sensor = sample.sensor
        m = LENGTH[sensor]
        since = now.kept_out_since.get(sensor, math.inf)
        forced = sample.time_s - since >= _GATE_PATIENCE_S
        normalised = correct(
            *(now.beliefs, now.covariances, now.roughness, PLACE[sensor]),
            (sample.value[0], sample.value[1] if m == 2 else 0.0),
            *(self._variance[sensor], self._gate[m], forced, self._table),
        )
        inside = normalised <= self._gate[m]
        if inside:
            now.kept_out_since.pop(sensor, None)
        else:
            now.kept_out_since.setdefault(sensor, sample.time_s)
        return Innovation(sensor, normalised, m, inside or forced)
