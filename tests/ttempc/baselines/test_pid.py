"""Conventional guidance: placed poles, vehicles of other sizes, no wind-up."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.scenario.scenario import load

from tests.reference.models.kinematics import advance
from tests.ttempc.closed_loop import PERIOD_S, seen_truth
from ttempc.baselines.pid import (
    PidFeedback,
    PidOptions,
    front_steering_gains,
    poles,
    reverse_gains,
    speed_gains,
    trailer_steering_gains,
)
from ttempc.guidance.controllers import make_controller
from ttempc.laws.tracking_controller import ExactCourse
from ttempc.models.kinematics import NO_DISTURBANCE, articulated, trailer_point_jacobian
from ttempc.reference.path import straight
from ttempc.reference.reference import ConstantSpeed, Reference, guided
from ttempc.types import State
from ttempc.vehicle import Vehicle


def farm() -> Vehicle:
    scenario = load("farm", [])[1]
    return scenario.vehicles().model


VEHICLES = {"paper": (Vehicle(), 1.0), "farm4500": (farm(), 1.5)}


@pytest.fixture(params=VEHICLES.values(), ids=VEHICLES.keys())
def moving(request):
    return request.param


def roots(*coefficients):
    return np.roots([float(np.squeeze(c)) for c in coefficients])


def test_front_steering_has_three_equal_poles(moving):
    vehicle, v = moving
    gains = front_steering_gains(np.array([v]), vehicle, PERIOD_S)
    by_steering = v**2 / vehicle.wheelbase  # e'' = v^2 / L delta
    found = roots(
        1.0,
        by_steering * gains.derivative,
        by_steering * gains.proportional,
        by_steering * gains.integral,
    )
    np.testing.assert_allclose(found, -poles(vehicle, PERIOD_S)[0], rtol=1e-3)


def test_loops_are_slower_by_what_the_valves_take_for_the_swing(moving):
    vehicle, _ = moving
    options = PidOptions(lag_ratio=5.0, trailer_lag_ratio=4.0, swing_deg=2.0)
    still = 1.0 / np.array(poles(vehicle, PERIOD_S, replace(options, swing_deg=0.0)))
    swung = 1.0 / np.array(poles(vehicle, PERIOD_S, options))
    expected = np.radians(2.0) / vehicle.input_rate[:2] * [5.0, 4.0]
    np.testing.assert_allclose(swung - still, expected, rtol=1e-9)


def test_trailer_steering_has_two_equal_poles_and_the_sign_of_its_axle(moving):
    vehicle, v = moving
    gains = trailer_steering_gains(np.array([v]), vehicle, PERIOD_S)
    d = vehicle.drawbar_length
    lag = (d + vehicle.trailer_length) / v
    found = roots(lag, 1.0 - d * gains.proportional, -d * gains.integral)
    np.testing.assert_allclose(found, found.mean(), rtol=1e-3)
    assert np.all(found.real < 0.0)
    assert gains.proportional <= 0.0  # a positive angle moves the trailer to the right


def test_speed_has_three_equal_poles(moving):
    vehicle, v = moving
    gains, k, tau = (
        speed_gains(np.array([v]), vehicle),
        vehicle.speed_gain,
        vehicle.speed_time_constant,
    )
    found = roots(tau, 1.0 + k * gains.derivative, k * gains.proportional, k * gains.integral)
    np.testing.assert_allclose(found, -1.0 / tau, rtol=1e-3)


def test_integral_waits_while_an_input_is_at_its_limit():
    """Held aside for long, it leaves the limit as soon as the error has changed its sign."""
    vehicle = Vehicle()
    reference = Reference(straight(60.0), vehicle, ConstantSpeed(1.0))
    controller = make_controller("pid", vehicle, reference, PERIOD_S)
    for k in range(150):
        held = reference.at(k * PERIOD_S).state + np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        command = controller.step(seen_truth(held, k * PERIOD_S, vehicle), k).command
    assert command.delta_t == -vehicle.steering_limit_t
    for k in range(150, 160):
        beyond = reference.at(k * PERIOD_S).state + np.array([0.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
        command = controller.step(seen_truth(beyond, k * PERIOD_S, vehicle), k).command
    assert command.delta_t > 0.0


def test_the_last_bit_of_a_command_does_not_decide_whether_an_integral_grows():
    """Sums of another order, as on another processor, differ by 1e-16 from a command as it is."""
    reference = Reference(straight(60.0), Vehicle(), ConstantSpeed(1.0))
    course = ExactCourse(guided(reference, "tool"), PERIOD_S)
    offset = np.array([0.0, 0.05, 0.0, 0.0, 0.05, 0.0, 0.0])
    feedbacks = []
    for rounding in (0.0, 1e-16, -1e-16):
        law = PidFeedback(course, PidOptions())
        sent = course.feedforward[0]
        for k in range(5):
            state = reference.at(k * PERIOD_S).state + offset
            told = law.step(k, seen_truth(state, k * PERIOD_S, Vehicle()), sent)
            sent = course.feedforward[k] + told.feedback + rounding
        feedbacks.append(told.feedback)
    np.testing.assert_allclose(feedbacks[1:], [feedbacks[0]] * 2, atol=1e-12)


@pytest.mark.parametrize("name", ["pid", "lqr"])
def test_from_beside_it_approaches_at_the_capture_angle(name):
    vehicle = Vehicle()
    reference = Reference(straight(60.0), vehicle, ConstantSpeed(1.0))
    options = {"capture_deg": 25.0}
    controller = make_controller(name, vehicle, reference, PERIOD_S, options=options)
    state, headings = reference.at(0.0).state + np.array([0.0, 4.5, 0.0, 0.0, 0.0, 0.0, 0.0]), []
    for k in range(30):
        command = controller.step(seen_truth(state, k * PERIOD_S, vehicle), k).command.as_array()
        for _ in range(20):
            state = advance(state, command, vehicle, PERIOD_S / 20, NO_DISTURBANCE)
        headings.append(-math.degrees(state[State.PSI_T]))
    assert 20.0 < max(headings) < 32.0


def test_in_reverse_with_a_plain_trailer_all_four_poles_are_the_designed_one():
    """Of integral, cross-track error, heading and fold, on the exact model linearised at rest."""
    vehicle = replace(Vehicle(), steering_limit_i=0.0, reverse=True)
    speed = -0.8
    gains, fold = reverse_gains(np.array([speed]), vehicle, 0.2)
    feedback = np.array(
        [gains.integral[0], gains.proportional[0], gains.derivative[0] * speed, fold[0]]
    )

    def rate(z, delta_t):
        """Return the rate of (integral, e, psi_i, lambda) of the articulated kinematics."""
        state = np.zeros(len(State))
        state[State.PSI_T], state[State.PSI_I] = z[2] + z[3], z[2]
        state[State.DELTA_T], state[State.V] = delta_t, speed
        moved = articulated(state, np.array([delta_t, 0.0, speed / vehicle.speed_gain]), vehicle)
        jacobian = trailer_point_jacobian(state, vehicle)
        across = jacobian @ moved
        yaw_i = moved[State.PSI_I]
        return np.array([z[1], across[1], yaw_i, moved[State.PSI_T] - yaw_i])

    step = 1e-6
    closed = np.empty((4, 4))
    for column in range(4):
        z = np.zeros(4)
        z[column] = step
        closed[:, column] = rate(z, float(-feedback @ z)) / step
    found = np.poly(closed)
    pole = -found[1] / 4.0
    assert pole < 0.0
    np.testing.assert_allclose(found, np.poly(np.full(4, pole)), rtol=1e-3)
