"""Nonlinear moving-horizon estimator: the filter's window, estimated anew as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import piqp
from scipy.sparse import bmat, csc_matrix

from ..errors import InvalidTuning
from ..estimation.augmented_state import LARGEST, SIZE, STATES, Belief, estimate_of
from ..estimation.augmented_state_kernel import advance_belief, vehicle_table
from ..estimation.ekf import ExtendedKalmanFilter
from ..estimation.kalman_filter import FilterState
from ..estimation.measurement_model import ANGLES, expected
from ..estimation.noise import ProcessNoise, SensorNoise
from ..models.kinematics import wrap_angle
from ..types import Command, Estimate, FloatArray, Measurement
from ..vehicle import Vehicle

_LONGEST_STEP_S = 0.05  # a third of the front steering's lag
_LEAST_VARIANCE = 1e-12  # of a belief's entry over a step: a vehicle at rest gathers no noise


@dataclass(frozen=True, slots=True)
class Leap:
    """The model from one time of the window to the next, about a guess."""

    after: FloatArray  # (16,) belief that the guess leads to
    transition: FloatArray  # (16, 16)
    noise: FloatArray  # (16, 16) covariance gathered on the way


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Beliefs over a window, and how certain the last of them is."""

    beliefs: FloatArray  # (n, 16)
    covariance: FloatArray  # (16, 16) of the last
    bounded: bool  # whether a bound on a disturbance was active


class MovingHorizonEstimator:
    """Estimate the beliefs of the last `window_s` together, from all samples in it.

    Over the times of the samples, with the model f and noise Q of the filter in between,

        minimise  |x_0 - x|^2_P + sum |x_(k+1) - f(x_k)|^2_Q + sum |y - h(x_k)|^2_R
        subject to disturbances within their bounds,

    norms weighted by the inverse of their subscripts (Rao, Rawlings and Mayne 2003). The arrival
    cost x, P at the window's start, the roughness behind Q, and which samples the gate lets in
    are those of an `ExtendedKalmanFilter` that runs beside; late samples are therefore as good
    as others. Gauss-Newton from the last estimate of each time, `iterations` steps a tick: its
    block-tridiagonal system is solved directly, by PIQP where that solution leaves the bounds.

    The innovations of its estimates are the filter's.

    Raises:
        InvalidTuning: window or iterations not positive, or as `ExtendedKalmanFilter`.
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
        self._vehicle, self._table = vehicle, vehicle_table(vehicle)
        self._sensor_noise = sensor_noise or SensorNoise()
        self._process_noise = process_noise or ProcessNoise()
        self._iterations = iterations
        self._filter = ExtendedKalmanFilter(
            vehicle, self._sensor_noise, self._process_noise, gate_probability, window_s
        )
        self._last: dict[float, FloatArray] = {}  # the newest estimate of each time

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s` after all `measurements` up to it."""
        filtered = self._filter.update(time_s, measurements, command)
        states, samples = self._filter.memory()
        if len(states) < 2:
            return filtered
        guess = np.array([self._last.get(s.time_s, s.beliefs[0]) for s in states])  # (n, 16)
        found = self._step(states, samples, guess)
        for _ in range(self._iterations - 1):
            found = self._step(states, samples, found.beliefs)
        self._last = {s.time_s: x for s, x in zip(states, found.beliefs, strict=True)}
        now = states[-1].copy()
        now.beliefs[0], now.covariances[0] = found.beliefs[-1], found.covariance
        self._filter.predict(now, time_s)
        return estimate_of(
            now.beliefs[0], now.covariances[0], time_s, self._vehicle, filtered.innovations
        )

    def _step(
        self, states: list[FilterState], samples: list[Measurement], guess: FloatArray
    ) -> Trajectory:
        """Return the minimiser of the problem linearised about `guess` (n, 16)."""
        count = len(states)
        diagonal = np.zeros((count, SIZE, SIZE))
        above = np.zeros((count - 1, SIZE, SIZE))
        right = np.zeros((count, SIZE))
        arrival = np.linalg.inv(states[0].covariances[0])
        diagonal[0] = arrival
        right[0] = arrival @ (states[0].beliefs[0] - guess[0])
        for k in range(count - 1):
            leap = self._leap(states[k], guess[k], states[k + 1].time_s)
            weight = np.linalg.inv(leap.noise)
            pulled = leap.transition.T @ weight  # (16, 16)
            missed = leap.after - guess[k + 1]
            diagonal[k] += pulled @ leap.transition
            diagonal[k + 1] += weight
            above[k] = -pulled
            right[k] -= pulled @ missed
            right[k + 1] += weight @ missed
        place = {state.time_s: k for k, state in enumerate(states)}
        for sample in samples:
            k = place[sample.time_s]
            reading, by_belief = expected(sample.sensor, guess[k], self._vehicle)
            difference = np.array(sample.value) - reading
            if sample.sensor in ANGLES:
                difference[0] = wrap_angle(float(difference[0]))
            precision = self._sensor_noise.of(sample.sensor) ** -2
            diagonal[k] += precision * by_belief.T @ by_belief
            right[k] += precision * by_belief.T @ difference
        return _minimum(diagonal, above, right, guess)

    def _leap(self, state: FilterState, belief: FloatArray, until_s: float) -> Leap:
        belief, valves = belief.copy(), state.valves.copy()
        passed, noise = np.eye(SIZE), _LEAST_VARIANCE * np.eye(SIZE)
        step, roughness = np.empty((SIZE, SIZE)), float(state.roughness[0])
        now = state.time_s
        for reached, command in self._filter.commands(now, until_s):
            if command is None:  # as the filter has it
                command = np.array([*valves, belief[Belief.RIM] / self._vehicle.speed_gain])
            steps = math.ceil((reached - now) / _LONGEST_STEP_S - 1e-9)
            step_s = (reached - now) / steps
            for _ in range(steps):
                psi_t, rim = belief[Belief.PSI_T], belief[Belief.RIM]
                advance_belief(
                    *(belief, valves, command, self._table, self._process_noise.memories()),
                    *(step_s, step),
                )
                middle = 0.5 * (psi_t + belief[Belief.PSI_T]), 0.5 * (rim + belief[Belief.RIM])
                half = 0.5 * step_s * self._process_noise.density(*middle, roughness)
                noise = step @ (noise + half) @ step.T + half
                passed = step @ passed
            now = reached
        return Leap(belief, passed, noise)


