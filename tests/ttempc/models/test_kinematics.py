"""Articulated kinematics: Jacobians, rolling constraints and the sign at the hitch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.models.kinematics import advance, tricycle
from tests.ttempc.numeric import central_differences
from ttempc.models.kinematics import (
    articulated,
    articulated_jacobian,
    hitch_angle,
    trailer_point,
    trailer_point_jacobian,
    wrap_angle,
)
from ttempc.types import Disturbance, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
OTHER = Vehicle(hitch_offset=-0.2, drawbar_length=1.1, trailer_length=2.0, wheelbase=2.1)


def random_cases(count=30, steering_step=0.02):
    generator = np.random.default_rng(4)
    for _ in range(count):
        state = generator.normal(size=7) * [5, 5, 2, 0.3, 0.2, 0.2, 0.6]
        state[State.PSI_I] += state[State.PSI_T]
        steering = state[State.DELTA_T : State.V] + steering_step * generator.normal(size=2)
        disturbance = generator.normal(size=5) * [0.1, 0.1, 0.05, 0.2, 0.1]
        yield state, np.array([*steering, generator.uniform()]), disturbance


@pytest.mark.parametrize("vehicle", [VEHICLE, OTHER])
@pytest.mark.parametrize("steering_step", [0.02, 2.0])  # within and far beyond the rate limits
def test_jacobian_of_the_articulated_model(vehicle, steering_step):
    for case in random_cases(steering_step=steering_step):
        exact = articulated_jacobian(case[0], case[1], vehicle, case[2])
        for index, derivative in enumerate(exact):

            def rate(value, index=index, case=case):
                state, inputs, disturbance = (*case[:index], value, *case[index + 1 :])
                return articulated(state, inputs, vehicle, disturbance)

            numeric = central_differences(rate, case[index])
            np.testing.assert_allclose(derivative, numeric, atol=1e-6)


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
            for velocity, yaw, slip in (
                (rate[:2], state[State.PSI_T], slips[Disturbance.SLIP_T]),
                (trailer_velocity, state[State.PSI_I], slips[Disturbance.SLIP_I]),
            ):
                across = velocity @ [-math.sin(yaw), math.cos(yaw)]
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


def test_tricycle_agrees_with_geometry_for_small_angles_with_a_negative_hitch_sign():
    """Erratum 1: a hitch behind the rear axle swings against the turn of the tractor."""
    delta_t, lam = 0.01, 0.02
    state = np.array([0.0, 0.0, lam, 0.0, delta_t, 0.0, 1.0])  # drawbar in line with the trailer
    rigid = Vehicle(hitch_offset=1.1 - 1e-9, drawbar_length=1e-9)  # RJ1 and RJ2 together
    exact = articulated(state, np.array([delta_t, 0.0, 0.5]), rigid)[State.PSI_I]
    z = np.array([0.0, 0.0, lam, 0.0, 0.0, 0.0, 1.0])
    u = np.array([delta_t, lam, 0.5])
    assert tricycle(z, u, rigid, hitch_sign=-1)[5] == pytest.approx(exact, abs=1e-7)
    assert abs(tricycle(z, u, rigid)[5] - exact) > 0.5 * abs(exact)


def test_hydrostat_position_is_a_fraction():
    """Erratum 7: 1 m/s is held at 0.714 of full stroke."""
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    steady = np.array([0.0, 0.0, 1.0 / 1.4])
    assert articulated(state, steady, VEHICLE)[State.V] == pytest.approx(0.0, abs=1e-12)
    assert tricycle(state, steady, VEHICLE)[6] == pytest.approx(0.0, abs=1e-12)


def test_hitch_angle_and_wrapping():
    state = np.array([0.0, 0.0, 0.5, 0.2, 0.0, 0.1, 1.0])
    assert hitch_angle(state) == pytest.approx(0.2)
    assert wrap_angle(3.5 * math.pi) == pytest.approx(-0.5 * math.pi)
