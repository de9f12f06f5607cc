"""Commands behind dead times, and the filter that predicts with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.sensed_drive import PERIOD_S, VEHICLE, SensedDrive
from ttempc.baselines.nmhe import MovingHorizonEstimator
from ttempc.errors import InvalidVehicle
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.filter import after_dead_times
from ttempc.vehicle import Vehicle


def held_at(commands, time_s):
    """Value (3,) of the command that is held at a time."""
    return next((value for end_s, value in commands if time_s <= end_s), commands[-1][1])


def test_each_input_acts_its_own_dead_time_after_it_was_sent():
    generator = np.random.default_rng(5)
    for _ in range(5):
        dead_times = generator.uniform(0.0, 0.7, 3)
        vehicle = Vehicle(
            dead_time_t=dead_times[0], dead_time_i=dead_times[1], dead_time_hp=dead_times[2]
        )
        sent = [(0.2 * k, generator.normal(size=3)) for k in range(1, 11)]
        acting = after_dead_times(sent, vehicle)
        assert acting[-1][0] == sent[-1][0]
        for time_s in generator.uniform(0.8, 2.0, 40):
            expected = [held_at(sent, time_s - d)[j] for j, d in enumerate(dead_times)]
            np.testing.assert_array_equal(held_at(acting, time_s), expected)


@pytest.mark.parametrize("estimator", [ExtendedKalmanFilter, MovingHorizonEstimator])
def test_a_dead_time_of_two_periods_is_commands_that_come_two_periods_later(estimator):
    received = SensedDrive(seed=3).run(60).received
    late = replace(VEHICLE, dead_time_t=0.4, dead_time_i=0.4, dead_time_hp=0.4)
    delayed, prompt = estimator(late), estimator(VEHICLE)
    for k, (measurements, command) in enumerate(received):
        before = received[k - 2][1] if k >= 2 else None
        one = delayed.update(k * PERIOD_S, measurements, command)
        other = prompt.update(k * PERIOD_S, measurements, before)
        np.testing.assert_allclose(one.state, other.state, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-9)


@pytest.mark.parametrize("dead_time", [-0.1, 2.5, float("nan")])
def test_a_dead_time_must_be_from_0_to_2_seconds(dead_time):
    with pytest.raises(InvalidVehicle, match=r"vehicle.dead_time_hp: .* from 0 to 2.0 s"):
        Vehicle(dead_time_hp=dead_time)
