"""Sets of the double integrator of Mayne et al. (2005), against the polytope library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from ttempc.errors import InvalidTube
from ttempc.tube import (
    DisturbanceSet,
    Polytope,
    SupportSet,
    TrackingSystem,
    admissible_subset,
    feedback_gains,
    invariant_tube,
    linear_map,
    outline,
    tightened_offsets,
)
from ttempc.tube.sets import directions_in

with np.printoptions():  # the library changes those of the process
    import polytope

A, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
GAIN = feedback_gains(A[None], B[None], np.eye(2), np.array([0.01]))
CLOSED = A + B @ GAIN[0]
TUBE = invariant_tube(
    TrackingSystem.along(A[None], B[None], GAIN), DisturbanceSet(0.1 * np.eye(2), shape="box"), 1e-3
)
CONSTRAINTS = Polytope.box([-np.inf, -np.inf, -1.0], [np.inf, 2.0, 1.0])
CORNERS_OF_W = 0.1 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])


def library(of: Polytope) -> polytope.Polytope:
    return polytope.Polytope(of.normals, of.offsets)


def hull(points):
    """Return the convex hull of points as a polytope of the library."""
    equations = ConvexHull(points).equations
    return polytope.Polytope(equations[:, :-1], -equations[:, -1])


def vertices_of_tube():
    """Return vertices of (1 - alpha)^-1 sum A_K^i W, by sums of vertices and qhull alone."""
    points = np.zeros((1, 2))
    for i in range(TUBE.certificate.terms):
        step = CORNERS_OF_W @ np.linalg.matrix_power(CLOSED, i).T
        points = (points[:, None] + step).reshape(-1, 2)
        points = points[ConvexHull(points).vertices]
    return points / (1.0 - TUBE.certificate.alpha)


def same(first, second):
    """Return whether two polytopes contain each other, to the library's tolerance."""
    return polytope.is_subset(first, second, 1e-6) and polytope.is_subset(second, first, 1e-6)


def test_the_tube_is_the_sum_of_the_vertices():
    directions = directions_in(2, 200, np.random.default_rng(1))
    exact = (vertices_of_tube() @ directions.T).max(axis=0)
    np.testing.assert_allclose(TUBE.at(0).support(directions), exact, rtol=1e-12)
    generators = TUBE.generators(0)
    np.testing.assert_allclose(np.abs(directions @ generators).sum(axis=1), exact, rtol=1e-12)
    np.testing.assert_allclose(TUBE.inputs[0], np.abs(GAIN[0] @ generators).sum(axis=1))


def test_every_successor_of_a_vertex_under_every_corner_of_w_is_inside():
    inside = hull(vertices_of_tube())
    successors = (vertices_of_tube() @ CLOSED.T)[:, None] + CORNERS_OF_W
    assert inside.contains(successors.reshape(-1, 2).T, 1e-9).all()
    assert polytope.is_subset(hull(successors.reshape(-1, 2)), inside)
    # A set smaller than the minimal one is not invariant, so that the check can fail.
    shrunk = 0.99 * vertices_of_tube()
    outside = ((shrunk @ CLOSED.T)[:, None] + CORNERS_OF_W).reshape(-1, 2)
    assert not hull(shrunk).contains(outside.T, 1e-9).all()


def test_the_difference_is_the_intersection_of_all_shifted_constraints():
    both = np.vstack([np.eye(2), GAIN[0]])
    bounded = Polytope.box([-8.0, -3.0, -1.0], [8.0, 2.0, 1.0])
    difference = bounded.difference(linear_map(both, TUBE.at(0)))
    shifted = library(bounded)
    for vertex in vertices_of_tube() @ both.T:
        shifted = shifted.intersect(
            polytope.Polytope(bounded.normals, bounded.offsets - bounded.normals @ vertex)
        )
    assert same(library(difference), shifted)
    np.testing.assert_allclose(tightened_offsets(bounded, TUBE)[0], difference.offsets)


