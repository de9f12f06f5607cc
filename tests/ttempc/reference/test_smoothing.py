"""Smoothing of polygons of points to C2 paths."""

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import Comfortable
from ttempc.reference.smoothing import smooth, thinned
from ttempc.vehicle import Vehicle

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


def test_a_long_line_is_sampled_as_densely_at_its_end_as_at_its_beginning():
    straight = np.column_stack([np.arange(0.0, 151.0, 30.0), np.zeros(6)])
    lengths = [segment.length_m for segment in smooth(straight, 0.05).path.segments]
    np.testing.assert_allclose(lengths, 150.0 / len(lengths), rtol=1e-6)


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


suits = Comfortable(Vehicle(), 1.0)


def sine(step=1.0):
    """Return points on a sine of 0.5 m with a smallest radius of 72 m."""
    x = np.arange(0.0, 76.0, step)
    return np.column_stack([x, 0.5 * np.sin(2.0 * math.pi * x / 37.7)])


def test_a_line_that_can_be_driven_is_not_bent():
    """The smoothest path within the default of 10 cm was 6.1 cm (rms) beside these points."""
    points = sine()
    result = smooth(points, 0.1, suits)
    beside = result.path.pose(result.distance_m)[:, :2] - points
    assert np.sqrt(np.mean(np.sum(beside**2, axis=1))) < 0.005
    assert suits(result.path)


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_smoothed_as_far_as_the_steering_needs_it(seed):
    line = sine(0.2)
    points = line + 0.02 * np.random.default_rng(seed).standard_normal(line.shape)
    result = smooth(points[thinned(points)], 0.2, suits)
    assert suits(result.path)
    places = result.path.pose(np.linspace(0.0, result.path.lap_m, 2001))[:, :2]
    beside = distance_to_line(places, sine(0.05))
    assert np.sqrt(np.mean(beside**2)) < 0.02  # less than that of the points


def test_where_no_path_suits_the_smoothest_is_returned():
    corner = LINES["corner"][0]
    never = smooth(corner, 0.1, lambda path: False)
    assert never.deviation_m == smooth(corner, 0.1).deviation_m


def test_points_are_read_by_their_values_not_by_their_memory():
    """Whole numbers, single precision and arrays by columns describe the same line."""
    points = np.array([[0, 0], [20, 0], [40, 8]])
    path = smooth(points.astype(float), 0.3)
    for same in (points, points.astype(np.float32), np.asfortranarray(points, dtype=float)):
        np.testing.assert_array_equal(smooth(same, 0.3).distance_m, path.distance_m)


def test_a_path_is_kept_for_the_same_points_and_vehicle_alone():
    """A caller may go on with its points; it may not change what others get."""
    points = sine()
    kept = smooth(points, 0.1, suits)
    assert smooth(points.copy(), 0.1, Comfortable(Vehicle(), 1.0)) is kept
    assert smooth(points, 0.1, Comfortable(Vehicle(), 1.5)) is not kept
    assert smooth(points, 0.11, suits) is not kept
    with pytest.raises(ValueError, match="read-only"):
        kept.distance_m += 1.0
    points[0, 1] += 0.01
    assert smooth(points, 0.1, suits) is not kept


def test_repeated_points_and_a_standing_vehicle_are_thinned():
    line = sine()
    standing = line[30] + 0.01 * np.random.default_rng(1).standard_normal((300, 2))
    for points in (np.repeat(line, 3, axis=0), np.concatenate([line[:31], standing, line[31:]])):
        kept = points[thinned(points)]
        assert len(kept) == len(line)
        assert np.abs(kept - line).max() < 0.05
    assert thinned(line).tolist() == list(range(len(line)))


def test_noise_above_the_distance_of_points_is_thinned_until_the_line_goes_forward():
    x = np.arange(0.0, 40.0, 0.05)
    noise = 0.02 * np.random.default_rng(2).standard_normal((len(x), 2))
    points = np.column_stack([x, np.zeros_like(x)]) + noise
    kept = thinned(points)
    assert len(kept) < len(points)
    assert np.all(np.diff(points[kept][:, 0]) > 0.0)


def test_a_cusp_is_refused_with_its_place_and_the_cure():
    there = np.column_stack([np.arange(0.0, 15.0, 0.2), np.zeros(75)])
    back = there[::-1] + np.column_stack([np.zeros(75), 0.002 * np.arange(75.0) ** 2])
    with pytest.raises(InvalidPath, match=r"x = 14\.\d+, y = 0\.\d+ m.*path\.reverse = true"):
        thinned(np.concatenate([there, back]))
