"""Nonlinear moving-horizon estimator."""

from collections.abc import Sequence

import numpy as np
import piqp
import scipy
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..estimation.ekf import ExtendedKalmanFilter
from ..estimation.filter import ROW, steps_over
from ..estimation.noise import ProcessNoise, SensorNoise
from ..models.augmented_state import (
    ANGLES,
    DISTURBANCE_BOUND,
    LENGTH,
    SIZE,
    STATES,
    AugmentedState,
    advance_augmented_state,
    predicted_measurement,
    vehicle_parameters,
)
from ..models.kinematics import wrap_angle
from ..models.rows import WIDTH
from ..types import Command, Estimate, FloatArray, Measurement
from ..vehicle import Vehicle

_LEAST_VARIANCE = 1e-12  # of each entry over a step: a vehicle at rest gathers no noise


class MovingHorizonEstimator:
    """Estimate the augmented states of the last `window_s` together, from all samples in it.

    Over the times of the samples, with the model f and noise Q of the filter in between,

        minimise  |x_0 - x|^2_P + sum |x_(k+1) - f(x_k)|^2_Q + sum |y - h(x_k)|^2_R
        subject to disturbances within their bounds,

    norms weighted by the inverse of their subscripts (Rao, Rawlings and Mayne 2003). An
    `ExtendedKalmanFilter` runs beside the estimator. It supplies the arrival cost x, P at the start
    of the window, the factors in Q, and the samples that its gate accepts, late ones included.
    Gauss-Newton starts from the last estimate of each time and takes `iterations` steps a tick. Its
    block-tridiagonal system is solved directly, and by PIQP if that solution leaves the bounds.

    The innovations of its estimates are those of the filter.

    Raises:
        InvalidTuning: `iterations` is below 1, or as `ExtendedKalmanFilter` with `window_s` for its
            memory.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        sensor_noise: SensorNoise | None = None,
        process_noise: ProcessNoise | None = None,
        gate_probability: float = 1e-4,
        window_s: float = 1.0,
        iterations: int = 1,
    ) -> None:
        if iterations < 1:
            raise InvalidTuning(f"iterations: got {iterations}, must be 1 or more")
        self._vehicle = vehicle
        self._sensor_noise = sensor_noise or SensorNoise()
        self._joint = not self._sensor_noise.angle_offset
        self._parameters = vehicle_parameters(vehicle, self._joint)
        self._process_noise = process_noise or ProcessNoise.of(vehicle)
        self._iterations = iterations
        self._filter = ExtendedKalmanFilter(
            vehicle, self._sensor_noise, self._process_noise, gate_probability, window_s, True
        )
        self._last: dict[float, FloatArray] = {}  # the newest estimate of each time

    def warm_up(self) -> None:
        """Compile every kernel that an update may run; the estimator's state does not change."""
        twin, at_rest = MovingHorizonEstimator(self._vehicle), np.zeros(SIZE)
        values = {s: predicted_measurement(s, at_rest, self._vehicle)[0].tolist() for s in LENGTH}
        for time_s in (0.0, 0.2, 0.4):
            readings = [Measurement(time_s, s, tuple(value)) for s, value in values.items()]
            twin.update(time_s, readings, None)

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s`, as `Estimator.update`.

        It is that of the filter alone where the equations of the window are too ill-conditioned.
        """
        filtered = self._filter.update(time_s, measurements, command)
        moments, samples = self._filter.moments(), self._filter.accepted()
        if len(moments) < 2:
            return filtered
        times = moments["time_s"].tolist()
        states = moments["augmented"][:, 0, :SIZE]
        guess = np.array([self._last.get(t, x) for t, x in zip(times, states, strict=True)])
        try:
            covariance = moments["covariances"][-1, 0, :, :SIZE]
            for _ in range(self._iterations):
                guess, covariance = self._step(moments, samples, guess)
        except np.linalg.LinAlgError:
            return filtered
        self._last = dict(zip(times, guess, strict=True))
        now = moments[-1:].copy()
        now["augmented"][0, 0, :SIZE] = guess[-1]
        now["covariances"][0, 0, :, :SIZE] = covariance
        return self._filter.estimate(now.view(float).reshape(ROW), time_s, filtered.innovations)

    def _step(
        self, moments: NDArray[np.void], samples: list[Measurement], guess: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `_minimum` of the problem linearised about `guess` (n, 22)."""
        count, times = len(moments), moments["time_s"].tolist()
        diagonal = np.zeros((count, SIZE, SIZE))
        above = np.zeros((count - 1, SIZE, SIZE))
        right = np.zeros((count, SIZE))
        arrival = np.linalg.inv(moments["covariances"][0, 0, :, :SIZE])
        diagonal[0] = arrival
        right[0] = arrival @ (moments["augmented"][0, 0, :SIZE] - guess[0])
        for k in range(count - 1):
            end, step_jacobian, noise = self._transition(moments[k], guess[k], times[k + 1])
            weight = np.linalg.inv(noise)
            weighted = step_jacobian.T @ weight  # (24, 24)
            defect = end - guess[k + 1]
            diagonal[k] += weighted @ step_jacobian
            diagonal[k + 1] += weight
            above[k] = -weighted
            right[k] -= weighted @ defect
            right[k + 1] += weight @ defect
        index = {time_s: k for k, time_s in enumerate(times)}
        for sample in samples:
            k = index[sample.time_s]
            reading, jacobian = predicted_measurement(
                sample.sensor, guess[k], self._vehicle, self._joint
            )
            residual = np.array(sample.value) - reading
            if sample.sensor in ANGLES:
                residual[0] = wrap_angle(float(residual[0]))
            precision = self._sensor_noise.of(sample.sensor) ** -2
            diagonal[k] += precision * jacobian.T @ jacobian
            right[k] += precision * jacobian.T @ residual
        return _minimum(diagonal, above, right, guess)

    def _transition(
        self, moment: np.void, guess: FloatArray, until_s: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the transition from `guess` (24,) at the time of a `MOMENT` to `until_s`."""
        augmented, valves = guess.copy(), moment["valves"].copy()
        jacobian, noise = np.eye(SIZE), _LEAST_VARIANCE * np.eye(SIZE)
        transition, scales = np.empty((SIZE, WIDTH)), moment["scales"][0]
        fading = self._process_noise.fading(self._sensor_noise).ravel()
        time_s = float(moment["time_s"])
        for end_s, command in self._filter.commands(time_s, until_s):
            rim = augmented[AugmentedState.RIM]
            steady = np.array([*valves, rim / self._vehicle.speed_gain])  # where none is known
            command = np.where(np.isnan(command), steady, command)
            span_s = float(end_s - time_s)
            steps = steps_over(span_s)
            step_s = span_s / steps
            for _ in range(steps):
                middle = augmented.copy()
                advance_augmented_state(
                    augmented, valves, command, self._parameters, fading, step_s, transition
                )
                step_jacobian = transition[:, :SIZE]
                middle[:STATES] = 0.5 * (middle[:STATES] + augmented[:STATES])
                density = self._process_noise.density(
                    middle, scales, self._vehicle, self._sensor_noise
                )
                half = 0.5 * step_s * density
                noise = step_jacobian @ (noise + half) @ step_jacobian.T + half
                jacobian = step_jacobian @ jacobian
            time_s = end_s
        return augmented, jacobian, noise


def _minimum(
    diagonal: FloatArray, above: FloatArray, right: FloatArray, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return guess + d (n, 22) with d minimising d'Hd / 2 - right'd, disturbances within bounds.

    H is block-tridiagonal with the blocks `diagonal` (n, 24, 24) and `above` (n - 1, 24, 24);
    `right` and `guess` are (n, 22). Elimination from the first block on leaves the information
    matrix of the last augmented state in the last block; its inverse (24, 24) is returned, too.

    Raises:
        numpy.linalg.LinAlgError: H is singular, or indefinite by rounding.
    """
    last = len(guess) - 1
    left, rest = diagonal.copy(), right.copy()
    for k in range(last):
        solved = np.linalg.solve(left[k], np.column_stack([above[k], rest[k]]))
        left[k + 1] -= above[k].T @ solved[:, :-1]
        rest[k + 1] -= above[k].T @ solved[:, -1]
    covariance = np.linalg.inv(left[last])
    if not np.all(covariance.diagonal() > 0.0):
        raise np.linalg.LinAlgError("information matrix not positive definite")
    augmented, d = guess.copy(), np.zeros(SIZE)
    for k in range(last, -1, -1):
        d = np.linalg.solve(left[k], rest[k] - above[k] @ d if k < last else rest[k])
        augmented[k] += d
    if (np.abs(augmented[:, STATES:]) > DISTURBANCE_BOUND).any():
        augmented = guess + _bounded_step(diagonal, above, right, guess)
    return augmented, 0.5 * (covariance + covariance.T)


def _bounded_step(
    diagonal: FloatArray, above: FloatArray, right: FloatArray, guess: FloatArray
) -> FloatArray:
    """Return d (n, 22) of `_minimum` by PIQP.

    If PIQP fails, d takes the guess to its nearest point within the bounds.
    """
    count = len(guess)
    blocks = [[scipy.sparse.csc_matrix((SIZE, SIZE)) for _ in range(count)] for _ in range(count)]
    for k in range(count):
        blocks[k][k] = scipy.sparse.csc_matrix(diagonal[k])
        if k + 1 < count:
            blocks[k][k + 1] = scipy.sparse.csc_matrix(above[k])
            blocks[k + 1][k] = scipy.sparse.csc_matrix(above[k].T)
    bound = np.concatenate([np.full(STATES, np.inf), DISTURBANCE_BOUND])
    solver = piqp.SparseSolver()
    solver.setup(
        P=scipy.sparse.csc_matrix(scipy.sparse.bmat(blocks)),
        c=-right.ravel(),
        x_l=(-bound - guess).ravel(),
        x_u=(bound - guess).ravel(),
    )
    status = solver.solve()
    step = solver.result.x.reshape(count, SIZE)
    if status != piqp.PIQP_SOLVED or not np.isfinite(step).all():
        step = np.zeros_like(guess)
    return np.clip(guess + step, -bound, bound) - guess