def test_the_terminal_set_is_the_limit_of_the_preimages():
    left = CONSTRAINTS.difference(linear_map(np.vstack([np.eye(2), GAIN[0]]), TUBE.at(0)))
    normals = left.normals @ np.vstack([np.eye(2), GAIN[0]])
    terminal = library(admissible_subset(CLOSED, Polytope(normals, left.offsets)))
    states = admissible = polytope.Polytope(normals, left.offsets)
    for _ in range(20):  # all preimages of the constraints, redundant ones included
        admissible = states.intersect(polytope.Polytope(admissible.A @ CLOSED, admissible.b))
    assert same(terminal, admissible)
    corners = polytope.extreme(terminal)
    assert terminal.contains((corners @ CLOSED.T).T, 1e-9).all()


def test_support_of_half_spaces_is_that_of_the_vertices():
    generator = np.random.default_rng(2)
    normals = generator.normal(size=(12, 2))
    some = Polytope(normals, np.ones(12))
    corners = polytope.extreme(library(some))
    directions = directions_in(2, 60, generator)
    np.testing.assert_allclose(some.support(directions), (corners @ directions.T).max(axis=0))
    assert some.contains(0.999 * corners).all()
    assert not some.contains(1.001 * corners).any()
    around = outline(some, np.eye(2), 90)
    assert polytope.is_subset(library(some), hull(around))
    half_space = Polytope.box([-np.inf, -np.inf], [np.inf, 2.0])
    np.testing.assert_array_equal(
        half_space.support(np.array([[0.0, 3.0], [0.0, -1.0]])), [6, np.inf]
    )


def test_an_empty_difference_is_refused_with_both_bounds():
    wide = SupportSet(1, lambda a: 3.0 * np.abs(a[:, 0]))
    with pytest.raises(InvalidTube, match=r"empty: .* row 0: 3 of 2, row 1: 3 of 2"):
        Polytope.box([-2.0], [2.0]).difference(wide)
    exactly = Polytope.box([-3.0], [3.0]).difference(wide)
    np.testing.assert_array_equal(exactly.offsets, [0.0, 0.0])


def test_the_tick_without_a_point_is_named():
    system = TrackingSystem.along(np.full((4, 1, 1), 0.5), np.ones((4, 1, 1)), np.zeros((4, 1, 1)))
    tube = invariant_tube(system, DisturbanceSet(np.eye(1), shape="box"), 1e-6)
    box = Polytope.box([-5.0, -1.0], [5.0, 1.0])
    offsets = np.tile(box.offsets, (4, 1))
    offsets[:, [0, 2]] -= [[0.0], [2.0], [4.0], [4.5]]
    with pytest.raises(InvalidTube, match=r"tick 2: .* row 0: 2 of 1, row 2: 2 of 1"):
        tightened_offsets(box, tube, offsets)
    left = tightened_offsets(box, tube)
    np.testing.assert_allclose(left, np.tile([3.0, 1.0, 3.0, 1.0], (4, 1)), rtol=1e-5)
    with pytest.raises(InvalidTube, match="got 3 columns, must be 1 of the state and 1"):
        tightened_offsets(Polytope(np.eye(3), np.ones(3)), tube)


def test_no_terminal_set_of_a_loop_that_grows_or_of_an_origin_outside():
    with pytest.raises(InvalidTube, match=r"modulus 1\.0500"):
        admissible_subset(np.array([[1.05]]), Polytope.box([-1.0], [1.0]))
    with pytest.raises(InvalidTube, match=r"smallest offset is -0\.5"):
        admissible_subset(np.array([[0.5]]), Polytope.box([0.5], [1.0]))


@pytest.mark.parametrize(
    ("normals", "offsets"),
    [(np.eye(2), np.ones(3)), (np.ones(2), np.ones(2)), (np.eye(1), np.array([np.inf]))],
)
def test_half_spaces_that_do_not_fit_are_refused(normals, offsets):
    with pytest.raises(InvalidTube, match="must be"):
        Polytope(normals, offsets)
