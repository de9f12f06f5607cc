"""Smoothing of polygons of points to C2 paths."""

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.path import figure_eight
from ttempc.reference.smoothing import smooth

EIGHT = figure_eight(laps=1)


def eight(step, noise=0.0):
    points = EIGHT.pose(np.arange(0.0, EIGHT.lap_m, step))[:, :2]
    return points + noise * np.random.default_rng(4).standard_normal(points.shape)


def arc_between_lines():
    angle = np.linspace(0.0, 3.14, 50)
    return np.concatenate(
        [
            [(x, 0.0) for x in np.arange(0.0, 20.0, 2.0)],
            np.column_stack([20.0 + 8.0 * np.sin(angle), 8.0 - 8.0 * np.cos(angle)]),
            [(x, 16.0) for x in np.arange(18.0, 0.0, -2.0)],
        ]
    )


LINES = {
    "dense": (eight(0.1), 0.05),
    "coarse": (eight(1.0), 0.05),
    "noisy": (eight(0.5, noise=0.03), 0.15),
    "corner": (np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0]]), 3.0),
    "two points": (np.array([[1.0, 2.0], [4.0, 6.0]]), 0.05),
    "arc between lines": (arc_between_lines(), 0.05),
}


@pytest.fixture(params=LINES, scope="module")
def smoothed(request):
    points, allowed = LINES[request.param]
    return points, allowed, smooth(points, allowed)


def distance_to_line(places, points):
    """Return the distance of each place from the polygon through the points."""
    first, step = points[:-1], np.diff(points, axis=0)
    away = places[:, None] - first
    share = np.clip(np.sum(away * step, -1) / np.sum(step**2, -1), 0.0, 1.0)
    return np.hypot(*np.moveaxis(away - share[..., None] * step, -1, 0)).min(axis=1)


def test_path_and_polygon_are_as_close_as_stated(smoothed):
    points, allowed, result = smoothed
    assert result.deviation_m <= allowed
    path = result.path
    places = path.pose(np.linspace(0.0, path.lap_m, 3001))[:, :2]
    assert distance_to_line(places, points).max() <= result.deviation_m + 1e-3
    assert distance_to_line(points, places).max() <= result.deviation_m + 1e-3


def test_path_begins_and_ends_where_the_points_do_and_passes_each(smoothed):
    points, _, result = smoothed
    path = result.path
    ends = path.pose(np.array([0.0, path.lap_m]))[:, :2]
    np.testing.assert_allclose(ends, points[[0, -1]], atol=2e-3)
    beside = path.pose(result.distance_m)[:, :2]
    assert np.hypot(*(beside - points).T).max() <= result.deviation_m + 1e-6
    assert np.all(np.diff(result.distance_m) > 0.0)


def test_arc_length_is_the_parameter_and_curvature_the_second_derivative(smoothed):
    path = smoothed[2].path
    s = np.linspace(-2.0, path.lap_m + 2.0, 2001)
    h = 1e-4
    before, now, after = path.pose(s - h), path.pose(s), path.pose(s + h)
    velocity = (after - before)[:, :2] / (2 * h)
    np.testing.assert_allclose(np.hypot(*velocity.T), 1.0, atol=1e-8)
    direction = np.column_stack([np.cos(now[:, 2]), np.sin(now[:, 2])])
    np.testing.assert_allclose(velocity, direction, atol=1e-6)
    np.testing.assert_allclose((after - before)[:, 2] / (2 * h), path.curvature(s), atol=1e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0.0, 0.0]], "1 points, must be two or more"),
        (np.empty((0, 2)), "0 points"),
        ([[0.0, 0.0], [1.0, math.nan], [2.0, 0.0]], r"point 1 is \(1.0, nan\)"),
        ([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0]], r"point 2 at x = 3.00, y = 4.00 m, 5.00 m along"),
        ([[0.0, 0.0], [9.0, 0.0], [0.0, 0.0]], r"turns back on itself near point \d at x ="),
    ],
)
def test_invalid_points_are_refused_with_their_place(points, message):
    with pytest.raises(InvalidPath, match=message):
        smooth(np.array(points), 0.05)
