"""Moving-horizon estimator: equal to the Kalman filter for linear models, within its bounds."""

from __future__ import annotations

import numpy as np

from tests.ttempc.sensed_drive import PERIOD_S, VEHICLE, SensedDrive
from ttempc.baselines.nmhe import MovingHorizonEstimator, _minimum
from ttempc.models.augmented_state import DISTURBANCE_BOUND, SIZE, STATES


def chain(generator, count):
    """A random linear model: arrival covariance, transitions, noises, sensors, readings."""

    def covariance():
        root = generator.normal(size=(SIZE, SIZE))
        return root @ root.T / SIZE + 0.1 * np.eye(SIZE)

    transitions = np.eye(SIZE) + 0.1 * generator.normal(size=(count - 1, SIZE, SIZE))
    noises = np.array([0.01 * covariance() for _ in range(count - 1)])
    sensors = generator.normal(size=(count, 3, SIZE))
    return covariance(), transitions, noises, sensors, generator.normal(size=(count, 3))


def system(arrival, transitions, noises, sensors, readings, mean, guess):
    """The blocks of the window's problem about `guess`, with reading noise 1."""
    count = len(readings)
    diagonal, above = np.zeros((count, SIZE, SIZE)), np.zeros((count - 1, SIZE, SIZE))
    right = np.zeros((count, SIZE))
    diagonal[0] = np.linalg.inv(arrival)
    right[0] = diagonal[0] @ (mean - guess[0])
    for k in range(count - 1):
        weight = np.linalg.inv(noises[k])
        defect = transitions[k] @ guess[k] - guess[k + 1]
        diagonal[k] += transitions[k].T @ weight @ transitions[k]
        diagonal[k + 1] += weight
        above[k] = -transitions[k].T @ weight
        right[k] -= transitions[k].T @ weight @ defect
        right[k + 1] += weight @ defect
    for k in range(count):
        diagonal[k] += sensors[k].T @ sensors[k]
        right[k] += sensors[k].T @ (readings[k] - sensors[k] @ guess[k])
    return diagonal, above, right


def test_a_linear_window_gives_the_estimate_of_the_kalman_filter():
    """In one step from any guess; the covariance of the last augmented state agrees, too."""
    generator = np.random.default_rng(81)
    for _ in range(5):
        arrival, transitions, noises, sensors, readings = chain(generator, 6)
        mean = 1e-3 * generator.normal(size=SIZE)
        readings = 1e-3 * readings
        guess = 1e-3 * generator.normal(size=(6, SIZE))
        blocks = system(arrival, transitions, noises, sensors, readings, mean, guess)
        states, covariance = _minimum(*blocks, guess)
        x, p = mean, arrival
        for k in range(6):
            if k:
                x, p = transitions[k - 1] @ x, transitions[k - 1] @ p @ transitions[k - 1].T
                p = p + noises[k - 1]
            gain = p @ sensors[k].T @ np.linalg.inv(sensors[k] @ p @ sensors[k].T + np.eye(3))
            x, p = x + gain @ (readings[k] - sensors[k] @ x), p - gain @ sensors[k] @ p
        np.testing.assert_allclose(states[-1], x, atol=1e-12)
        np.testing.assert_allclose(covariance, p, atol=1e-10)


def test_a_bounded_window_is_the_minimum_within_its_bounds():
    """The gradient is zero where no bound is active and points inwards where one is."""
    generator = np.random.default_rng(82)
    arrival, transitions, noises, sensors, readings = chain(generator, 4)
    guess = np.zeros((4, SIZE))
    mean = np.concatenate([np.zeros(STATES), 1.5 * np.minimum(DISTURBANCE_BOUND, 1.0)])
    diagonal, above, right = system(
        arrival, transitions, noises, sensors, 0.1 * readings, mean, guess
    )
    states, _ = _minimum(diagonal, above, right, guess)
    disturbances = states[:, STATES:]
    assert np.all(np.abs(disturbances) <= DISTURBANCE_BOUND)
    gradient = np.einsum("kij,kj->ki", diagonal, states) - right
    gradient[:-1] += np.einsum("kij,kj->ki", above, states[1:])
    gradient[1:] += np.einsum("kij,ki->kj", above, states[:-1])
    active = np.zeros((4, SIZE), dtype=bool)
    active[:, STATES:] = np.abs(disturbances) > DISTURBANCE_BOUND - 1e-6
    assert active.any()
    np.testing.assert_allclose(gradient[~active], 0.0, atol=1e-4)
    assert np.all(gradient[active] * states[active] < 1e-4)


def test_estimates_are_close_to_those_of_the_filter():
    """For the same samples the differences are far below the standard deviations."""
    drive = SensedDrive(12).run(60)
    estimator = MovingHorizonEstimator(VEHICLE)
    for k, (samples, command) in enumerate(drive.received):
        estimate = estimator.update(k * PERIOD_S, samples, command)
        filtered = drive.estimates[k]
        sd = np.sqrt(np.diag(filtered.covariance))
        assert np.all(np.abs(estimate.state - filtered.state) < 0.3 * sd)
        np.testing.assert_allclose(np.diag(estimate.covariance), sd**2, rtol=0.2)
        assert estimate.innovations == filtered.innovations
