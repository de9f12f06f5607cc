"""Condensed QP against the horizon written out."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

from tests.ttempc.exact_qp import exact_minimum
from tests.ttempc.horizons import PERIOD_S, TUNING, horizon, random_qp, stages
from ttempc.errors import InvalidTuning
from ttempc.mpc.lmpc import CondensedHorizon, HorizonTuning, is_convex
from ttempc.mpc.qp import QP


def rolled_cost(k, state, previous, steps):
    """Eq. (costfunction), stage by stage, without the constant term of z_k."""
    a, b = stages()
    moves = steps.reshape(TUNING.moves, 3)
    z, u, cost = state, previous, 0.0
    for j in range(TUNING.horizon):
        if j < TUNING.moves:
            u = u + moves[j]
            cost += moves[j] @ np.diag(TUNING.step_weight) @ moves[j]
        z = a[k + j] @ z + b[k + j] @ u
        cost += z @ np.diag(TUNING.output_weight) @ z
    return cost


def test_objective_differs_from_the_rolled_cost_by_a_constant():
    generator = np.random.default_rng(5)
    for k in (0, 40, 55, 100):
        state, previous = generator.normal(size=7), 0.05 * generator.normal(size=3)
        qp = horizon().qp(k, state, previous)
        free = rolled_cost(k, state, previous, np.zeros(9))
        for _ in range(3):
            steps = 0.1 * generator.normal(size=9)
            rolled = rolled_cost(k, state, previous, steps) - free
            assert qp.objective(steps) == pytest.approx(rolled, rel=1e-9, abs=1e-9)


def test_prediction_is_the_rolled_model():
    generator = np.random.default_rng(6)
    a, b = stages()
    k, state, previous = 55, generator.normal(size=7), generator.normal(size=3)
    steps = generator.normal(size=9)
    predicted = horizon().prediction(k) @ np.concatenate([state, previous, steps])
    z, u = state, previous
    for j in range(TUNING.horizon):
        u = u + (steps[3 * j : 3 * j + 3] if j < TUNING.moves else 0.0)
        z = a[k + j] @ z + b[k + j] @ u
        np.testing.assert_allclose(predicted[j], z, atol=1e-12)


def test_condensed_solution_is_the_uncondensed_one():
    """States kept as unknowns, the model as equality constraints, another solver."""
    generator = np.random.default_rng(7)
    a, b = stages()
    n, moves = TUNING.horizon, TUNING.moves
    for k in (0, 55, 100):
        state, previous = 0.3 * generator.normal(size=7), np.array([0.1, -0.05, 0.02])
        qp = horizon().qp(k, state, previous)
        condensed = exact_minimum(qp)
        # unknowns: z_1 ... z_8, then Delta u_0 ... Delta u_2
        size = 7 * n + 3 * moves
        cost = np.zeros((size, size))
        cost[: 7 * n, : 7 * n] = np.kron(np.eye(n), np.diag(TUNING.output_weight))
        cost[7 * n :, 7 * n :] = np.eye(3 * moves)
        model, right = np.zeros((7 * n, size)), np.zeros(7 * n)
        for j in range(n):
            rows = slice(7 * j, 7 * j + 7)
            model[rows, rows] = np.eye(7)
            if j:
                model[rows, 7 * (j - 1) : 7 * j] = -a[k + j]
            else:
                right[rows] = a[k] @ state
            right[rows] += b[k + j] @ previous
            for i in range(min(j + 1, moves)):
                model[rows, 7 * n + 3 * i : 7 * n + 3 * i + 3] = -b[k + j]
        sums = np.hstack([np.zeros((9, 7 * n)), np.kron(np.tril(np.ones((3, 3))), np.eye(3))])
        limit = np.tile(TUNING.input_bound, moves)
        step = np.tile(TUNING.input_rate, moves) * PERIOD_S
        steps_only = np.hstack([np.zeros((9, 7 * n)), np.eye(9)])
        shift = np.tile(previous, moves)
        full = minimize(
            lambda x, cost=cost: x @ cost @ x,
            np.zeros(size),
            jac=lambda x, cost=cost: 2.0 * cost @ x,
            method="SLSQP",
            constraints=[
                LinearConstraint(model, right, right),
                LinearConstraint(sums, -limit - shift, limit - shift),
                LinearConstraint(steps_only, -step, step),
            ],
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert full.success
        np.testing.assert_allclose(full.x[7 * n :], condensed, atol=1e-5)


def test_residuals_tell_an_optimum_from_another_point():
    generator = np.random.default_rng(8)
    qp, _, _ = random_qp(generator, 1.0)
    best = exact_minimum(qp)
    assert qp.residuals(best).stationarity < 1e-8
    assert qp.residuals(best).primal < 1e-9
    assert qp.residuals(0.5 * best).stationarity > 1e-2
    assert qp.residuals(best + 1.0).primal > 0.1


def test_bounds_are_those_of_the_paper():
    qp = horizon().qp(0, np.zeros(7), np.zeros(3))
    np.testing.assert_allclose(np.degrees(qp.upper[:2]), [12.0, 6.0])
    np.testing.assert_allclose(np.degrees(qp.step_upper[:2]), [11.0, 7.0])  # a second / 5
    assert qp.upper[2] == pytest.approx(0.10)
    assert qp.step_upper[2] == pytest.approx(0.06)


def test_least_slack_is_minus_the_violation():
    generator = np.random.default_rng(41)
    for _ in range(50):
        qp, _, _ = random_qp(generator, 0.3)
        x = generator.normal(size=9) * generator.choice([1e-3, 1.0])
        assert max(0.0, -qp.slack(x).min()) == qp.residuals(x).primal


def test_slack_is_zero_where_a_bound_is_active():
    qp, _, _ = random_qp(np.random.default_rng(42), 5.0)
    slack = qp.slack(exact_minimum(qp))
    assert slack.min() == pytest.approx(0.0, abs=1e-9)
    assert np.sum(slack < 1e-9) < len(slack)


def test_convex_is_finite_and_positive_definite():
    generator = np.random.default_rng(43)
    for _ in range(50):
        factor = generator.normal(size=(9, 9))
        matrix = factor @ factor.T - generator.uniform(-1.0, 2.0) * np.eye(9)
        assert is_convex(matrix) == (np.linalg.eigvalsh(matrix)[0] > 0.0)
        assert not is_convex(np.stack([np.eye(9), matrix - 1e3 * np.eye(9)]))
    for bad in (np.nan, np.inf):
        corrupted = np.eye(9)
        corrupted[5, 3] = corrupted[3, 5] = bad
        assert not is_convex(corrupted)


def test_a_step_from_within_reach_leads_into_the_bounds():
    generator = np.random.default_rng(44)
    first, step = horizon().first, np.asarray(TUNING.input_rate) * PERIOD_S
    for _ in range(200):
        k = int(generator.integers(horizon().ticks))
        previous = first.clamp_previous(k, generator.normal(size=3))
        landed = first.clamp(k, previous)
        assert np.all(np.abs(landed - previous) <= step + 1e-15)
        inside = first.clamp(k, 0.3 * generator.normal(size=3))
        np.testing.assert_array_equal(first.clamp_previous(k, inside), inside)


@pytest.mark.parametrize(
    "arguments",
    [
        {"moves": 0},
        {"moves": 9},
        {"output_weight": (-1.0,) * 7},
        {"step_weight": (1.0, 0.0, 1.0)},
        {"input_bound": (1.0, float("nan"), 1.0)},
    ],
)
def test_impossible_tunings_are_refused(arguments):
    with pytest.raises(InvalidTuning, match=next(iter(arguments))):
        HorizonTuning(**arguments)


def test_model_that_is_not_finite_is_refused():
    a, b = (matrix.copy() for matrix in stages())
    a[60, 0, 0] = np.nan
    with pytest.raises(InvalidTuning, match="finite"):
        CondensedHorizon(a, b, TUNING, PERIOD_S)


def test_model_of_another_size_is_refused():
    a, b = stages()
    with pytest.raises(InvalidTuning, match="do not fit"):
        CondensedHorizon(a[:5], b[:5], TUNING, PERIOD_S)


def test_qp_can_be_made_by_hand():
    qp = QP(
        np.eye(1),
        np.array([-3.0]),
        np.eye(1),
        -np.ones(1),
        np.ones(1),
        np.full(1, -0.5),
        np.full(1, 0.5),
    )
    assert qp.residuals(np.array([0.5])).stationarity < 1e-12


def test_a_tick_has_the_same_qp_in_any_order_and_on_a_horizon_of_its_own():
    a, b = stages()
    given = np.linspace(-0.1, 0.1, 7), np.zeros(3)
    in_order = {k: horizon().qp(k, *given) for k in range(horizon().ticks)}
    order = np.random.default_rng(45).permutation(horizon().ticks)  # back and forth over blocks
    for k in order.tolist():
        alone = CondensedHorizon(
            a[k : k + TUNING.horizon], b[k : k + TUNING.horizon], TUNING, PERIOD_S
        )
        for qp in (in_order[k], alone.qp(0, *given)):
            again = horizon().qp(k, *given)
            assert qp.hessian.tobytes() == again.hessian.tobytes()
            assert qp.gradient.tobytes() == again.gradient.tobytes()
        assert alone.prediction(0).tobytes() == horizon().prediction(k).tobytes()


def test_memory_of_a_long_horizon_is_that_of_its_bounds():
    """The matrices of all ticks would take 11 KB a tick."""
    a, b = (np.tile(matrix, (10, 1, 1)) for matrix in stages())
    tracemalloc.start()
    try:
        long = CondensedHorizon(a, b, TUNING, PERIOD_S)
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    per_tick = 8 * 4 * 3 * (TUNING.moves + 1)  # lower and upper, of input and step
    assert held < 1.1 * long.ticks * per_tick + 1e6
    assert peak < 3e6 + 3.0 * long.ticks * per_tick
