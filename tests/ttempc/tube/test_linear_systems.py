"""Tubes of linear systems from arrays: published numbers, closed forms, reach, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

from ttempc.errors import InvalidTube
from ttempc.tube import (
    DisturbanceSet,
    TrackingSystem,
    draw_band,
    draw_set,
    feedback_gains,
    fit_set,
    invariant_tube,
    reachable_set,
    search_tube,
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


def test_windows_reach_less_and_the_partial_one_is_counted_whole(generator):
    system = varying(generator)
    step, window = DisturbanceSet(np.eye(3)), DisturbanceSet(np.eye(3), window=4)
    directions = directions_in(3, 20, generator)
    for k in (3, 4, 7, 11):
        short = reachable_set(system, window, k).support(directions)
        assert np.all(short <= reachable_set(system, step, k).support(directions) + 1e-12)
    with pytest.raises(InvalidTube, match="got 30, must be 0 to 29"):
        reachable_set(system, step, 30)


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


def test_support_of_all_ticks_is_that_of_each(generator):
    system = varying(generator)
    tube = invariant_tube(system, DisturbanceSet(0.1 * np.eye(3), window=3))
    rows = generator.standard_normal((30, 4, 3))
    all_ticks = tube.support(rows)
    for k in (0, 7, 29):
        np.testing.assert_allclose(all_ticks[k], tube.at(k).support(rows[k]))
    np.testing.assert_allclose(tube.support(np.tile(np.eye(3), (30, 1, 1))), tube.states)
    with pytest.raises(InvalidTube, match="windows of 3"):
        tube.generators(0)


def test_the_search_finds_the_deadbeat_gain():
    """The narrowest tube of x(k+1) = x + u + w is that of u = -x: m = w alone."""
    one = np.ones((1, 1, 1))
    disturbance = DisturbanceSet(np.array([[0.2]]), shape="box")

    def system_of(weights):
        return TrackingSystem.along(
            one, one, feedback_gains(one, one, weights[:1, None], weights[1:])
        )

    weights = search_tube(
        system_of, lambda tube: float(tube.states[0, 0]), disturbance, np.array([0.1, 1.0]), 60
    )
    before, after = (
        invariant_tube(system_of(each), disturbance).states[0, 0]
        for each in (np.array([0.1, 1.0]), weights)
    )
    assert after == pytest.approx(0.2, rel=0.05)
    assert before > 2.0 * after


def test_no_gain_for_a_mode_that_no_input_moves():
    with pytest.raises(InvalidTube, match="stabilises"):
        feedback_gains(2.0 * np.ones((1, 1, 1)), np.zeros((1, 1, 1)), np.eye(1), np.ones(1))


def test_a_loop_that_grows_is_refused():
    system = TrackingSystem.along(1.1 * np.eye(2)[None], np.zeros((1, 2, 1)), np.zeros((1, 1, 2)))
    with pytest.raises(InvalidTube, match=r"does not contract: .* modulus 1\.1000"):
        invariant_tube(system, UNIT)


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


def test_a_disturbance_of_another_dimension_is_refused():
    system = TrackingSystem.along(0.5 * np.eye(3)[None], np.zeros((1, 3, 1)), np.zeros((1, 1, 3)))
    with pytest.raises(InvalidTube, match="got 2 dimensions, must be 3"):
        invariant_tube(system, UNIT)


def test_a_slow_loop_needs_more_steps():
    one = np.ones((1, 1, 1))
    slow = TrackingSystem.along(0.999 * one, one, 0.0 * one)
    disturbance = DisturbanceSet(np.eye(1), shape="box")
    with pytest.raises(InvalidTube, match="1500 steps leave"):
        invariant_tube(slow, disturbance)
    tube = invariant_tube(slow, disturbance, most_steps=5000)
    assert tube.states[0, 0] == pytest.approx(1000.0)


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


def test_drawings_contain_the_set_and_follow_its_centre(generator):
    polygons, bands = [], []

    class Axes:
        def fill(self, x, y, **style):
            polygons.append((np.column_stack([x, y]), style))

        def fill_between(self, x, low, high, **style):
            bands.append((low, high))

    draw_set(
        Axes(),
        DisturbanceSet(np.diag([1.0, 2.0, 3.0])),
        (2, 1),
        np.array([9.0, 5.0, 7.0]),
        color="k",
    )
    polygon, style = polygons[0]
    np.testing.assert_allclose(polygon.max(axis=0), [10.0, 7.0])
    np.testing.assert_allclose(polygon.min(axis=0), [4.0, 3.0])
    assert style == {"color": "k"}
    draw_band(Axes(), np.arange(3.0), np.ones(3), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(bands[0], [[0.9, 0.8, 0.7], [1.1, 1.2, 1.3]])
