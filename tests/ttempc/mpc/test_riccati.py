"""Optimality of the Riccati recursion's gains."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.ttempc.tubes import PERIOD_S, REFERENCE
from ttempc.errors import InvalidTuning
from ttempc.models.linear import riccati_gains
from ttempc.mpc.articulated_error import error_dynamics

TICKS = 150


def rolled_cost(a, b, state_cost, input_cost, gains, z):
    cost = 0.0
    for k, gain in enumerate(gains):
        u = -gain @ z
        cost += z @ state_cost[k] @ z + u @ np.diag(input_cost) @ u
        z = a[k] @ z + b[k] @ u
    return cost


def test_no_other_gain_costs_less():
    """Over a long horizon, along which the model changes."""
    generator = np.random.default_rng(51)
    a, b, c = error_dynamics(REFERENCE, PERIOD_S, TICKS)
    a, b, c = a[:, :7, :7], b[:, :7], c[:-1, :, :7]
    state_cost, weight = c.transpose(0, 2, 1) @ c, np.array([0.3, 0.3, 0.05])
    gains = riccati_gains(a, b, state_cost, weight)
    z = generator.normal(size=7)
    best = rolled_cost(a, b, state_cost, weight, gains, z)
    for _ in range(10):
        other = gains + 0.02 * generator.normal(size=gains.shape[1:])
        assert rolled_cost(a, b, state_cost, weight, other, z) > best


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
