"""Paths: closed, C2 and parametrised by arc length; refusal of invalid ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.path import Path, Segment, figure_eight, straight

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


def test_quadrature_agrees_with_a_fine_sum():
    s = np.linspace(0.0, S_BEND.length_m, 200_001)
    heading = np.concatenate([[0.0], np.cumsum(_trapezia(S_BEND.curvature(s), s))])
    x = np.sum(_trapezia(np.cos(heading), s))
    y = np.sum(_trapezia(np.sin(heading), s))
    np.testing.assert_allclose(S_BEND.pose(S_BEND.length_m), [x, y, heading[-1]], atol=1e-9)


def _trapezia(values, s):
    return 0.5 * (values[1:] + values[:-1]) * np.diff(s)


def test_figure_eight_has_the_lap_of_the_scenarios():
    eight = figure_eight()
    assert eight.lap_m == pytest.approx(136.7, abs=0.2)
    assert eight.length_m == 2 * eight.lap_m
    along = np.linspace(0.0, eight.lap_m, 2000)
    assert np.max(np.abs(eight.curvature(along))) == pytest.approx(1.0 / 10.0)


@pytest.mark.parametrize("blend", [0.5, 2.0, 5.0])
def test_figure_eight_closes_and_keeps_its_circles(blend):
    eight = figure_eight(blend_m=blend)
    np.testing.assert_allclose(eight.pose(eight.lap_m - 1e-9), eight.pose(0.0), atol=2e-9)
    s = np.linspace(0.0, eight.lap_m, 5000)
    arc = np.abs(eight.curvature(s)) > 0.1 - 1e-12
    x, y, _ = eight.pose(s[arc]).T
    np.testing.assert_allclose(np.hypot(np.abs(x) - 15.0, y), 10.0, atol=1e-9)


def test_figure_eight_starts_straight_at_the_crossing():
    eight = figure_eight()
    np.testing.assert_allclose(eight.pose(0.0)[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(eight.pose(0.5 * eight.lap_m)[:2], 0.0, atol=1e-9)
    assert np.all(eight.curvature(np.linspace(-10.0, 10.0, 100)) == 0.0)


def test_closed_path_repeats_indefinitely():
    ring = Path((Segment(math.tau * 5.0, 0.2, 0.2),), laps=2)
    s = np.array([-7.0, 0.3, 31.0])
    turned = ring.pose(s + 3 * ring.lap_m) - ring.pose(s)
    np.testing.assert_allclose(turned, np.tile([0.0, 0.0, 3 * math.tau], (3, 1)), atol=1e-9)


def test_extent_holds_the_path():
    box = figure_eight().extent()
    assert box == pytest.approx((-25.0, 25.0, -10.0, 10.0), abs=1e-4)


def test_shapes_are_those_of_the_arc_lengths(path):
    assert path.pose(1.0).shape == (3,)
    assert path.pose(np.ones((2, 4))).shape == (2, 4, 3)
    assert path.curvature(1.0).shape == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"radius_m": -1.0}, "radius_m"),
        ({"radius_m": math.nan}, "radius_m"),
        ({"centre_distance_m": 20.0}, "centre_distance_m"),
        ({"blend_m": 0.0}, "blend_m"),
        ({"blend_m": 25.0}, "blend_m"),
        ({"laps": 0}, "laps"),
    ],
)
def test_impossible_figure_eights_are_refused(arguments, message):
    with pytest.raises(InvalidPath, match=message):
        figure_eight(**arguments)


def test_jump_of_curvature_is_refused_with_its_place():
    with pytest.raises(InvalidPath, match=r"s = 3\.00 m"):
        Path((Segment(3.0, 0.0, 0.0), Segment(3.0, 0.1, 0.1)))


@pytest.mark.parametrize("length", [0.0, -1.0, math.inf])
def test_segment_without_length_is_refused(length):
    with pytest.raises(InvalidPath, match="length"):
        straight(length)


def test_open_path_cannot_be_driven_in_laps():
    with pytest.raises(InvalidPath, match="closed"):
        Path((Segment(3.0, 0.0, 0.0),), laps=2)
