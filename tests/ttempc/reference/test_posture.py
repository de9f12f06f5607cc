"""Posture with both axle points on one path; refusal of paths beyond the steering."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.path import Path, Segment, figure_eight, straight
from ttempc.reference.reference import check_drivable, posture_on_path
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
EIGHT = figure_eight()
ALONG = np.linspace(-2.0, EIGHT.lap_m + 2.0, 2001)


def test_drawbar_fits_between_its_joints():
    posture = posture_on_path(EIGHT, VEHICLE, ALONG)
    rj1 = posture.pose_t[:, :2] - VEHICLE.hitch_offset * _unit(posture.pose_t[:, 2])
    rj2 = posture.pose_i[:, :2] + VEHICLE.trailer_length * _unit(posture.pose_i[:, 2])
    drawbar = VEHICLE.drawbar_length * _unit(posture.psi_d)
    np.testing.assert_allclose(rj1 - rj2, drawbar, atol=1e-12)


def test_trailer_is_on_the_path_behind_the_tractor():
    posture = posture_on_path(EIGHT, VEHICLE, ALONG)
    np.testing.assert_allclose(posture.pose_i, EIGHT.pose(posture.distance_i), atol=1e-12)
    length = VEHICLE.drawbar_offset + VEHICLE.trailer_length
    assert np.all(np.abs(ALONG - posture.distance_i - length) < 0.05)


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
        (posture.travel_ratio, before.distance_i, after.distance_i),
    ):
        np.testing.assert_allclose(rate[smooth], ((last - first) / (2 * h))[smooth], atol=1e-6)


def test_steady_trailer_steering_on_the_circle():
    """Both axles on R = 10 m need a steady delta_i of 15.4 deg (erratum 3)."""
    posture = posture_on_path(EIGHT, VEHICLE, 35.0)
    assert math.degrees(posture.delta_i) == pytest.approx(15.4, abs=0.05)
    assert posture.delta_i_per_m == pytest.approx(0.0, abs=1e-9)


def test_straight_posture_is_straight():
    posture = posture_on_path(straight(10.0), VEHICLE, np.linspace(0.0, 10.0, 5))
    for angle in (posture.beta, posture.delta_i, posture.delta_t):
        np.testing.assert_allclose(angle, 0.0, atol=1e-12)


@pytest.mark.parametrize("radius", [6.0, 10.0, 14.0])
def test_paths_within_the_steering_are_accepted(radius):
    check_drivable(figure_eight(radius, 2.2 * radius + 8.0), VEHICLE)


def test_tight_circle_is_refused_for_the_trailer_with_its_place():
    with pytest.raises(InvalidPath, match=r"s = .* m .*trailer steering .* 26\.3 deg"):
        check_drivable(figure_eight(5.0), VEHICLE)


def test_tight_circle_is_refused_for_the_front_steering():
    stiff = Vehicle(steering_limit_t=math.radians(8.0))
    with pytest.raises(InvalidPath, match=r"front steering would need 8\.0 deg, allowed are 7\.2"):
        check_drivable(figure_eight(), stiff)


def test_missing_steering_at_the_stop_costs_centimetres():
    """The reason why a path may need 5 % more than the trailer's stop."""
    distance_rj1 = math.hypot(6.0, VEHICLE.hitch_offset)  # from the centre of the circle

    def trailer_radius(delta_i):
        """Radius on which the trailer axle settles, from the distance of RJ1 to the centre."""
        ahead = VEHICLE.trailer_length + VEHICLE.drawbar_length * math.cos(delta_i)
        aside = VEHICLE.drawbar_length * math.sin(delta_i)
        return aside + math.sqrt(distance_rj1**2 - ahead**2)

    ring = Path((Segment(math.tau * 6.0, 1 / 6, 1 / 6),), laps=1)
    needed = float(posture_on_path(ring, VEHICLE, 0.0).delta_i)
    assert trailer_radius(needed) == pytest.approx(6.0, abs=1e-9)
    assert abs(trailer_radius(needed - 0.05 * VEHICLE.steering_limit_i) - 6.0) < 0.03


def _unit(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
