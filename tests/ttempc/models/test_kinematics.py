"""Articulated kinematics: Jacobians, rolling constraints and the sign at the hitch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.numeric import central_differences
from ttempc.models.kinematics import articulated, trailer_point, trailer_point_jacobian
from ttempc.types import Disturbance, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
OTHER = Vehicle(
    hitch_offset=-0.2,
    drawbar_length=1.1,
    trailer_length=2.0,
    wheelbase=2.1,
    trailer_turning_offset=0.3,
)


def random_cases(count=30, steering_step=0.02):
    generator = np.random.default_rng(4)
    for _ in range(count):
        state = generator.normal(size=7) * [5, 5, 2, 0.3, 0.2, 0.2, 0.6]
        state[State.PSI_I] += state[State.PSI_T]
        steering = state[State.DELTA_T : State.V] + steering_step * generator.normal(size=2)
        disturbance = generator.normal(size=5) * [0.1, 0.1, 0.05, 0.2, 0.1]
        yield state, np.array([*steering, generator.uniform()]), disturbance


def test_jacobian_of_the_trailer_point():
    for state, _, _ in random_cases():
        numeric = central_differences(lambda x: trailer_point(x, OTHER), state)
        np.testing.assert_allclose(trailer_point_jacobian(state, OTHER), numeric, atol=1e-6)


@pytest.mark.parametrize("vehicle", [VEHICLE, OTHER])
def test_wheels_slip_sideways_by_the_disturbance(vehicle):
    for state, inputs, disturbance in random_cases():
        for slips in (np.zeros(5), disturbance):
            rate = articulated(state, inputs, vehicle, slips)
            trailer_velocity = trailer_point_jacobian(state, vehicle) @ rate
            swing = (
                vehicle.trailer_turning_offset * rate[State.PSI_I]
            )  # of the axle about its place
            for velocity, yaw, slip, behind in (
                (rate[:2], state[State.PSI_T], slips[Disturbance.SLIP_T], 0.0),
                (trailer_velocity, state[State.PSI_I], slips[Disturbance.SLIP_I], swing),
            ):
                across = velocity @ [-math.sin(yaw), math.cos(yaw)] - behind
                assert across == pytest.approx(state[State.V] * slip, abs=1e-12)


def test_steering_rate_is_that_of_the_valve_at_most():
    state = np.zeros(7)
    rate = articulated(state, np.array([9.0, -9.0, 0.0]), VEHICLE)
    assert rate[State.DELTA_T] == VEHICLE.steering_rate_t
    assert rate[State.DELTA_I] == -VEHICLE.steering_rate_i


def test_positive_trailer_steering_moves_the_trailer_to_the_right_first():
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    turned = advance(state, np.array([0.0, 0.2, 1.0 / VEHICLE.speed_gain]), VEHICLE, 0.05)
    assert trailer_point(turned, VEHICLE)[1] < 0.0
