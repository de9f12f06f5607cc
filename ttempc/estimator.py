"""Extended Kalman filter over the articulated kinematics, from the paper's sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from ttempc.errors import InvalidTuning
from ttempc.kinematics import advance, articulated_jacobian, hitch_angle, trailer_point
from ttempc.noise import ProcessNoise, SensorNoise
from ttempc.sensing import LENGTH, expected_jacobian, first_state, innovation
from ttempc.types import (
    Command,
    Disturbance,
    Estimate,
    FloatArray,
    Innovation,
    Measurement,
    Sensor,
    State,
)
from ttempc.valves import slew
from ttempc.vehicle import Vehicle

_LONGEST_STEP_S = 0.05  # a third of the front steering's lag
_SAME_TIME_S = 1e-9
_GATE_PATIENCE_S = 1.0
_N = len(State)
_UNIT = np.eye(_N + len(Disturbance))
# What a disturbance may be at most: twice what a vehicle that can still be steered shows.
_LARGEST = np.array([0.3, 0.3, 0.15, 0.5, 0.5])  # (5,) in the order of `Disturbance`
# How uncertain it is at the start, where nothing was seen of it; assumed.
_AT_START = np.array([0.02, 0.02, 0.01, 0.03, 0.02])  # (5,)


class ExtendedKalmanFilter:
    """Estimate state (`State`) and disturbance (`Disturbance`) from samples at their own times.

    Between samples the articulated model runs under the held command, which the steering valves
    approach at their rate limit and the steering angles with their lag behind that, and under the
    disturbance, which fades as the vehicle travels. The covariance gathers process noise,

        P <- Phi P Phi' + integral of the process noise,

    and every sample is taken in at its own time, one after the other, in Joseph's form
    P <- (I - K H) P (I - K H)' + K R K', which keeps P positive where the plain form does not
    (Bucy and Joseph 1968).

    The filter starts with the first reading of every sensor; until then estimates are NaN. A
    sample whose innovation would be exceeded with probability `gate_probability` only is kept
    out. A sensor that has been kept out for a whole second without a break may be right and the
    filter wrong: its samples are then taken in, with their noise raised until they just pass.
    Samples that are not finite, too early, too late or there twice are kept out; those of sensors
    without a model in `ttempc.sensing` are passed over.

    Raises:
        InvalidTuning: the gate's probability is not between 0 and 1.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensor_noise: SensorNoise | None = None,
        process_noise: ProcessNoise | None = None,
        gate_probability: float = 1e-4,
    ) -> None:
        if not 0.0 < gate_probability < 1.0:
            raise InvalidTuning(f"gate_probability: got {gate_probability}, must be in (0, 1)")
        self._vehicle = vehicle
        self._sensor_noise = sensor_noise or SensorNoise()
        self._process_noise = process_noise or ProcessNoise()
        self._noise = {s: self._sensor_noise.of(s) ** 2 * np.eye(LENGTH[s]) for s in LENGTH}
        self._gate = {m: float(chdtri(m, gate_probability)) for m in (1, 2)}
        self._state = np.full(_N, math.nan)
        self._disturbance = np.zeros(len(Disturbance))
        self._covariance: FloatArray = np.diag(np.full(len(_UNIT), math.inf))
        self._time_s: float | None = None  # of state and covariance; None before the start
        self._valves = np.zeros(2)  # set points of the steering valves [rad]
        self._first: dict[Sensor, Measurement] = {}
        self._newest: dict[Sensor, float] = {}  # time of the newest sample of each sensor
        self._kept_out_since: dict[Sensor, float] = {}

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s` after all `measurements` up to it."""
        held = None if command is None else command.as_array()
        innovations = []
        for measurement in measurements:
            if measurement.sensor not in LENGTH:  # as an IMU's: there is no model of it
                continue
            if not self._usable(measurement, time_s):
                dimension = LENGTH[measurement.sensor]
                innovations.append(Innovation(measurement.sensor, math.inf, dimension, False))
                continue
            self._newest[measurement.sensor] = measurement.time_s
            if self._time_s is None:
                self._start(measurement)
            else:
                self._predict(measurement.time_s, held)
                innovations.append(self._take_in(measurement))
        if self._time_s is not None:
            self._predict(time_s, held)
        return Estimate(
            time_s=time_s,
            state=self._state.copy(),
            covariance=self._covariance[:_N, :_N].copy(),
            trailer_xy=trailer_point(self._state, self._vehicle),
            hitch_angle=hitch_angle(self._state),
            disturbance=self._disturbance.copy(),
            innovations=tuple(innovations),
        )

    def _usable(self, measurement: Measurement, time_s: float) -> bool:
        """Whether a sample is complete, finite, and neither late, early nor there twice."""
        sampled, value = measurement.time_s, measurement.value
        return (
            len(value) == LENGTH[measurement.sensor]
            and all(map(math.isfinite, (sampled, *value)))
            and sampled <= time_s + _SAME_TIME_S
            and sampled > self._newest.get(measurement.sensor, -math.inf)
            and (self._time_s is None or sampled >= self._time_s - _SAME_TIME_S)
        )

    def _start(self, measurement: Measurement) -> None:
        """Collect readings until there is one of every sensor, then start from them."""
        self._first[measurement.sensor] = measurement
        if len(self._first) < len(LENGTH):
            return
        self._state, certain = first_state(self._first, self._vehicle, self._sensor_noise)
        self._covariance = np.diag([*np.zeros(_N), *_AT_START**2])
        self._covariance[:_N, :_N] = certain
        self._valves = self._state[State.DELTA_T : State.V].copy()
        self._time_s = max(reading.time_s for reading in self._first.values())

    def _predict(self, time_s: float, command: FloatArray | None) -> None:
        """Run model and covariance to `time_s` under the held `command` (3,)."""
        assert self._time_s is not None
        span = time_s - self._time_s
        if span <= 0.0:
            return
        count = math.ceil(span / _LONGEST_STEP_S)
        for _ in range(count):
            self._predict_step(span / count, command)
        self._time_s = time_s

    def _predict_step(self, step_s: float, command: FloatArray | None) -> None:
        if command is None:  # nothing is known to have moved: steering and speed stay
            command = np.array([*self._valves, self._state[State.V] / self._vehicle.speed_gain])
        inputs, self._valves = slew(self._valves, command, self._vehicle, step_s)
        before, disturbance = self._state, self._disturbance
        after = advance(before, inputs, self._vehicle, step_s, disturbance)
        middle = 0.5 * (before + after)
        fading = -abs(middle[State.V]) / self._process_noise.memory_m  # [1/s]
        slope = fading * _UNIT
        slope[:_N, :_N], _, slope[:_N, _N:] = articulated_jacobian(
            middle, inputs, self._vehicle, disturbance
        )
        transition = _exponential(slope * step_s)
        gathered = step_s * self._process_noise.density(middle[State.PSI_T], middle[State.V])
        # Half of the noise came before the step and goes through it, half comes after.
        covariance = transition @ (self._covariance + 0.5 * gathered) @ transition.T
        covariance += 0.5 * gathered
        self._state = after
        self._disturbance = math.exp(fading * step_s) * disturbance
        self._covariance = 0.5 * (covariance + covariance.T)

    def _take_in(self, measurement: Measurement) -> Innovation:
        """Correct state and covariance by one sample, unless the gate keeps it out."""
        sensor = measurement.sensor
        state, disturbance = self._state, self._disturbance
        difference = innovation(measurement, state, disturbance, self._vehicle)  # (m,)
        by_all = expected_jacobian(sensor, state, disturbance, self._vehicle)  # (m, 12)
        cross = self._covariance @ by_all.T  # (12, m)
        noise = self._noise[sensor]  # (m, m)
        spread = by_all @ cross + noise  # (m, m)
        precision = np.linalg.inv(spread)
        normalised = float(difference @ precision @ difference)
        beyond = normalised / self._gate[len(difference)]
        accepted = beyond <= 1.0
        if accepted:
            self._kept_out_since.pop(sensor, None)
        else:
            since = self._kept_out_since.setdefault(sensor, measurement.time_s)
            accepted = measurement.time_s - since >= _GATE_PATIENCE_S
            noise = noise + (beyond - 1.0) * spread
            precision = precision / beyond
        if accepted:
            gain = cross @ precision  # (12, m)
            kept = _UNIT - gain @ by_all
            covariance = kept @ self._covariance @ kept.T + gain @ noise @ gain.T
            step = gain @ difference
            self._state = state + step[:_N]
            self._disturbance = np.clip(disturbance + step[_N:], -_LARGEST, _LARGEST)
            self._covariance = 0.5 * (covariance + covariance.T)
        return Innovation(sensor, normalised, len(difference), accepted)


def _exponential(matrix: FloatArray) -> FloatArray:
    """Return exp(matrix) to fourth order, (12, 12): enough for a third of a lag."""
    result = _UNIT + matrix / 4.0
    for order in (3.0, 2.0, 1.0):
        result = _UNIT + matrix @ result / order
    return result
