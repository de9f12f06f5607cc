"""Tubes of linear systems: published numbers, closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from ttempc.errors import InvalidTube
from ttempc.tube import (
    DisturbanceSet,
    TrackingSystem,
    feedback_gains,
    fit_set,
    invariant_tube,
)

UNIT = DisturbanceSet(np.eye(2), shape="box")


def test_alpha_of_the_published_example():
    """Rakovic et al. (2005), equation (15): alpha is 1.9e-5 with 10 terms."""
    a = np.array([[1.0, 1.0], [0.0, 1.0]])
    b = np.ones((2, 1))
    system = TrackingSystem.along(a[None], b[None], -np.array([[[1.17, 1.03]]]))
    certificate = invariant_tube(system, UNIT, 2e-5).certificate
    assert certificate.terms == 10
    assert certificate.alpha == pytest.approx(1.9e-5, abs=0.05e-5)


def test_gain_of_the_published_tube_mpc():
    """Mayne, Seron and Rakovic (2005): K = [-0.66 -1.33] for Q = I, R = 0.01."""
    a = np.array([[[1.0, 1.0], [0.0, 1.0]]])
    b = np.array([[[0.5], [1.0]]])
    gain = feedback_gains(a, b, np.eye(2), np.array([0.01]))
    np.testing.assert_allclose(gain[0, 0], [-0.66, -1.33], atol=0.005)


def test_the_tube_is_the_sum_of_the_vertices():
    """(1 - alpha)^-1 sum A_K^i W, by sums of vertices and qhull alone."""
    a = np.array([[1.0, 1.0], [0.0, 1.0]])
    b = np.array([[0.5], [1.0]])
    gain = feedback_gains(a[None], b[None], np.eye(2), np.array([0.01]))
    system = TrackingSystem.along(a[None], b[None], gain)
    tube = invariant_tube(system, DisturbanceSet(0.1 * np.eye(2), shape="box"), 1e-3)

    # The Minkowski sum of two polygons is the hull of all sums of their vertices.
    corners = 0.1 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    points = np.zeros((1, 2))
    for power in range(tube.certificate.terms):
        term = corners @ np.linalg.matrix_power(a + b @ gain[0], power).T
        points = (points[:, None] + term).reshape(-1, 2)
        points = points[ConvexHull(points).vertices]
    points /= 1.0 - tube.certificate.alpha

    directions = np.random.default_rng(1).standard_normal((200, 2))
    exact = (points @ directions.T).max(axis=0)
    np.testing.assert_allclose(tube.at(0).support(directions), exact, rtol=1e-12)
    np.testing.assert_allclose(tube.inputs[0], (points @ gain[0].T).max(axis=0))


def test_matrices_and_residuals_that_give_no_tube_are_refused():
    one = 0.5 * np.eye(2)[None]
    system = TrackingSystem.along(one, np.zeros((1, 2, 1)), np.zeros((1, 1, 2)))
    for word, refused in {
        "stack": lambda: TrackingSystem.along(np.eye(2), np.ones((1, 2, 1)), np.zeros((1, 1, 2))),
        "must be": lambda: TrackingSystem.along(one, np.ones((1, 2, 1)), np.zeros((1, 2, 1))),
        "finite": lambda: TrackingSystem.along(
            np.nan * one, np.ones((1, 2, 1)), np.zeros((1, 1, 2))
        ),
        "tolerance": lambda: invariant_tube(system, UNIT, 1.0),
        "shape": lambda: DisturbanceSet(np.eye(2), shape="Box"),
        "spread": lambda: fit_set([np.zeros((9, 2))], 0.9),
        "run 0": lambda: fit_set([np.ones(9)], 0.9),
        "4 steps": lambda: fit_set([np.ones((2, 2))], 0.9, window=4),
        "coverage": lambda: fit_set([np.ones((9, 2))], 1.5),
    }.items():
        with pytest.raises(InvalidTube, match=word):
            refused()
