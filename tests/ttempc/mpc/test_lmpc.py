"""Linear MPC: bounds, convergence, and the fallback when the solver fails."""

from __future__ import annotations

import numpy as np

from tests.ttempc.horizons import PERIOD_S, TUNING, horizon
from ttempc.mpc.lmpc import LinearMpc

BOUND = np.asarray(TUNING.input_bound)
RATE = np.asarray(TUNING.input_rate)


def test_inputs_and_their_rates_stay_within_the_papers_bounds():
    generator = np.random.default_rng(21)
    mpc = LinearMpc(horizon())
    before = np.zeros(3)
    for k in range(horizon().ticks):
        error = 10.0 ** generator.uniform(-2, 1) * generator.normal(size=7)
        action = mpc.step(k, error, before)
        assert action.fallback == ""
        assert np.all(np.abs(action.input) <= BOUND)
        assert np.all(np.abs(action.input - before) <= RATE * PERIOD_S + 1e-9)
        before = action.input


def test_no_error_needs_no_feedback():
    action = LinearMpc(horizon()).step(3, np.zeros(7), np.zeros(3))
    np.testing.assert_allclose(action.input, 0.0, atol=1e-9)


def test_feedback_drives_the_model_to_the_reference():
    """On a straight, by the linear model itself: every position error fades.

    Position errors of tractor and trailer along the path are the same in the model, for one
    speed moves both; they start alike.
    """
    mpc = LinearMpc(horizon())
    model = horizon().prediction(0)
    z = np.array([0.2, -0.3, 0.0, 0.2, 0.3, 0.0, 0.0])
    start = z
    previous = np.zeros(3)
    for _ in range(200):
        u = mpc.step(0, z, previous).input
        step = np.concatenate([z, previous, u - previous, np.zeros(6)])
        z, previous = model[0] @ step, u
    assert np.linalg.norm(z) < 0.05 * np.linalg.norm(start)


def test_failure_holds_the_previous_feedback_and_the_next_solve_is_right():
    mpc, fresh = LinearMpc(horizon()), LinearMpc(horizon())
    error = np.array([0.1, 0.2, 0.05, 0.1, -0.2, 0.05, 0.1])
    held = mpc.step(5, error, np.zeros(3)).input
    fresh.step(5, error, np.zeros(3))
    failed = mpc.step(6, np.full(7, np.nan), held)
    np.testing.assert_array_equal(failed.input, held)
    assert "previous feedback held" in failed.fallback
    assert not failed.report.accepted
    recovered, expected = mpc.step(6, error, held), fresh.step(6, error, held)
    np.testing.assert_allclose(recovered.input, expected.input, atol=1e-9)
    assert recovered.fallback == ""
