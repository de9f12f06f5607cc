"""Moving-horizon estimators: states and slip factors of that model."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S
from ttempc.estimation.nmhe import (
    FACTOR_MAX,
    FACTOR_MIN,
    MovingHorizonEstimator,
    PrintedEstimator,
)
from ttempc.models.printed import advance_printed, geometric_parameters, printed_parameters
from ttempc.types import Command, Measurement, Sensor, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
KINDS = {PrintedEstimator: printed_parameters, MovingHorizonEstimator: geometric_parameters}


def estimates(factors, noise, ticks=150, seed=1, gap=range(0), kind=PrintedEstimator):
    """Drive the estimator's model with slip `factors`; return truth (ticks, 7) and estimates."""
    generator = np.random.default_rng(seed)
    parameters, given = KINDS[kind](VEHICLE), np.array(factors)
    estimator = kind(VEHICLE)
    z = np.array([0.0, 0.0, 0.0, -2.4, 0.0, 0.0, 1.0])
    truth, found, command = [], [], None
    steering = np.array([0.0, 0.0, 0.72, 0.0])
    for k in range(ticks):
        readings = {
            Sensor.GNSS_TRACTOR: z[:2],
            Sensor.GNSS_TRAILER: z[3:5],
            Sensor.STEERING_TRACTOR: steering[:1],
            Sensor.STEERING_TRAILER: steering[1:2],
            Sensor.HITCH: steering[3:],
            Sensor.ENCODER: z[6:],
        }
        sd = {Sensor.GNSS_TRACTOR: 0.03, Sensor.GNSS_TRAILER: 0.03, Sensor.ENCODER: 0.1}
        samples = [
            Measurement(
                k * PERIOD_S,
                sensor,
                tuple(value + noise * sd.get(sensor, 0.0) * generator.normal(size=len(value))),
            )
            for sensor, value in readings.items()
            if k not in gap or not sensor.startswith("gnss")
        ]
        found.append(estimator.update(k * PERIOD_S, samples, command))
        truth.append(z)
        swing = 0.2 * np.sin(0.3 * k * PERIOD_S)
        steering = np.array([swing, 0.15 * np.cos(0.4 * k * PERIOD_S), 0.72, 0.05 * swing])
        command = Command(swing, steering[1], 0.72)
        z = z.copy()
        advance_printed(z, steering, given, parameters, PERIOD_S, np.empty((7, 13)))
    return np.array(truth), found


@pytest.mark.parametrize("kind", KINDS)
def test_finds_state_and_slip_factors_of_its_model(kind):
    factors = (0.85, 0.8, 0.7)
    truth, found = estimates(factors, noise=0.0, kind=kind)
    last = found[-1]
    np.testing.assert_allclose(last.slip_factors, factors, atol=0.02)
    np.testing.assert_allclose(last.state[:2], truth[-1, :2], atol=0.005)
    np.testing.assert_allclose(last.trailer_xy, truth[-1, 3:5], atol=0.005)
    assert last.state[State.V] == pytest.approx(0.85 * truth[-1, 6], abs=0.01)


@pytest.mark.parametrize(
    ("factors", "bound"), [((0.15,) * 3, FACTOR_MIN), ((1.4,) * 3, FACTOR_MAX)]
)
def test_factors_keep_their_range(factors, bound):
    _, found = estimates(factors, noise=0.0, ticks=60)
    every = np.array([e.slip_factors for e in found])
    assert np.all((every >= FACTOR_MIN - 1e-6) & (every <= FACTOR_MAX + 1e-6))
    assert abs(every[-1, 0] - bound) < 1e-3


def test_gap_of_gnss_is_bridged_by_the_model():
    truth, found = estimates((0.9, 0.9, 0.9), noise=0.0, ticks=110, gap=range(100, 110))
    assert np.hypot(*(found[-1].state[:2] - truth[-1, :2])) < 0.02
    assert found[-1].covariance[0, 0] > found[99].covariance[0, 0]
