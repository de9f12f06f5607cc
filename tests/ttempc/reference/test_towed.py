"""Towed trailers: without steering, or with too little of it for their line."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from ttempc.errors import InvalidPath
from ttempc.models.kinematics import trailer_point
from ttempc.reference.headland import headland
from ttempc.reference.leading import check_plain, leading_path
from ttempc.reference.path import Path, Segment, figure_eight
from ttempc.reference.reference import Comfortable, ConstantSpeed, Reference, check_drivable
from ttempc.reference.towed import distance_off_line, tow
from ttempc.types import State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
PLAIN = replace(VEHICLE, steering_limit_i=0.0)
ON_AXLE = replace(PLAIN, hitch_offset=0.0)
EIGHT_OF_8_M = figure_eight(radius_m=8.0, centre_distance_m=24.0, laps=1)
U_TURN = headland(length_m=15.0, width_m=10.0, passes=2, radius_m=5.0)


def on_circle(radius_m):
    """Return a path that ends on a circle, long enough to be steady there."""
    kappa = 1.0 / radius_m
    return Path((Segment(2.0, 0.0, kappa), Segment(60.0, kappa, kappa)))


@pytest.mark.parametrize("hitch", [-0.3, 0.0, 0.3, 1.2], ids=["before", "at", "behind", "far"])
@pytest.mark.parametrize("drawbar", [0.2, 2.0])
def test_a_plain_trailer_on_a_circle_has_the_radius_of_geometry(hitch, drawbar):
    """The hitch runs on the radius sqrt(R^2 + a^2), the axle on that less the trailer's length."""
    radius, vehicle = 10.0, replace(PLAIN, hitch_offset=hitch, drawbar_length=drawbar)
    path = on_circle(radius)
    sample = Reference(path, vehicle, ConstantSpeed(1.0)).at(path.length_m)
    x, y, heading = path.pose(path.length_m)
    centre = np.array([x - radius * math.sin(heading), y + radius * math.cos(heading)])
    length = drawbar + vehicle.trailer_length
    expected = math.sqrt(radius**2 + hitch**2 - length**2)
    assert np.hypot(*(sample.trailer_xy - centre)) == pytest.approx(expected, abs=1e-6)
    assert sample.state[State.DELTA_I] == 0.0


@pytest.mark.parametrize(
    ("path", "vehicle"),
    [
        (EIGHT_OF_8_M, PLAIN),
        (
            figure_eight(radius_m=8.0, centre_distance_m=24.0, laps=1),
            replace(PLAIN, hitch_offset=0.0),
        ),
        (U_TURN, VEHICLE),
    ],
    ids=["plain", "hitch on the axle", "steering at its stop"],
)
def test_inputs_keep_the_exact_model_on_the_reference_of_a_towed_trailer(path, vehicle):
    reference, step_s = Reference(path, vehicle, ConstantSpeed(1.0)), 0.02
    state = reference.at(0.0).state
    middle = (np.arange(int(reference.duration_s / step_s)) + 0.5) * step_s
    for k, u in enumerate(reference.at(middle).inputs):
        state = advance(state, u, vehicle, step_s)
        if k % 100 == 0:
            expected = reference.at((k + 1) * step_s)
            np.testing.assert_allclose(state, expected.state, atol=1e-2)
            np.testing.assert_allclose(
                trailer_point(state, vehicle), expected.trailer_xy, atol=1e-2
            )


def test_the_trailer_point_moves_along_the_trailer():
    """Without side slip; its speed and yaw rate are the derivatives."""
    reference = Reference(figure_eight(radius_m=8.0, laps=1), PLAIN, ConstantSpeed(1.0))
    t, h = np.linspace(1.0, 130.0, 997), 1e-4
    before, after, now = reference.at(t - h), reference.at(t + h), reference.at(t)
    velocity = (after.trailer_xy - before.trailer_xy) / (2 * h)
    yaw = now.state[:, State.PSI_I]
    along = velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw)
    across = velocity[:, 1] * np.cos(yaw) - velocity[:, 0] * np.sin(yaw)
    np.testing.assert_allclose(along, now.speed_i, atol=1e-6)
    np.testing.assert_allclose(across, 0.0, atol=1e-3)  # the curvature has kinks
    turning = (after.state - before.state)[:, State.PSI_I] / (2 * h)
    np.testing.assert_allclose(turning, now.yaw_rate_i, atol=1e-5)


def test_a_lap_ends_as_it_began():
    path = figure_eight(radius_m=8.0)
    reference = Reference(path, PLAIN, ConstantSpeed(1.0))
    first, second = reference.at(3.0), reference.at(3.0 + path.lap_m)
    np.testing.assert_allclose(first.trailer_xy, second.trailer_xy, atol=1e-8)
    np.testing.assert_allclose(first.hitch_angle, second.hitch_angle, atol=1e-9)


def test_only_a_trailer_that_cannot_follow_leaves_its_line():
    """On R = 5 m the trailer of the paper would need 31.6 deg, its stop is at 25 deg."""
    assert tow(figure_eight(), VEHICLE) is None
    assert distance_off_line(figure_eight(), VEHICLE) == 0.0
    steered, plain = distance_off_line(U_TURN, VEHICLE), distance_off_line(U_TURN, PLAIN)
    assert 0.02 < steered < plain
    # A plain trailer runs inside by R - sqrt(R^2 + a^2 - L^2) on the circle, at most.
    assert plain <= 5.0 - math.sqrt(25.0 + 0.3**2 - 2.1**2) + 1e-3


def test_a_trailer_that_would_fold_is_refused_with_its_place():
    long = replace(PLAIN, trailer_length=8.0)
    check_drivable(figure_eight(radius_m=12.0, centre_distance_m=36.0), long)
    with pytest.raises(InvalidPath, match=r"s = .* m .*fold by \d+ deg"):
        check_drivable(figure_eight(radius_m=6.0), long)


@pytest.mark.parametrize("hitch", [-0.3, 0.0, 0.3, 0.9], ids=["before", "at", "behind", "far"])
@pytest.mark.parametrize(("tool", "turning"), [(0.0, 0.0), (0.8, 0.3)], ids=["axle", "tool"])
def test_a_leading_tractor_keeps_the_working_point_on_the_line(hitch, tool, turning):
    """A lane change of 2 m; the tractor's own path is beside it."""
    line = Path(
        (
            Segment(12.0, 0.0, 0.0),
            Segment(4.0, 0.0, 0.08),
            Segment(8.0, 0.08, -0.08),
            Segment(4.0, -0.08, 0.0),
            Segment(15.0, 0.0, 0.0),
        )
    )
    vehicle = replace(PLAIN, hitch_offset=hitch, tool_behind=tool, trailer_turning_offset=turning)
    path = leading_path(line, vehicle, 0.05, Comfortable(vehicle, 1.0))
    reference = Reference(path, vehicle, ConstantSpeed(1.0))
    sample = reference.at(np.linspace(3.0, reference.duration_s - 1.0, 400))
    yaw = sample.state[:, State.PSI_I]
    point = sample.trailer_xy - tool * np.column_stack([np.cos(yaw), np.sin(yaw)])
    dense = line.pose(np.arange(-4.0, line.length_m + 4.0, 0.005))[:, :2]

    def beside(places):
        return max(np.hypot(*(dense - place).T).min() for place in places)

    assert beside(point) < 0.01
    assert beside(sample.state[:, :2]) > 0.05


def test_a_trailer_with_steering_leads_itself():
    with pytest.raises(InvalidPath, match="steers up to 25 deg"):
        check_plain(VEHICLE)
