"""Paths: closed, C2, parametrised by arc length; headlands; projection."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.headland import headland
from ttempc.reference.path import Path, Projection, Segment, figure_eight, straight
from ttempc.reference.reference import check_drivable
from ttempc.vehicle import Vehicle

S_BEND = Path((Segment(3.0, 0.0, 0.1), Segment(4.0, 0.1, -0.1), Segment(2.0, -0.1, 0.0)))
PATHS = [figure_eight(), figure_eight(6.0, 20.0, 3.0, 1), straight(20.0), S_BEND]


@pytest.fixture(params=PATHS, ids=["eight", "tight eight", "straight", "S-bend"])
def path(request):
    return request.param


def along(path, count=4001):
    return np.linspace(-5.0, path.length_m + 5.0, count)


def test_arc_length_is_the_parameter(path):
    s = along(path)
    h = 1e-4
    velocity = (path.pose(s + h) - path.pose(s - h)) / (2 * h)
    assert np.hypot(velocity[:, 0], velocity[:, 1]) == pytest.approx(1.0, abs=1e-8)


def test_heading_is_the_direction_and_curvature_its_derivative(path):
    s = along(path)
    h = 1e-4
    forward, backward = path.pose(s + h), path.pose(s - h)
    velocity = (forward - backward) / (2 * h)
    heading = path.pose(s)[:, 2]
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    np.testing.assert_allclose(velocity[:, :2], direction, atol=1e-8)
    np.testing.assert_allclose(velocity[:, 2], path.curvature(s), atol=1e-5)


def test_curvature_is_continuous_and_its_derivative_is_that_of_differences(path):
    s = along(path)
    h = 1e-5
    change = path.curvature(s + h) - path.curvature(s)
    assert np.max(np.abs(change)) < 0.1 * h + 1e-12  # the sharpest blend changes by 0.067 1/m^2
    smooth = np.abs(path.curvature_derivative(s + h) - path.curvature_derivative(s)) < 1e-12
    slope = (path.curvature(s + h) - path.curvature(s)) / h
    np.testing.assert_allclose(slope[smooth], path.curvature_derivative(s)[smooth], atol=1e-6)
    assert smooth.mean() > 0.99


@pytest.mark.parametrize("blend", [0.5, 2.0, 5.0])
def test_figure_eight_closes_and_keeps_its_circles(blend):
    eight = figure_eight(blend_m=blend)
    np.testing.assert_allclose(eight.pose(eight.lap_m - 1e-9), eight.pose(0.0), atol=2e-9)
    s = np.linspace(0.0, eight.lap_m, 5000)
    arc = np.abs(eight.curvature(s)) > 0.1 - 1e-12
    x, y, _ = eight.pose(s[arc]).T
    np.testing.assert_allclose(np.hypot(np.abs(x) - 15.0, y), 10.0, atol=1e-9)


def test_impossible_patterns_and_jumps_of_curvature_are_refused_with_what_is_wrong():
    for kind, name, value in (
        (figure_eight, "radius_m", math.nan),
        (figure_eight, "centre_distance_m", 20.0),
        (figure_eight, "blend_m", 25.0),
        (figure_eight, "laps", 0),
        (headland, "width_m", 0.0),
        (headland, "passes", 0),
    ):
        with pytest.raises(InvalidPath, match=name):
            kind(**{name: value})
    with pytest.raises(InvalidPath, match=r"s = 3\.00 m"):
        Path((Segment(3.0, 0.0, 0.0), Segment(3.0, 0.1, 0.1)))


WIDTHS = (0.5, 3.0, 9.0, 14.0, 15.0, 16.0, 16.5, 30.0)  # loops, half circles, U's at R = 7 m


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("blend", [1.0, 4.0])
def test_passes_are_parallel_and_lie_a_width_apart(width, blend):
    path = headland(20.0, width, 5, 7.0, blend)
    s = np.linspace(0.0, path.lap_m, 20001)
    x, y, heading = path.pose(s).T
    for index in range(5):
        y_pass = (index - 2) * width
        on_pass = (np.abs(y - y_pass) < 1e-6) & (np.abs(x) < 10.0) & (path.curvature(s) == 0.0)
        assert np.ptp(x[on_pass]) == pytest.approx(20.0, abs=0.1)
        np.testing.assert_allclose(np.cos(heading[on_pass]), (-1.0) ** index, atol=1e-9)
    np.testing.assert_allclose(path.pose(0.0), [-10.0, -2.0 * width, 0.0], atol=1e-12)
    np.testing.assert_allclose(path.pose(path.lap_m)[:2], [10.0, 2.0 * width], atol=1e-9)


@pytest.mark.parametrize("width", WIDTHS)
def test_turns_respect_radius_and_blend_and_are_drivable(width):
    path = headland(20.0, width, 3, 7.0, 2.0)
    s = np.linspace(0.0, path.lap_m, 20001)
    assert np.abs(path.curvature(s)).max() <= 1.0 / 7.0 + 1e-12
    assert np.abs(path.curvature_derivative(s)).max() <= 1.0 / 14.0 + 1e-9
    check_drivable(path, Vehicle())


STEP_M = 0.05


def polyline(path):
    return path.pose(np.arange(0.0, path.length_m, STEP_M))[:, :2]


def test_crossing_is_passed_on_the_own_branch():
    """Both branches meet in one point; the places keep growing with the way driven."""
    path = figure_eight(laps=1)
    projection = Projection(polyline(path))
    places = [projection.place(*path.pose(s)[:2]) for s in np.arange(0.0, 130.0, 0.2)]
    assert np.all(np.diff(places) > 0.0)


def test_ends_are_not_passed_and_fresh_starts_anew():
    projection = Projection(polyline(straight(2.0)))
    assert projection.place(-1.0, 0.3) == 0.0
    last = projection.place(9.0, 0.0)
    assert last == len(polyline(straight(2.0))) - 1
