"""Laws of the saturated LQ robust law."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from ttempc.errors import InvalidTuning
from ttempc.laws.lq_robust_law import LqRobustLaw, LqRobustTuning, autocorrelation
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Disturbance, MapDisturbance, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TUBE = LqRobustTuning(nominal="tube", tightening="none")
TICKS = 150
SIZE = len(State) + len(Disturbance) + len(MapDisturbance)


@cache
def model():
    return error_dynamics(Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0)), PERIOD_S, TICKS)


def robust_law(tuning):
    return LqRobustLaw(*model(), PERIOD_S, tuning)


@pytest.mark.parametrize("tuning", [LqRobustTuning(), TUBE])
def test_action_stays_within_its_authority(tuning):
    generator = np.random.default_rng(52)
    law = robust_law(tuning)
    for k in range(TICKS - 1):
        error = 10.0 ** generator.uniform(-3.0, 2.0) * generator.normal(size=SIZE)
        action = law.step(k, error, np.zeros(3))
        assert np.all(np.abs(action.input) <= tuning.saturation)
        law.record_feedback(k, action.mpc_state, np.zeros(3))


@pytest.mark.parametrize("tuning", [LqRobustTuning(), TUBE])
def test_model_that_is_right_needs_no_robust_action(tuning):
    a, b, _ = model()
    generator = np.random.default_rng(53)
    law, error, feedback = robust_law(tuning), 0.1 * generator.normal(size=SIZE), np.zeros(3)
    for k in range(30):
        action = law.step(k, error, feedback)
        np.testing.assert_allclose(action.input, 0.0, atol=1e-12)
        np.testing.assert_allclose(action.modelling_error, 0.0, atol=1e-12)
        feedback = 0.05 * generator.normal(size=3)
        law.record_feedback(k, action.mpc_state, feedback)
        error = a[k] @ error + b[k] @ feedback


def test_small_actions_stabilise_what_the_model_does_not_know():
    """The robust law alone in the tube reading, on the linear model from a few centimetres."""
    a, b, c = model()
    law, error = robust_law(TUBE), np.zeros(SIZE)
    law.record_feedback(0, error.copy(), np.zeros(3))
    error[:7] = 0.02
    for k in range(1, TICKS - 1):
        action = law.step(k, error, np.zeros(3))
        assert action.fallback == ""
        law.record_feedback(k, action.mpc_state, np.zeros(3))
        error = a[k] @ error - b[k] @ action.input  # u = u_r - u_e, and u_m adds to u
    assert np.abs(c[TICKS - 1] @ error).max() < 0.002


def test_autocorrelation_is_the_correlation_of_a_signal_with_its_past():
    """Of white noise, of an autoregressive signal, and of one that changes its sign."""
    generator = np.random.default_rng(54)
    memory, signal = np.zeros((3, 3)), np.zeros(3)
    estimates = []
    for _ in range(3000):
        signal = np.array([0.0, 0.6, -0.6]) * signal + generator.normal(size=3)
        estimates.append(autocorrelation(memory, 0.99, signal))
    np.testing.assert_allclose(np.mean(estimates, axis=0), [0.0, 0.6, 0.0], atol=0.06)
    assert np.min(estimates) >= 0.0
    assert np.max(estimates) <= 1.0


def test_robust_action_acts_on_autocorrelated_residuals_and_not_on_white_ones():
    """Residuals of both kinds on the linear model, with the input that was sent."""
    a, _, _ = model()
    generator = np.random.default_rng(55)
    sizes = {}
    for memory in (0.0, 0.8):
        law, error, residual, actions = (
            robust_law(LqRobustTuning()),
            np.zeros(SIZE),
            np.zeros(SIZE),
            [],
        )
        for k in range(TICKS - 1):
            action = law.step(k, error, np.zeros(3))
            actions.append(action.input)
            law.record_feedback(k, action.mpc_state, np.zeros(3))
            residual[:7] = memory * residual[:7]
            residual[:2] += 0.01 * math.sqrt(1.0 - memory**2) * generator.normal(size=2)
            error = a[k] @ error + residual
        sizes[memory] = np.sqrt(np.mean(np.square(actions), axis=0))
    assert np.all(sizes[0.0] < 0.4 * sizes[0.8])


def test_nominal_state_of_the_tube_starts_anew_where_the_law_is_exhausted():
    law, far = robust_law(TUBE), np.zeros(SIZE)
    law.record_feedback(0, far.copy(), np.zeros(3))
    far[1] = 3.0
    action = law.step(1, far, np.zeros(3))
    assert "exhausted" in action.fallback
    np.testing.assert_array_equal(action.mpc_state, far)
    np.testing.assert_array_equal(action.input, 0.0)


@pytest.mark.parametrize(
    "arguments",
    [
        {"memory_s": 0.0},
        {"saturation": (0.2, 0.0, 0.1)},
        {"input_weight": (1.0, math.inf, 1.0)},
        {"nominal": "two-step"},
    ],
)
def test_impossible_tunings_are_refused(arguments):
    with pytest.raises(InvalidTuning, match=next(iter(arguments))):
        LqRobustTuning(**arguments)
