"""Laws of support functions, against samples, hulls and linear programmes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.distance import pdist

from tests.reference.ttempc.zonotope import Zonotope
from ttempc.tube.sets import SupportSet, directions_in, linear_map, minkowski_sum, outline


@pytest.fixture
def generator():
    return np.random.default_rng(3)


def random_zonotope(generator, n, g):
    return Zonotope(generator.standard_normal(n), generator.standard_normal((n, g)))


def test_support_of_the_reference_is_that_of_a_linear_programme(generator):
    for n, g in ((2, 3), (4, 9), (7, 20)):
        z = random_zonotope(generator, n, g)
        for a in generator.standard_normal((10, n)):
            minimum = linprog(-(a @ z.generators), bounds=[(-1, 1)] * g).fun
            assert z.support(a[None])[0] == pytest.approx(a @ z.centre - minimum, abs=1e-9)


def test_gauge_of_the_reference_is_one_on_the_boundary_and_grows_with_the_distance(generator):
    z = random_zonotope(generator, 3, 7)
    a = np.array([0.3, -0.5, 0.8])
    corner = z.centre + z.generators @ np.sign(a @ z.generators)
    assert z.gauge(corner) == pytest.approx(1.0, abs=1e-8)
    assert z.gauge(z.centre + 2.0 * (corner - z.centre)) == pytest.approx(2.0, abs=1e-8)
    assert z.gauge(z.centre) == pytest.approx(0.0, abs=1e-9)
    assert Zonotope(np.zeros(2), np.array([[1.0], [0.0]])).gauge(np.array([0.0, 1.0])) == math.inf


def test_sums_and_maps_hold_what_samples_add_up_to_and_reach_it(generator):
    first, second = random_zonotope(generator, 4, 5), random_zonotope(generator, 4, 3)
    matrix = generator.normal(size=(3, 4))
    total = linear_map(matrix, minkowski_sum([first, second]))
    points = (first.vertices()[:, None] + second.vertices()).reshape(-1, 4)
    a = directions_in(3, 50, generator)
    np.testing.assert_allclose(total.support(a), (a @ matrix @ points.T).max(axis=1), atol=1e-12)


def test_support_is_subadditive_homogeneous_and_turns_with_the_set(generator):
    total = minkowski_sum([random_zonotope(generator, 3, 6), random_zonotope(generator, 3, 2)])
    a, b = generator.standard_normal((2, 30, 3))
    assert np.all(total.support(a + b) <= total.support(a) + total.support(b) + 1e-12)
    np.testing.assert_allclose(total.support(2.5 * a), 2.5 * total.support(a))
    turn = np.linalg.qr(generator.standard_normal((3, 3)))[0]
    np.testing.assert_allclose(linear_map(turn, total).support(a @ turn.T), total.support(a))


def test_directions_are_unit_vectors_with_the_axes_first(generator):
    directions = directions_in(3, 100, generator)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    np.testing.assert_array_equal(directions[:6], np.vstack([np.eye(3), -np.eye(3)]))
    assert directions_in(3, 4, generator).shape == (4, 3)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("stretch", [1.0, 100.0])
def test_outline_contains_the_projection_and_approaches_it(seed, stretch):
    """By the diameter D: a tangent's end is at most D / 2 tan(pi / count) away, for any shape."""
    generator = np.random.default_rng(seed)
    z = random_zonotope(generator, 5, 8)
    plane = generator.standard_normal((2, 5)) * [[stretch], [1.0]]
    points = z.vertices() @ plane.T
    diameter = pdist(points).max()
    normals = directions_in(2, 2000, generator)
    reach = (normals @ points.T).max(axis=1)
    for count in (8, 24, 90, 360):
        beyond = (normals @ outline(z, plane, count).T).max(axis=1) - reach
        assert beyond.min() >= -1e-9 * diameter
        assert beyond.max() <= 0.5 * diameter * math.tan(math.pi / count)


def test_outline_of_a_disc_is_the_regular_polygon_around_it():
    disc = SupportSet(2, lambda a: np.linalg.norm(a, axis=1))
    for count in (6, 720):
        corners = outline(disc, np.eye(2), count)
        np.testing.assert_allclose(np.hypot(*corners.T), 1.0 / math.cos(math.pi / count))