def _minimum(
    diagonal: FloatArray, above: FloatArray, right: FloatArray, guess: FloatArray
) -> Trajectory:
    """Return guess + d with d minimising d'Hd / 2 - right'd, disturbances within their bounds.

    H is block-tridiagonal: blocks `diagonal` (n, 16, 16), `above` (n - 1, 16, 16). Elimination
    from the first block on leaves the information of the last in its place.
    """
    last = len(guess) - 1
    left, rest = diagonal.copy(), right.copy()
    for k in range(last):
        solved = np.linalg.solve(left[k], np.column_stack([above[k], rest[k]]))
        left[k + 1] -= above[k].T @ solved[:, :-1]
        rest[k + 1] -= above[k].T @ solved[:, -1]
    covariance = np.linalg.inv(left[last])
    beliefs, d = guess.copy(), np.zeros(SIZE)
    for k in range(last, -1, -1):
        d = np.linalg.solve(left[k], rest[k] - above[k] @ d if k < last else rest[k])
        beliefs[k] += d
    bounded = bool((np.abs(beliefs[:, STATES:]) > LARGEST).any())
    if bounded:
        beliefs = guess + _bounded_step(diagonal, above, right, guess)
    return Trajectory(beliefs, 0.5 * (covariance + covariance.T), bounded)


def _bounded_step(
    diagonal: FloatArray, above: FloatArray, right: FloatArray, guess: FloatArray
) -> FloatArray:
    """Return d (n, 16) as `_minimum` does, by PIQP; the guess held in its bounds if that fails."""
    count = len(guess)
    blocks = [[csc_matrix((SIZE, SIZE)) for _ in range(count)] for _ in range(count)]
    for k in range(count):
        blocks[k][k] = csc_matrix(diagonal[k])
        if k + 1 < count:
            blocks[k][k + 1] = csc_matrix(above[k])
            blocks[k + 1][k] = csc_matrix(above[k].T)
    bound = np.concatenate([np.full(STATES, np.inf), LARGEST])
    solver = piqp.SparseSolver()
    solver.setup(
        P=csc_matrix(bmat(blocks)),
        c=-right.ravel(),
        x_l=(-bound - guess).ravel(),
        x_u=(bound - guess).ravel(),
    )
    status = solver.solve()
    step = solver.result.x.reshape(count, SIZE)
    if status != piqp.PIQP_SOLVED or not np.isfinite(step).all():
        step = np.zeros_like(guess)
    return np.clip(guess + step, -bound, bound) - guess
