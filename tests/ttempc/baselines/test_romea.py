"""Romea's laws: the model they invert, poles, slip that they find, symmetry, refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, drive, seen_truth
from ttempc.baselines.romea import (
    chained_turn,
    deviation,
    drawbar_steering,
    front_steering,
    predictive_gain,
    wanted_course,
)
from ttempc.baselines.slip_observer import Deviation, Motion, SlipObserver, Slips
from ttempc.errors import InvalidReference, InvalidTuning
from ttempc.guidance.controllers import make_controller
from ttempc.models.kinematics import NO_DISTURBANCE, trailer_point
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.reference.speed import Backward
from ttempc.types import Disturbance, Estimate, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
STRAIGHT = Reference(straight(60.0), VEHICLE, ConstantSpeed(1.0))
BOTH = ("romea-backstepping", "romea-predictive")
SLIPS = Slips(front=0.03, rear=-0.05, trailer=0.04)
BESIDE = Deviation(across=0.3, heading=-0.1, curvature=0.08)


def course_rate(steering: float, at: Deviation, slips: Slips, wheelbase: float) -> float:
    """Return d theta_2 / ds of the extended kinematic model, s the distance travelled."""
    yaw = math.cos(slips.rear) * (math.tan(steering + slips.front) - math.tan(slips.rear))
    alpha = 1.0 - at.curvature * at.across
    return yaw / wheelbase - at.curvature * math.cos(at.heading + slips.rear) / alpha


@pytest.mark.parametrize("turn", [0.0, 0.2, -0.3])
def test_front_steering_inverts_the_extended_kinematic_model(turn):
    steering = front_steering(turn, BESIDE, SLIPS, 1.4)
    assert course_rate(steering, BESIDE, SLIPS, 1.4) == pytest.approx(turn)


@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_chained_form_has_the_published_double_pole_along_the_path(gear):
    """y'' + K_d y' + K_d^2 / 4 y = 0 by the arc length: differences of y' = alpha tan(theta_2)."""
    gain = 1.1
    course = BESIDE.heading + SLIPS.rear
    turn = chained_turn(gain, BESIDE, course, gear, most=1.3)

    def slope(y, theta):
        return (1.0 - BESIDE.curvature * y) * math.tan(theta)

    alpha = BESIDE.stretch
    arc = math.cos(course) / alpha  # of the path, per distance travelled
    step = 1e-6
    y = BESIDE.across + step * math.sin(course)
    second = (slope(y, course + step * turn) - slope(BESIDE.across, course)) / (step * arc)
    wanted = -gear * gain * slope(BESIDE.across, course) - 0.25 * gain**2 * BESIDE.across
    assert second == pytest.approx(wanted, rel=1e-4)


def test_wanted_course_lets_the_deviation_decay_and_is_bounded():
    at = Deviation(across=0.01, heading=0.0, curvature=0.0)
    assert math.sin(wanted_course(0.4, at, 0.5)) == pytest.approx(-0.4 * 0.01, rel=1e-4)
    assert wanted_course(0.4, at._replace(across=50.0), 0.5) == -0.5


def test_a_step_of_the_drawbar_turns_the_trailer_as_the_kinematics_do():
    """RJ1 and the axle point stay where they are, to first order, when the drawbar turns."""
    state = STRAIGHT.at(5.0).state.copy()
    error = 1e-5
    turned = state.copy()
    turned[State.DELTA_I] = drawbar_steering(float(state[State.DELTA_I]), error, VEHICLE)
    turned[State.PSI_I] -= error
    moved = trailer_point(turned, VEHICLE) - trailer_point(state, VEHICLE)
    assert np.linalg.norm(moved) < 1e-3 * error
    assert turned[State.DELTA_I] > state[State.DELTA_I]


def test_predictive_gain_is_the_least_squares_solution_and_1_where_nothing_is_hastened():
    lag, response, horizon = 0.2, 0.35, 0.8
    steps = np.arange(1, 5) * PERIOD_S
    reached = 1.0 - np.exp(-steps / lag)
    wanted = 1.0 - np.exp(-steps / response)
    (expected,) = np.linalg.lstsq(reached[:, None], wanted, rcond=None)[0]
    assert predictive_gain(lag, response, horizon, PERIOD_S) == pytest.approx(float(expected))
    assert predictive_gain(lag, lag, horizon, PERIOD_S) == pytest.approx(1.0)
    assert predictive_gain(lag, 0.1, horizon, PERIOD_S) > 1.0


def test_deviation_from_a_circle_does_not_depend_on_the_point_of_the_reference():
    radius = 12.0
    point = np.array([0.5, 0.25])
    found = []
    for angle in (0.0, 0.06):
        on = radius * np.array([math.sin(angle), 1.0 - math.cos(angle)])
        found.append(deviation(point, 0.1, on, angle, 1.0 / radius))
    assert found[0].across == pytest.approx(found[1].across, abs=2e-3)
    assert found[0].heading == pytest.approx(found[1].heading, abs=2e-3)
    exact = radius - math.hypot(point[0], radius - point[1])
    assert found[1].across == pytest.approx(exact, abs=1e-3)


def test_observer_finds_constant_slips_with_its_double_pole():
    """The error of the rear slip is that of a double pole; all three slips are found in the end."""
    memory_s = 0.8
    observer = SlipObserver(VEHICLE, PERIOD_S, memory_s)
    y, theta, y_i = 0.2, -SLIPS.rear, 0.1  # the vehicle goes along its path, askew
    steering = math.atan(math.tan(SLIPS.rear)) - SLIPS.front
    errors = []
    for _ in range(60):
        motion = Motion(Deviation(y, theta, 0.0), Deviation(y_i, 0.0, 0.0), steering, 1.0, 1.0)
        slips = observer.update(motion)
        errors.append(slips.rear - SLIPS.rear)
        y_i += PERIOD_S * math.sin(SLIPS.trailer)
    np.testing.assert_allclose(slips, SLIPS, atol=1e-4)
    pole = math.exp(-PERIOD_S / memory_s)
    rest = np.array(errors[30:])
    left = rest[2:] - 2.0 * pole * rest[1:-1] + pole**2 * rest[:-2]
    assert np.abs(left).max() < 1e-3 * np.abs(rest).max()


def test_observer_keeps_the_slips_of_a_vehicle_that_stands():
    observer = SlipObserver(VEHICLE, PERIOD_S, 0.8)
    for k in range(20):
        at = Deviation(0.01 * k, 0.0, 0.0)
        before = observer.update(Motion(at, at, 0.0, 1.0, 1.0))
    assert before.rear > 0.01
    for k in range(20):
        at = Deviation(0.2 - 0.02 * k, 0.0, 0.0)
        assert observer.update(Motion(at, at, 0.0, 0.0, 0.0)) == before


@pytest.mark.parametrize("slip", ["filter", "observer"])
@pytest.mark.parametrize("name", BOTH)
def test_constant_slip_leaves_no_deviation(name, slip):
    """From half a metre beside a line on a slope of side slips; the observer is told nothing."""
    disturbance = np.zeros(len(Disturbance))
    disturbance[[Disturbance.SLIP_T, Disturbance.SLIP_I, Disturbance.STEERING]] = 0.06, -0.05, 0.03
    controller = make_controller(name, VEHICLE, STRAIGHT, PERIOD_S, options={"slip": slip})
    offset = np.zeros(len(State))
    offset[State.Y] = 0.5
    run = drive(controller, STRAIGHT, offset=offset, disturbance=disturbance)
    assert not run.lost
    assert run.tractor_m[-1] < 1e-3
    assert run.trailer_m[-1] < 5e-3  # the tilted trailer is shorter, which is along the path


@pytest.mark.parametrize("name", BOTH)
def test_above_their_speed_the_decay_over_time_stays(name):
    """Both gains of a second-order decay over the distance halve at twice the speed."""
    vehicle = Vehicle(speed_gain=3.0)
    turns = []
    for speed in (1.0, 2.0):
        reference = Reference(straight(60.0), vehicle, ConstantSpeed(speed))
        options = {"fastest_mps": 1.0}
        controller = make_controller(name, vehicle, reference, PERIOD_S, options=options)
        state = reference.at(0.0).state
        state[State.Y] += 1e-4
        step = controller.step(seen_truth(state, 0.0, vehicle), 0)
        turns.append(math.tan(step.command.delta_t))
    assert turns[1] == pytest.approx(turns[0] / 4.0, rel=1e-3)


def test_curvature_is_prepared_for_by_the_predictive_law():
    reference = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
    peaks = [
        float(drive(make_controller(name, VEHICLE, reference, PERIOD_S), reference).largest_m)
        for name in BOTH
    ]
    assert peaks[1] < peaks[0] < 0.05


def mirrored(estimate: Estimate) -> Estimate:
    flip = np.array([1.0, -1.0])
    signs = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0])
    slips = np.array([-1.0, -1.0, -1.0, 1.0, 1.0])
    return replace(
        estimate,
        state=estimate.state * signs,
        trailer_xy=estimate.trailer_xy * flip,
        hitch_angle=-estimate.hitch_angle,
        disturbance=estimate.disturbance * slips,
    )


@pytest.mark.parametrize("slip", ["filter", "observer"])
@pytest.mark.parametrize("name", BOTH)
def test_a_mirrored_vehicle_is_steered_to_the_other_side(name, slip):
    generator = np.random.default_rng(7)
    left, right = (
        make_controller(name, VEHICLE, STRAIGHT, PERIOD_S, options={"slip": slip}) for _ in range(2)
    )
    for k in range(30):
        state = STRAIGHT.at(k * PERIOD_S).state + 0.03 * generator.normal(size=7)
        slips = 0.02 * generator.normal(size=len(Disturbance))
        estimate = seen_truth(state, k * PERIOD_S, VEHICLE, slips)
        one = left.step(estimate, k).command.as_array()
        other = right.step(mirrored(estimate), k).command.as_array()
        np.testing.assert_allclose(one * [-1.0, -1.0, 1.0], other, atol=1e-12)


@pytest.mark.parametrize("name", BOTH)
def test_in_reverse_a_steered_trailer_returns_to_its_line(name):
    vehicle = replace(VEHICLE, reverse=True)
    reference = Reference(straight(30.0), vehicle, Backward(ConstantSpeed(0.8), 30.0))
    offset = np.zeros(len(State))
    offset[State.Y] = 0.3
    run = drive(make_controller(name, vehicle, reference, PERIOD_S), reference, offset=offset)
    assert not run.lost
    assert run.tractor_m[-1] < 0.01
    assert run.trailer_m[-1] < 0.01


@pytest.mark.parametrize("name", BOTH)
def test_the_tractor_leads_a_plain_trailer_that_slips(name):
    vehicle = replace(VEHICLE, steering_limit_i=0.0)
    reference = Reference(straight(60.0), vehicle, ConstantSpeed(1.0))
    disturbance = NO_DISTURBANCE.copy()
    disturbance[Disturbance.SLIP_I] = 0.05
    run = drive(
        make_controller(name, vehicle, reference, PERIOD_S), reference, disturbance=disturbance
    )
    assert run.trailer_m[-1] < 5e-3
    length = vehicle.drawbar_length + vehicle.trailer_length
    assert run.tractor_m[-1] > 0.04 * length  # beside the path by about slip times length


@pytest.mark.parametrize("name", BOTH)
def test_a_plain_trailer_in_reverse_and_options_out_of_range_are_refused(name):
    vehicle = replace(VEHICLE, reverse=True, steering_limit_i=0.0)
    reference = Reference(straight(30.0), vehicle, Backward(ConstantSpeed(0.8), 30.0))
    with pytest.raises(InvalidReference, match="plain trailer"):
        make_controller(name, vehicle, reference, PERIOD_S)
    for options in ({"slip": "guess"}, {"memory_s": 0.0}, {"trailer_gain_per_m": -1.0}):
        with pytest.raises(InvalidTuning, match=next(iter(options))):
            make_controller(name, VEHICLE, STRAIGHT, PERIOD_S, options=options)
