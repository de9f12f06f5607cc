"""Linear systems along a horizon: zero-order hold, Riccati, ordered product."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from ttempc.errors import InvalidTuning
from ttempc.models.linear import preview_gains, riccati_gains, zero_order_hold
from ttempc.types import FloatArray

PERIOD_S = 0.2


def test_every_sample_of_a_long_series_is_the_exponential_of_its_own():
    generator = np.random.default_rng(1)
    a, b = generator.normal(size=(1100, 5, 5)), generator.normal(size=(1100, 5, 2))
    a_d, b_d = zero_order_hold(a, b, PERIOD_S)
    for k in (0, 511, 512, 1023, 1024, 1099):
        block = np.zeros((7, 7))
        block[:5] = PERIOD_S * np.hstack([a[k], b[k]])
        exact = expm(block)[:5]
        assert np.abs(np.hstack([a_d[k], b_d[k]]) - exact).max() < 1e-14


def test_gain_of_one_state_is_the_closed_form():
    """z(k+1) = z + u, Q = R = 1: the golden ratio."""
    one = np.ones((4, 1, 1))
    gains = riccati_gains(one, one, one, np.ones(1))
    np.testing.assert_allclose(gains, (math.sqrt(5.0) - 1.0) / 2.0)


def test_model_that_cannot_be_stabilised_is_refused():
    a, b = np.full((3, 1, 1), 2.0), np.zeros((3, 1, 1))
    with pytest.raises(InvalidTuning, match="regulator"):
        riccati_gains(a, b, np.ones((3, 1, 1)), np.ones(1))


def test_gains_of_a_finite_horizon_minimise_its_cost():
    """Against the minimiser of the stacked quadratic cost over all inputs."""
    generator = np.random.default_rng(56)
    count, n, m = 6, 3, 2
    a, b = generator.normal(size=(count, n, n)), generator.normal(size=(count, n, m))
    half = generator.normal(size=(count + 1, n, n))
    cost, weight = half @ half.transpose(0, 2, 1), np.array([0.5, 2.0])
    gains = riccati_gains(a, b, cost[:-1], weight, cost[-1])
    z = start = generator.normal(size=n)
    inputs = []
    for k in range(count):
        inputs.append(-gains[k] @ z)
        z = a[k] @ z + b[k] @ inputs[-1]

    state, by_inputs = np.eye(n), np.zeros((n, count * m))
    hessian, gradient = np.diag(np.tile(weight, count)), np.zeros(count * m)
    for k in range(count):
        state, by_inputs = a[k] @ state, a[k] @ by_inputs
        by_inputs[:, k * m : (k + 1) * m] += b[k]
        hessian = hessian + by_inputs.T @ cost[k + 1] @ by_inputs
        gradient = gradient + by_inputs.T @ cost[k + 1] @ state @ start
    minimiser = -np.linalg.solve(hessian, gradient)
    np.testing.assert_allclose(np.concatenate(inputs), minimiser, rtol=1e-6, atol=1e-9)


def test_preview_gains_are_those_of_the_batch_problem() -> None:
    # min sum z'Qz + u'Ru over all stages at once, for a disturbance that is known beforehand
    generator = np.random.default_rng(5)
    stages, n, m, q = 6, 3, 2, 2
    a = generator.normal(0.0, 0.6, (stages, n, n))
    b = generator.normal(0.0, 1.0, (stages, n, m))
    by = generator.normal(0.0, 1.0, (stages, n, q))
    cost = np.tile(np.diag([1.0, 2.0, 0.5]), (stages + 1, 1, 1))
    weight = np.array([0.3, 0.7])
    known = generator.normal(0.0, 1.0, (stages, q))
    start = generator.normal(0.0, 1.0, n)

    def states(inputs: FloatArray) -> FloatArray:
        z = [start]
        for k in range(stages):
            z.append(a[k] @ z[-1] + b[k] @ inputs[k] + by[k] @ known[k])
        return np.array(z)

    free = states(np.zeros((stages, m)))
    response = np.zeros((stages + 1, n, stages, m))
    for k in range(stages):
        for i in range(m):
            unit = np.zeros((stages, m))
            unit[k, i] = 1.0
            response[:, :, k, i] = states(unit) - free
    flat = response.reshape(-1, stages * m)
    weights = np.kron(np.eye(stages + 1), cost[0])
    hessian = flat.T @ weights @ flat + np.diag(np.tile(weight, stages))
    best = -np.linalg.solve(hessian, flat.T @ weights @ free.ravel())[:m]

    gains = riccati_gains(a, b, cost[:-1], weight, cost[-1])
    ahead = preview_gains(a, b, gains, cost[:-1], weight, cost[-1], by, stages)
    found = -gains[0] @ start - np.einsum("jmq,jq->m", ahead[0], known)
    assert found == pytest.approx(best, abs=1e-9)
