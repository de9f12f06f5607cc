"""The laws of convex sets, against linear programmes, samples and hulls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from ttempc.errors import EmptySet
from ttempc.tube.sets import (
    Box,
    Polytope,
    SupportSet,
    Zonotope,
    directions_in,
    excess,
    linear_map,
    minkowski_sum,
    outline,
)

RNG = np.random.default_rng(3)


@pytest.fixture(autouse=True)
def _same_draws_in_any_order():
    RNG.bit_generator.state = np.random.default_rng(3).bit_generator.state


def random_zonotope(n, g):
    return Zonotope(RNG.standard_normal(n), RNG.standard_normal((n, g)))


def random_box(n):
    lower = RNG.standard_normal(n)
    return Box(lower, lower + RNG.uniform(0.1, 2.0, n))


def samples(zonotope, count):
    """Points inside, half of them extreme."""
    g = zonotope.generators.shape[1]
    e = RNG.uniform(-1.0, 1.0, (count, g))
    e[::2] = np.sign(e[::2])
    return zonotope.centre + e @ zonotope.generators.T


def test_support_of_a_zonotope_is_that_of_a_linear_programme():
    for n, g in ((2, 3), (4, 9), (7, 20)):
        z = random_zonotope(n, g)
        for a in RNG.standard_normal((10, n)):
            answer = linprog(-(a @ z.generators), bounds=[(-1, 1)] * g)
            assert z.support(a[None])[0] == pytest.approx(a @ z.centre - answer.fun, abs=1e-9)


def test_support_of_a_box_and_of_its_faces_agree():
    box = random_box(3)
    faces = Polytope(np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([box.upper, -box.lower]))
    a = RNG.standard_normal((20, 3))
    np.testing.assert_allclose(faces.support(a), box.support(a), atol=1e-9)
    unbounded = Polytope(np.array([[1.0, 0.0]]), np.array([1.0]))
    assert unbounded.support(np.array([[1.0, 0.0], [0.0, 1.0]])).tolist() == [1.0, math.inf]


def test_sums_and_maps_hold_what_samples_add_up_to_and_reach_it():
    first, second, matrix = random_zonotope(4, 5), random_zonotope(4, 3), RNG.normal(size=(3, 4))
    total = linear_map(matrix, minkowski_sum([first, second]))
    e = np.array(np.meshgrid(*[[-1.0, 1.0]] * 8)).reshape(8, -1)  # every corner
    generators = np.hstack([first.generators, second.generators])
    points = (first.centre + second.centre)[:, None] + generators @ e
    a = directions_in(3, 50, RNG)
    np.testing.assert_allclose(total.support(a), (a @ matrix @ points).max(axis=1), atol=1e-12)


def test_support_is_subadditive_homogeneous_and_turns_with_the_set():
    z = random_zonotope(3, 6)
    a, b = RNG.standard_normal((2, 30, 3))
    assert np.all(z.support(a + b) <= z.support(a) + z.support(b) + 1e-12)
    np.testing.assert_allclose(z.support(2.5 * a), 2.5 * z.support(a))
    turn = np.linalg.qr(RNG.standard_normal((3, 3)))[0]
    np.testing.assert_allclose(linear_map(turn, z).support(a @ turn.T), z.support(a))


@pytest.mark.parametrize("outer", ["box", "polytope"])
def test_the_pontryagin_difference_is_the_largest_set_that_fits(outer):
    inner = Zonotope(0.1 * RNG.standard_normal(3), 0.05 * RNG.standard_normal((3, 5)))
    box = Box(-np.ones(3), np.array([1.0, 2.0, 3.0]))
    normals = np.vstack([np.eye(3), -np.eye(3), RNG.standard_normal((4, 3))])
    whole = box if outer == "box" else Polytope(normals, np.full(10, 1.5))
    rest = whole.erode(inner)
    if isinstance(rest, Box):
        faces = Polytope(
            np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([rest.upper, -rest.lower])
        )
    else:
        faces = rest
    whole_points = RNG.uniform(-2.0, 3.0, (4000, 3))
    kept = whole_points[rest.contains(whole_points)]
    assert len(kept) > 100
    for point in samples(inner, 200):
        assert whole.contains(kept + point, slack=1e-12).all()
    # Just outside a face of the difference, some point of the inner set leads out of the whole.
    for a in faces.normals:
        answer = linprog(-a, faces.normals, faces.offsets, bounds=[(None, None)] * 3)
        e = np.sign(a @ inner.generators)
        if a @ answer.x < faces.offsets[(faces.normals == a).all(axis=1)][0] - 1e-9:
            continue  # a face that does not touch
        beyond = answer.x + 1e-6 * a + inner.centre + inner.generators @ e
        assert not whole.contains(beyond[None])[0]


def test_an_empty_difference_says_where_and_by_how_much():
    wide = Zonotope(np.zeros(2), np.diag([0.2, 0.9]))
    with pytest.raises(EmptySet, match=r"along \(0, 1\) 0.8 are missing") as caught:
        Box(np.array([-1.0, -0.5]), np.array([1.0, 0.5])).erode(wide)
    assert caught.value.direction == (0.0, 1.0)
    assert caught.value.gap == pytest.approx(0.8)
    normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    with pytest.raises(EmptySet) as caught:
        Polytope(normals, np.array([1.0, 1.0, 0.5, 0.5])).erode(wide)
    assert abs(caught.value.direction[1]) == 1.0
    assert caught.value.gap == pytest.approx(0.4)  # each of the two faces has to give way by this


def test_gauge_is_one_on_the_boundary_and_grows_with_the_distance():
    z = random_zonotope(3, 7)
    a = np.array([0.3, -0.5, 0.8])
    corner = z.centre + z.generators @ np.sign(a @ z.generators)
    assert z.gauge(corner) == pytest.approx(1.0, abs=1e-8)
    assert z.gauge(z.centre + 2.0 * (corner - z.centre)) == pytest.approx(2.0, abs=1e-8)
    assert z.gauge(z.centre) == pytest.approx(0.0, abs=1e-9)
    assert all(z.gauge(point) <= 1.0 + 1e-8 for point in samples(z, 20))
    assert Zonotope(np.zeros(2), np.array([[1.0], [0.0]])).gauge(np.array([0.0, 1.0])) == math.inf


def test_excess_finds_what_sticks_out():
    small, large = Zonotope(np.zeros(3), 0.5 * np.eye(3)), Box(-np.ones(3), np.ones(3))
    directions = directions_in(3, 200, RNG)
    assert excess(small, large, directions) == pytest.approx(-0.5)
    assert excess(large, small, directions) > 0.49


def test_outline_holds_the_projection_and_little_more():
    z, plane = random_zonotope(5, 8), RNG.standard_normal((2, 5))
    e = np.array(np.meshgrid(*[[-1.0, 1.0]] * 8)).reshape(8, -1)
    hull = ConvexHull((plane @ (z.centre[:, None] + z.generators @ e)).T)
    for count, share in ((24, 1.03), (360, 1.002)):
        polygon = ConvexHull(outline(z, plane, count))
        inside = polygon.equations[:, :2] @ hull.points.T + polygon.equations[:, 2:]
        assert inside.max() < 1e-9
        assert hull.volume <= polygon.volume <= share * hull.volume


def test_a_ball_is_a_set_like_any_other():
    ball = SupportSet(2, lambda a: np.linalg.norm(a, axis=1))
    box = Box(-3.0 * np.ones(2), 3.0 * np.ones(2))
    assert box.erode(ball).upper.tolist() == [2.0, 2.0]
    corners = outline(ball, np.eye(2), 720)
    np.testing.assert_allclose(np.hypot(*corners.T), 1.0, atol=1e-4)
