"""The compiled arithmetic of a step beside its clear twins."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ttempc.horizons import random_qp
from ttempc.models import tracking_error
from ttempc.mpc import step_kernels as kernel

GENERATOR = np.random.default_rng(41)


def test_tick_vectors_are_the_formulas():
    by_known, lower, upper = (GENERATOR.normal(size=size) for size in ((5, 6, 10), (5, 6), (5, 6)))
    state, previous = GENERATOR.normal(size=7), GENERATOR.normal(size=3)
    gradient, low, high = kernel.tick_vectors(by_known, lower, upper, 2, state, previous)
    shift = np.tile(previous, 2)
    np.testing.assert_allclose(gradient, by_known[2] @ np.concatenate([state, previous]))
    np.testing.assert_allclose(low, lower[2] - shift)
    np.testing.assert_allclose(high, upper[2] - shift)


def test_clipped_is_the_clip_of_numpy():
    for _ in range(50):
        values, bounds = GENERATOR.normal(size=4), GENERATOR.normal(size=(2, 4))
        np.testing.assert_array_equal(kernel.clipped(values, bounds), np.clip(values, *bounds))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_tracking_error_is_the_clear_one(scale):
    for _ in range(50):
        state, reference = scale * GENERATOR.normal(size=(2, 7))
        trailer, trailer_reference = scale * GENERATOR.normal(size=(2, 2))
        args = (state, trailer, reference, trailer_reference)
        expected = tracking_error.tracking_error(*args)
        np.testing.assert_allclose(kernel.tracking_error(*args), expected, atol=1e-12 * scale)


def test_slack_is_minus_the_violation_and_nan_for_no_number():
    for _ in range(50):
        qp, _, _ = random_qp(GENERATOR, 0.3)
        x = GENERATOR.normal(size=9) * GENERATOR.choice([1e-3, 1.0])
        bounds = qp.matrix, x, qp.lower, qp.upper, qp.step_lower, qp.step_upper
        found = kernel.slack(*bounds)
        assert max(0.0, -found) == pytest.approx(qp.residuals(x).primal, abs=1e-12)
        x[4] = np.nan
        assert np.isnan(kernel.slack(*bounds))


def test_convex_is_positive_definite_and_finite():
    for _ in range(50):
        factor = GENERATOR.normal(size=(9, 9))
        matrix = factor @ factor.T - GENERATOR.uniform(-1.0, 2.0) * np.eye(9)
        assert kernel.convex(matrix) == (np.linalg.eigvalsh(matrix)[0] > 0.0)
    for bad in (np.nan, np.inf):
        spoilt = np.eye(9)
        spoilt[5, 3] = spoilt[3, 5] = bad
        assert not kernel.convex(spoilt)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_finite_tells_one_bad_entry(bad):
    vectors = [np.zeros(3), np.zeros(4), np.zeros(2)]
    assert kernel.finite(*vectors)
    for vector in vectors:
        vector[-1] = bad
        assert not kernel.finite(*vectors)
        vector[-1] = 0.0
