"""Moving-horizon estimators of state and slip factors.

That the published NMPC of the paper's vehicle had a moving-horizon estimator of state and slip
factors is in the paper; the window of 3 s, the deterministic model within it and the factors' range
are from memory of Kayacan, Kayacan, Ramon and Saeys (2015), see `ttempc.models.printed`. The noise
of the arrival cost is assumed.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ..models.kinematics import wrap_angle
from ..models.printed import (
    FACTORS,
    STATES,
    WINDOW_INPUTS,
    along_window,
    geometric_parameters,
    printed_parameters,
)
from ..mpc.qp import QP, CheckedSolver
from ..sensors import STARTING_SENSORS
from ..types import Command, Estimate, Estimator, FloatArray, Measurement, Sensor, State
from ..vehicle import Vehicle
from .filter.start import first_state
from .noise import SensorNoise

PERIODS: Final = 15  # updates in the window: 3 s at 5 Hz; from memory
FACTOR_MIN: Final = 0.25  # from memory
FACTOR_MAX: Final = 1.0  # from memory
_SIZE = STATES + FACTORS
_SPEED: Final = STATES - 1
_OUTPUTS: Final = [0, 1, 3, 4, _SPEED]  # positions of both axle points, speed of the rims
_ENCODER: Final = 4  # its place among the outputs

# Standard deviations that the arrival cost gathers, all assumed: of x, y [m], psi [rad] of tractor
# and trailer, of the speed [m/s] and of the factors, each by the square root of a second.
_WALK = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.05, 0.02, 0.05, 0.05])
_START_SD = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.1, 0.2, 0.2, 0.2])


class MovingHorizonEstimator(Estimator):
    """Estimate first state and slip factors of a window of `PERIODS` updates by least squares.

    Within the window the model of `ttempc.models.printed`, its yaw equation of the trailer by
    geometry, runs without noise under the measured steering and hitch
    angles, averaged over each period, and the hydrostat commands. Residuals are those of both GNSS
    positions and of the encoder's mean. The arrival cost is the information of all samples before
    the window, by a step of an extended Kalman filter each time that the window moves on (Rao,
    Rawlings and Mayne 2003, IEEE Transactions on Automatic Control 48). One Gauss-Newton step is
    taken an update (Diehl, Bock and Schloeder 2005), the factors within their range.

    Samples count as taken at the update that brings them. The estimate is NaN until every sensor
    has sent a sample.

    Args:
        vehicle: model parameters.
        sensor_noise: standard deviations of the sensors.
    """

    def __init__(self, vehicle: Vehicle, sensor_noise: SensorNoise | None = None) -> None:
        self._vehicle = vehicle
        self._noise = sensor_noise or SensorNoise()
        self._parameters = self._model(vehicle)
        self._qp = CheckedSolver()
        self._readings: dict[Sensor, Measurement] = {}  # the newest of each sensor
        self._time_s = math.nan
        # Padded at the front with periods of no length and outputs without weight.
        self._inputs = np.zeros((PERIODS, WINDOW_INPUTS))
        self._measured = np.zeros((PERIODS + 1, len(_OUTPUTS)))
        self._precision = np.zeros((PERIODS + 1, len(_OUTPUTS)))
        self._first: FloatArray | None = None  # (10,) estimate of the first unknowns
        self._prior = np.zeros(_SIZE)
        self._covariance = np.diag(np.square(_START_SD))

    @staticmethod
    def _model(vehicle: Vehicle) -> FloatArray:
        """Return the parameters of the model, (5,)."""
        return geometric_parameters(vehicle)

    def warm_up(self) -> None:
        """Compile the model of the window; the estimator's state does not change."""
        along_window(self._parameters, self._prior, self._inputs)

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s`, see `ttempc.types.Estimator.update`."""
        samples = [
            item
            for item in measurements
            if item.sensor in STARTING_SENSORS and all(map(math.isfinite, item.value))
        ]
        for item in samples:
            self._readings[item.sensor] = item
        if self._first is None:
            if len(self._readings) < len(STARTING_SENSORS):
                return self._estimate(time_s, np.full(_SIZE, math.nan), np.full((7, 7), math.nan))
            state, _ = first_state(self._readings, self._vehicle, self._noise)
            trailer = self._readings[Sensor.GNSS_TRAILER].value
            x, y, psi_t, psi_i, _, _, v = state.tolist()
            self._first = np.array([x, y, psi_t, *trailer, psi_i, v, 1.0, 1.0, 1.0])
            self._prior = self._first.copy()
        else:
            self._move_on(time_s, samples, command)
        self._time_s = time_s
        self._measure(samples)
        self._improve()
        states, jacobian = along_window(self._parameters, self._first, self._inputs)
        by_first = jacobian[-1, :STATES]  # (7, 10)
        covariance = by_first @ np.linalg.inv(self._information(jacobian)) @ by_first.T
        return self._estimate(time_s, states[-1], covariance)

    def _move_on(
        self, time_s: float, samples: Sequence[Measurement], command: Command | None
    ) -> None:
        """Drop the first period of the window, with its samples into the arrival cost; add one."""
        assert self._first is not None
        states, jacobian = along_window(self._parameters, self._first, self._inputs)
        weight = self._precision[0]
        gain = np.linalg.inv(self._covariance)
        gain[_OUTPUTS, _OUTPUTS] += weight
        posterior = np.linalg.inv(gain)
        residual = np.zeros(_SIZE)
        residual[_OUTPUTS] = weight * (self._measured[0] - self._prior[_OUTPUTS])
        mean = self._prior + posterior @ residual
        step = jacobian[0]
        self._prior = states[0] + step @ (mean - self._first)
        self._prior[STATES:] = np.clip(self._prior[STATES:], FACTOR_MIN, FACTOR_MAX)
        walk = np.square(_WALK) * self._inputs[0, -1]
        self._covariance = step @ posterior @ step.T + np.diag(walk)
        self._first = states[0]
        for array in (self._inputs, self._measured, self._precision):
            array[:-1] = array[1:]
        hp = self._inputs[-1, 2] if command is None else command.hp
        delta_t, delta_i, beta = (
            self._mean(samples, sensor)
            for sensor in (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
        )
        self._inputs[-1] = delta_t, delta_i, hp, beta, time_s - self._time_s

    def _mean(self, samples: Sequence[Measurement], sensor: Sensor) -> float:
        """Return the mean of the samples of a sensor, its newest reading where there is none."""
        values = [item.value[0] for item in samples if item.sensor is sensor]
        return float(np.mean(values)) if values else self._readings[sensor].value[0]

    def _measure(self, samples: Sequence[Measurement]) -> None:
        """Write measured outputs and their precision at the end of the window."""
        self._precision[-1] = 0.0
        for place, sensor in ((0, Sensor.GNSS_TRACTOR), (2, Sensor.GNSS_TRAILER)):
            if any(item.sensor is sensor for item in samples):
                self._measured[-1, place : place + 2] = self._readings[sensor].value
                self._precision[-1, place : place + 2] = self._noise.of(sensor) ** -2
        count = sum(item.sensor is Sensor.ENCODER for item in samples)
        if count:
            self._measured[-1, _ENCODER] = self._mean(samples, Sensor.ENCODER)
            self._precision[-1, _ENCODER] = count * self._noise.of(Sensor.ENCODER) ** -2

    def _improve(self) -> None:
        """Take one Gauss-Newton step of the window's problem."""
        assert self._first is not None
        states, jacobian = along_window(self._parameters, self._first, self._inputs)
        outputs = np.vstack([self._first, states])[:, _OUTPUTS]  # (n + 1, 5)
        slopes = np.concatenate([np.eye(_SIZE)[None], jacobian])[:, _OUTPUTS]  # (n + 1, 5, 10)
        weighted = self._precision * (self._measured - outputs)
        offset = self._prior - self._first
        gradient = -np.einsum("kj,kji->i", weighted, slopes)
        gradient -= np.linalg.solve(self._covariance, offset)
        # [m], [rad], [m/s]: no bound on the state
        lower = np.full(_SIZE, -1e3)
        upper = np.full(_SIZE, 1e3)
        lower[STATES:] = FACTOR_MIN - self._first[STATES:]
        upper[STATES:] = FACTOR_MAX - self._first[STATES:]
        problem = QP(
            hessian=self._information(jacobian),
            gradient=gradient,
            matrix=np.empty((0, _SIZE)),
            row_lower=np.empty(0),
            row_upper=np.empty(0),
            lower=lower,
            upper=upper,
        )
        change = self._qp.solve(problem).x
        if change is not None:
            self._first = self._first + change

    def _information(self, jacobian: FloatArray) -> FloatArray:
        """Return the information on the first unknowns, (10, 10)."""
        slopes = np.concatenate([np.eye(_SIZE)[None], jacobian])[:, _OUTPUTS]
        weighted = self._precision[:, :, None] * slopes
        information = np.einsum("kji,kjl->il", slopes, weighted)
        information += np.linalg.inv(self._covariance)
        return 0.5 * (information + information.T)

    def _estimate(self, time_s: float, unknowns: FloatArray, covariance: FloatArray) -> Estimate:
        x, y, psi_t, x_i, y_i, psi_i, rim, mu, _, _ = unknowns.tolist()
        angles = (Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH)
        delta_t, delta_i, beta = (
            self._readings[sensor].value[0] if sensor in self._readings else math.nan
            for sensor in angles
        )
        if self._inputs[-1, -1] > 0.0:  # the means of the last period, less noisy
            delta_t, delta_i, _, beta, _ = self._inputs[-1].tolist()
        variance = np.zeros((len(State), len(State)))
        order = [0, 1, 2, 5, _SPEED]
        places = [State.X, State.Y, State.PSI_T, State.PSI_I, State.V]
        variance[np.ix_(places, places)] = covariance[np.ix_(order, order)]
        for angle in (State.DELTA_T, State.DELTA_I):
            variance[angle, angle] = self._noise.steering**2
        return Estimate(
            time_s=time_s,
            state=np.array([x, y, psi_t, psi_i, delta_t, delta_i, mu * rim]),
            covariance=variance,
            trailer_xy=np.array([x_i, y_i]),
            hitch_angle=wrap_angle(beta) if math.isfinite(beta) else beta,
            slip_factors=unknowns[STATES:].copy(),
        )


class PrintedEstimator(MovingHorizonEstimator):
    """The same on the model as printed: the companion of `nmpc-path`."""

    @staticmethod
    def _model(vehicle: Vehicle) -> FloatArray:
        return printed_parameters(vehicle)
