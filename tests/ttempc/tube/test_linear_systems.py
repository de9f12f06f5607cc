"""Tubes of linear systems: published numbers, closed forms, the polytope library."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial import ConvexHull

from ttempc.errors import InvalidTube
from ttempc.tube import (
    DisturbanceSet,
    Polytope,
    SupportSet,
    TrackingSystem,
    admissible_subset,
    feedback_gains,
    fit_set,
    invariant_tube,
    linear_map,
    outline,
    reachable_set,
    tightened_offsets,
)
from ttempc.tube.sets import directions_in

UNIT = DisturbanceSet(np.eye(2), shape="box")


@pytest.fixture
def generator():
    return np.random.default_rng(4)


def through(directions, floor):
    """Return the set of w = E d, widened to full rank by `floor` along all other directions."""
    return DisturbanceSet(np.hstack([directions, floor * null_space(directions.T)]))


def varying(generator, ticks=30, n=3):
    """Return a time-varying system that contracts on average, not in every step."""
    a = 0.35 * generator.standard_normal((ticks, n, n))
    return TrackingSystem.along(a, np.zeros((ticks, n, 1)), np.zeros((ticks, 1, n)))


def test_alpha_of_the_published_example():
    """Rakovic et al. (2005), equation (15): alpha is 1.9e-5 with 10 terms."""
    a, b = np.array([[1.0, 1.0], [0.0, 1.0]]), np.ones((2, 1))
    system = TrackingSystem.along(a[None], b[None], -np.array([[[1.17, 1.03]]]))
    certificate = invariant_tube(system, UNIT, 2e-5).certificate
    assert certificate.terms == 10
    assert certificate.alpha == pytest.approx(1.9e-5, abs=0.05e-5)


def test_gain_of_the_published_tube_mpc():
    """Mayne, Seron and Rakovic (2005): K = [-0.66 -1.33] for Q = I, R = 0.01."""
    a, b = np.array([[[1.0, 1.0], [0.0, 1.0]]]), np.array([[[0.5], [1.0]]])
    gain = feedback_gains(a, b, np.eye(2), np.array([0.01]))
    np.testing.assert_allclose(gain[0, 0], [-0.66, -1.33], atol=0.005)


@pytest.mark.parametrize("pole", [0.0, 0.6, -0.6])
def test_a_scalar_set_grows_as_the_geometric_series(pole):
    system = TrackingSystem.along(
        np.full((9, 1, 1), pole), np.zeros((9, 1, 1)), np.zeros((9, 1, 1))
    )
    disturbance = DisturbanceSet(np.array([[0.5]]), shape="box")
    start = DisturbanceSet(np.array([[3.0]]), shape="box")
    direction = np.ones((1, 1))
    for k in range(9):
        exact = 0.5 * sum(abs(pole) ** i for i in range(k))
        reached = reachable_set(system, disturbance, k).support(direction)
        from_start = reachable_set(system, disturbance, k, start).support(direction)
        assert reached[0] == pytest.approx(exact)
        assert from_start[0] == pytest.approx(exact + 3.0 * abs(pole) ** k)
    whole = invariant_tube(system, disturbance, 1e-9).states[-1, 0]
    assert whole == pytest.approx(0.5 / (1.0 - abs(pole)))


def test_the_reachable_set_is_reached_and_never_left(generator):
    system, k = varying(generator), 12
    axes = generator.standard_normal((3, 3))
    reach = reachable_set(system, DisturbanceSet(axes), k)
    directions = directions_in(3, 40, generator)
    corners = np.sign(generator.standard_normal((500, k, 3))) @ axes.T
    m, best = np.zeros((500, 3)), np.zeros(40)
    row = directions
    for step in range(k):
        m = m @ system.closed[step].T + corners[:, step]
    for step in reversed(range(k)):  # the best corner of each step, by hand
        best += np.abs(row @ axes).sum(axis=1)
        row = row @ system.closed[step]
    assert np.all(m @ directions.T <= reach.support(directions) + 1e-12)
    np.testing.assert_allclose(reach.support(directions), best)


def test_the_reachable_set_from_the_tube_stays_in_the_tube(generator):
    system, disturbance = varying(generator), DisturbanceSet(0.1 * np.eye(3))
    tube = invariant_tube(system, disturbance)
    directions = directions_in(3, 60, generator)
    for k in (1, 5, 29):
        reached = reachable_set(system, disturbance, k, tube.at(0)).support(directions)
        assert np.all(reached <= tube.at(k).support(directions) * (1.0 + 1e-9))


def test_a_disturbance_of_fewer_directions_has_the_sum_of_their_effects_as_its_tube(generator):
    """The minimal set of m(k+1) = A m(k) + e d is the sum of the segments A^i e."""
    a = np.array([[0.8, 0.3, 0.0], [-0.2, 0.7, 0.1], [0.0, 0.2, 0.5]])
    e = np.array([[0.1], [0.2], [0.0]])
    system = TrackingSystem.along(a[None], np.zeros((1, 3, 1)), np.zeros((1, 1, 3)))
    directions = directions_in(3, 50, generator)
    segments = np.hstack([np.linalg.matrix_power(a, i) @ e for i in range(400)])
    exact = np.abs(directions @ segments).sum(axis=1)
    tube = invariant_tube(system, through(e, 1e-6), 1e-4)
    support = tube.at(0).support(directions)
    assert np.all(support >= exact)
    np.testing.assert_allclose(support, exact, rtol=3e-4)
    for columns, floor in ((np.hstack([e, 2.0 * e]), 1e-6), (e, 0.0)):
        with pytest.raises(InvalidTube, match="full rank"):
            through(columns, floor)


@pytest.mark.parametrize(
    ("a", "gains"),
    [
        (np.eye(2), np.zeros((1, 1, 2))),  # not a stack
        (0.5 * np.eye(2)[None], np.zeros((1, 2, 1))),  # K of the wrong shape
        (0.5 * np.ones((2, 2, 2)), np.zeros((1, 1, 2))),  # another number of ticks
        (np.full((1, 2, 2), np.nan), np.zeros((1, 1, 2))),
    ],
)
def test_matrices_that_do_not_fit_are_refused(a, gains):
    with pytest.raises(InvalidTube, match="must be"):
        TrackingSystem.along(a, np.ones((1, 2, 1)), gains)


def test_a_tolerance_or_a_shape_out_of_range_is_refused():
    system = TrackingSystem.along(0.5 * np.eye(2)[None], np.zeros((1, 2, 1)), np.zeros((1, 1, 2)))
    for tolerance in (0.0, 1.0, np.nan):
        with pytest.raises(InvalidTube, match=r"tolerance: got .* between 0 and 1"):
            invariant_tube(system, UNIT, tolerance)
    with pytest.raises(InvalidTube, match="shape: got 'Box', must be one of"):
        DisturbanceSet(np.eye(2), shape="Box")


@pytest.mark.parametrize(
    ("runs", "coverage", "message"),
    [
        ([np.zeros((9, 2))], 0.9, "without spread"),
        ([np.ones(9)], 0.9, r"run 0: got \(9,\)"),
        ([np.full((9, 2), np.inf)], 0.9, "finite"),
        ([np.ones((2, 2))], 0.9, "of 4 steps at least"),
        ([np.ones((9, 2))], 1.5, "coverage: got 1.5"),
    ],
)
def test_residuals_that_give_no_set_are_refused(runs, coverage, message):
    with pytest.raises(InvalidTube, match=message):
        fit_set(runs, coverage, window=4)


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
