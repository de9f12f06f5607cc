"""References: postures and inputs that keep the articulated model on the path."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from ttempc.errors import InvalidPath, InvalidReference
from ttempc.models.kinematics import trailer_point
from ttempc.reference.path import figure_eight
from ttempc.reference.posture import posture_on_path
from ttempc.reference.reference import ConstantSpeed, Reference, check_drivable, guided
from ttempc.types import State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))


def test_both_axle_points_are_on_the_path():
    sample = REFERENCE.on_grid(0.2)
    path = REFERENCE.path
    np.testing.assert_allclose(sample.state[:, :2], path.pose(sample.distance_m)[:, :2], atol=1e-12)
    for state, trailer in zip(sample.state[::50], sample.trailer_xy[::50], strict=True):
        np.testing.assert_allclose(trailer_point(state, VEHICLE), trailer, atol=1e-12)
    # nearest point of a dense path
    dense = path.pose(np.arange(-3.0, path.lap_m, 0.001))[:, :2]
    for trailer in sample.trailer_xy[::97]:
        assert np.min(np.hypot(*(dense - trailer).T)) < 6e-4


@pytest.mark.parametrize("period_s", [0.2, 0.07])
def test_a_grid_reaches_to_the_end_of_the_reference_and_ticks_beyond_it(period_s):
    grid, longer = (REFERENCE.on_grid(period_s, beyond=beyond) for beyond in (0, 5))
    np.testing.assert_allclose(np.diff(longer.time_s), period_s)
    assert grid.time_s[-2] < REFERENCE.duration_s <= grid.time_s[-1] + 1e-9
    assert len(longer.time_s) == len(grid.time_s) + 5
    np.testing.assert_array_equal(longer.state[:-5], grid.state)


def test_speeds_and_yaw_rates_are_the_derivatives():
    t, h = np.linspace(1.0, 130.0, 997), 1e-4
    before, after, now = REFERENCE.at(t - h), REFERENCE.at(t + h), REFERENCE.at(t)
    velocity = (after.trailer_xy - before.trailer_xy) / (2 * h)
    np.testing.assert_allclose(np.hypot(velocity[:, 0], velocity[:, 1]), now.speed_i, atol=1e-6)
    turning = (after.state - before.state) / (2 * h)
    np.testing.assert_allclose(turning[:, State.PSI_T], now.yaw_rate_t, atol=1e-5)
    np.testing.assert_allclose(turning[:, State.PSI_I], now.yaw_rate_i, atol=1e-5)
    np.testing.assert_allclose(now.psi_d, now.state[:, State.PSI_I] + now.state[:, State.DELTA_I])


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.25])
def test_feedforward_keeps_the_articulated_model_on_the_reference(speed):
    reference = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(speed))
    step_s = 0.02
    state = reference.at(0.0).state
    middle = np.arange(int(reference.duration_s / step_s)) * step_s + 0.5 * step_s
    inputs, expected = reference.at(middle).inputs, reference.at(middle + 0.5 * step_s)
    for k, (u, r, r_i) in enumerate(zip(inputs, expected.state, expected.trailer_xy, strict=True)):
        state = advance(state, u, VEHICLE, step_s)
        if k % 50 == 0:
            np.testing.assert_allclose(state, r, atol=2e-3)
            np.testing.assert_allclose(trailer_point(state, VEHICLE), r_i, atol=2e-3)


@pytest.mark.parametrize(
    ("behind", "offset", "point"),
    [(0.6, 0.25, "tool"), (0.6, 0.25, "axle"), (0.2, 0.3, "tool"), (0.25, 0.25, "tool")],
)
def test_inputs_of_a_guided_reference_keep_its_point_on_the_line_of_the_judged_one(
    behind, offset, point
):
    vehicle = replace(VEHICLE, tool_behind=behind, trailer_turning_offset=offset)
    judged = Reference(figure_eight(laps=1), vehicle, ConstantSpeed(1.0))
    reference, step_s = guided(judged, point), 0.02
    state = reference.at(0.0).state
    kept = behind if point == "tool" else 0.0
    longer = replace(vehicle, trailer_length=vehicle.trailer_length + kept)
    line = judged.path.pose(np.arange(-5.0, judged.path.lap_m, 0.001))
    line = line[:, :2] - kept * _unit(line[:, 2])
    for k, u in enumerate(reference.at((np.arange(3500) + 0.5) * step_s).inputs):
        state = advance(state, u, vehicle, step_s)
        if k % 100 == 0:
            place = trailer_point(state, longer)
            np.testing.assert_allclose(state, reference.at((k + 1) * step_s).state, atol=2e-3)
            assert np.min(np.hypot(*(line - place).T)) < 2e-3


def test_without_a_tool_the_guided_reference_is_the_judged_one():
    assert guided(REFERENCE, "tool") is REFERENCE


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf, 1.5])
def test_speeds_that_cannot_be_driven_are_refused(speed):
    with pytest.raises(InvalidReference, match="speed"):
        Reference(figure_eight(), VEHICLE, ConstantSpeed(speed))


EIGHT = figure_eight()
ALONG = np.linspace(-2.0, EIGHT.lap_m + 2.0, 2001)


def test_derivatives_agree_with_differences():
    h = 1e-5
    before, after = (
        posture_on_path(EIGHT, VEHICLE, ALONG - h),
        posture_on_path(EIGHT, VEHICLE, ALONG + h),
    )
    posture = posture_on_path(EIGHT, VEHICLE, ALONG)
    smooth = EIGHT.curvature_derivative(ALONG - h) == EIGHT.curvature_derivative(ALONG + h)
    for rate, first, last in (
        (posture.delta_t_per_m, before.delta_t, after.delta_t),
        (posture.delta_i_per_m, before.delta_i, after.delta_i),
    ):
        np.testing.assert_allclose(rate[smooth], ((last - first) / (2 * h))[smooth], atol=1e-6)
    travel = np.hypot(*(after.pose_i - before.pose_i)[:, :2].T) / (2 * h)
    np.testing.assert_allclose(posture.travel_ratio[smooth], travel[smooth], atol=1e-6)


def test_steady_trailer_steering_on_the_circle():
    """Both axles on R = 10 m need a steady delta_i of 15.4 deg (erratum 3)."""
    posture = posture_on_path(EIGHT, VEHICLE, 35.0)
    assert math.degrees(posture.delta_i) == pytest.approx(15.4, abs=0.05)
    assert posture.delta_i_per_m == pytest.approx(0.0, abs=1e-9)


def test_tight_circle_is_refused_for_the_front_steering():
    stiff = Vehicle(steering_limit_t=math.radians(8.0))
    with pytest.raises(InvalidPath, match=r"front steering would need 8\.0 deg, allowed are 7\.2"):
        check_drivable(figure_eight(), stiff)


def _unit(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
