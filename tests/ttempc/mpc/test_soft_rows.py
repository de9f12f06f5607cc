"""Soft rows of the QP: rolled model, exactness of the penalty, slack."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.exact_qp import exact_minimum
from tests.ttempc.horizons import PERIOD_S, TUNING, horizon, random_qp, stages
from ttempc.mpc.lmpc import CondensedHorizon, LinearMpc, OutputBounds
from ttempc.mpc.qp import PersistentSolver, SoftRows

FIRST = 3


def bounded(lower, upper):
    """Return the horizon with two outputs, random combinations of the state, within bounds."""
    a, b = stages()
    rows = np.random.default_rng(3).normal(size=(len(a) + 1, 2, 7))
    shape = (len(a) + 1, 2)
    soft = OutputBounds(rows, np.full(shape, lower), np.full(shape, upper), FIRST)
    return rows, CondensedHorizon(a, b, TUNING, PERIOD_S, soft=soft)


def test_rows_are_the_outputs_of_the_rolled_model():
    rows, limited = bounded(-0.4, 0.7)
    a, b = stages()
    generator = np.random.default_rng(4)
    k, z, u = 55, generator.normal(size=7), generator.normal(size=3)
    steps = generator.normal(size=9)
    soft = limited.qp(k, z, u).soft
    assert soft is not None
    expected = []
    for j in range(TUNING.horizon):
        u = u + (steps[3 * j : 3 * j + 3] if j < TUNING.moves else 0.0)
        z = a[k + j] @ z + b[k + j] @ u
        if j + 1 >= FIRST:
            expected += (rows[k + j + 1] @ z).tolist()
    np.testing.assert_allclose(soft.matrix @ steps - soft.upper, np.array(expected) - 0.7)
    np.testing.assert_allclose(soft.matrix @ steps - soft.lower, np.array(expected) + 0.4)


def test_slack_is_zero_where_the_rows_can_hold_and_the_largest_violation_elsewhere():
    generator = np.random.default_rng(8)
    held = violated = 0
    solver = PersistentSolver()
    for _ in range(60):
        qp, _, _ = random_qp(generator, scale=0.02)
        free = PersistentSolver().solve(qp).x
        assert free is not None
        rows = np.zeros((4, 9))
        rows[:, :3] = generator.normal(size=(4, 3))
        upper = rows @ free - 0.01 * generator.uniform(-0.5, 1.0, size=4)
        soft = SoftRows(rows, upper - 10.0, upper, outputs=2)
        softened = replace(qp, soft=soft)
        x = solver.solve(softened).x
        assert x is not None
        if len(x) == 9:  # no row is active
            assert soft.hold(x)
            np.testing.assert_array_equal(x, free)
            continue
        residuals = softened.hardened().residuals(x)
        assert residuals.primal < 1e-7
        assert residuals.stationarity < 1e-4
        violation = (rows @ x[:9] - upper).reshape(2, 2).max(axis=0)
        np.testing.assert_allclose(x[9:], np.maximum(violation, 0.0), atol=1e-6)
        if x[9:].max() > 1e-6:
            violated += 1
            continue
        held += 1
        hard = replace(
            qp,
            matrix=np.vstack([qp.matrix, rows]),
            lower=np.concatenate([qp.lower, soft.lower]),
            upper=np.concatenate([qp.upper, soft.upper]),
        )
        np.testing.assert_allclose(x[:9], exact_minimum(hard), atol=1e-6)
    assert held > 5
    assert violated > 5


@pytest.mark.parametrize("bound", [np.inf, 50.0])
def test_bounds_that_are_free_or_far_change_no_bit(bound):
    _, limited = bounded(-bound, bound)
    generator = np.random.default_rng(9)
    one, other = LinearMpc(horizon()), LinearMpc(limited)
    for k in range(30):
        state, previous = 0.02 * generator.normal(size=7), 0.02 * generator.normal(size=3)
        plain, soft = one.step(k, state, previous), other.step(k, state, previous)
        if plain.report.iterations == 0 or np.isinf(bound):
            np.testing.assert_array_equal(soft.plan, plain.plan)
        assert soft.excess is None or soft.excess.max() < 1e-6
