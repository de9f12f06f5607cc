"""The robust law with a regulator's gains, and the Riccati recursion behind it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from ttempc.errors import InvalidTuning
from ttempc.laws.lq_robust_law import TUBE, Recurrence, RegulatorTuning, RobustRegulator
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.mpc.riccati import riccati_gains
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Disturbance, MapDisturbance, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TICKS = 150
SIZE = len(State) + len(Disturbance) + len(MapDisturbance)


@cache
def model():
    return error_dynamics(Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0)), PERIOD_S, TICKS)


def regulator(tuning):
    return RobustRegulator(*model(), PERIOD_S, tuning)


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
    a, b, c = model()
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


@pytest.mark.parametrize("tuning", [RegulatorTuning(), TUBE])
def test_action_stays_within_its_authority(tuning):
    generator = np.random.default_rng(52)
    law = regulator(tuning)
    for k in range(TICKS - 1):
        error = 10.0 ** generator.uniform(-3.0, 2.0) * generator.normal(size=SIZE)
        made = law.step(k, error, np.zeros(3))
        assert np.all(np.abs(made.input) <= tuning.saturation)
        law.note(k, made.mpc_state, np.zeros(3))


@pytest.mark.parametrize("tuning", [RegulatorTuning(), TUBE])
def test_model_that_is_right_needs_no_robust_action(tuning):
    a, b, _ = model()
    generator = np.random.default_rng(53)
    law, error, feedback = regulator(tuning), 0.1 * generator.normal(size=SIZE), np.zeros(3)
    for k in range(30):
        made = law.step(k, error, feedback)
        np.testing.assert_allclose(made.input, 0.0, atol=1e-12)
        np.testing.assert_allclose(made.modelling_error, 0.0, atol=1e-12)
        feedback = 0.05 * generator.normal(size=3)
        law.note(k, made.mpc_state, feedback)
        error = a[k] @ error + b[k] @ feedback


def test_small_actions_stabilise_what_the_model_does_not_know():
    """The robust law alone in the tube reading, on the linear model from a few centimetres."""
    a, b, c = model()
    law, error = regulator(TUBE), np.zeros(SIZE)
    law.note(0, error.copy(), np.zeros(3))
    error[:7] = 0.02
    for k in range(1, TICKS - 1):
        made = law.step(k, error, np.zeros(3))
        assert made.fallback == ""
        law.note(k, made.mpc_state, np.zeros(3))
        error = a[k] @ error - b[k] @ made.input  # u = u_r - u_e, and u_m adds to u
    assert np.abs(c[TICKS - 1] @ error).max() < 0.002


def test_recurrence_is_the_correlation_of_a_signal_with_its_past():
    """Of white noise, of an autoregressive signal, and of one that changes its sign."""
    generator = np.random.default_rng(54)
    found, signal, shares = Recurrence(3, 0.99), np.zeros(3), []
    for _ in range(3000):
        signal = np.array([0.0, 0.6, -0.6]) * signal + generator.normal(size=3)
        shares.append(found.share(signal))
    np.testing.assert_allclose(np.mean(shares, axis=0), [0.0, 0.6, 0.0], atol=0.06)
    assert np.min(shares) >= 0.0
    assert np.max(shares) <= 1.0


def test_robust_action_answers_what_comes_again_and_not_what_is_white():
    """Surprises of both kinds on the linear model, with the input that was sent."""
    a, _, _ = model()
    generator = np.random.default_rng(55)
    sizes = {}
    for memory in (0.0, 0.8):
        law, error, surprise, wanted = (
            regulator(RegulatorTuning()),
            np.zeros(SIZE),
            np.zeros(SIZE),
            [],
        )
        for k in range(TICKS - 1):
            made = law.step(k, error, np.zeros(3))
            wanted.append(made.input)
            law.note(k, made.mpc_state, np.zeros(3))
            surprise[:7] = memory * surprise[:7]
            surprise[:2] += 0.01 * math.sqrt(1.0 - memory**2) * generator.normal(size=2)
            error = a[k] @ error + surprise
        sizes[memory] = np.sqrt(np.mean(np.square(wanted), axis=0))
    assert np.all(sizes[0.0] < 0.4 * sizes[0.8])


def test_nominal_state_of_the_tube_starts_anew_where_the_law_is_exhausted():
    law, far = regulator(TUBE), np.zeros(SIZE)
    law.note(0, far.copy(), np.zeros(3))
    far[1] = 3.0
    made = law.step(1, far, np.zeros(3))
    assert "exhausted" in made.fallback
    np.testing.assert_array_equal(made.mpc_state, far)
    np.testing.assert_array_equal(made.input, 0.0)


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
        RegulatorTuning(**arguments)
