"""Robust law of the paper: saturation, derivative, and both nominal readings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.ttempc.horizons import stages
from ttempc.baselines.paper import NominalState, RobustGains, RobustLaw
from ttempc.errors import InvalidTuning
from ttempc.models.kinematics import Error

PERIOD_S = 0.2


def law(sign=-1):
    return RobustLaw(RobustGains(), sign, PERIOD_S)


def test_action_never_leaves_its_saturation_and_z_m_its_set():
    generator = np.random.default_rng(31)
    robust = law()
    for k in range(300):
        nominal, error = 10.0 ** generator.uniform(-3, 2) * generator.normal(size=(2, 7))
        u_m, z_m = robust.step(k, nominal, error)
        assert np.all(np.abs(u_m) <= RobustGains().saturation)
        assert np.all(np.abs(z_m) <= 1.0)


def test_law_is_the_printed_one():
    robust, zero = law(sign=1), np.zeros(7)
    first = np.array([0.01, 0.02, 0.0, 0.03, 0.04, 0.0, 0.0])
    robust.step(0, first, zero)
    second = np.array([0.02, 0.01, 0.0, 0.03, 0.05, 0.0, 0.0])
    u_m, z_m = robust.step(1, second, zero)
    np.testing.assert_allclose(z_m, [0.02, 0.01, 0.03, 0.05])
    assert u_m[0] == pytest.approx(0.2 * math.tanh(2 * 0.01 + 4 * -0.05))  # y of the tractor
    assert u_m[1] == pytest.approx(0.1 * math.tanh(1 * 0.05 + 2 * 0.05))  # y of the trailer
    assert u_m[2] == pytest.approx(0.1 * math.tanh(10 * 0.02 + 20 * 0.05))  # x of the tractor


def test_sign_turns_the_action_round():
    error = np.array([0.01, 0.02, 0.0, 0.03, 0.04, 0.0, 0.0])
    forward, _ = law(sign=1).step(0, np.zeros(7), error)
    backward, _ = law(sign=-1).step(0, np.zeros(7), error)
    np.testing.assert_array_equal(forward, -backward)


def test_derivative_is_zero_at_the_start_and_after_a_missed_tick():
    robust, error = law(), np.zeros(7)
    error[Error.Y_T] = 0.1
    expected = 0.2 * math.tanh(2 * 0.1)
    assert robust.step(0, np.zeros(7), error)[0][0] == pytest.approx(expected)
    robust.step(1, np.zeros(7), np.zeros(7))
    assert robust.step(3, np.zeros(7), error)[0][0] == pytest.approx(expected)


@pytest.mark.parametrize("reading", ["one-step", "tube"])
def test_nominal_state_is_the_linear_model(reading):
    a, b = stages()
    nominal = NominalState(a, b, reading)
    generator = np.random.default_rng(32)
    measured = generator.normal(size=(4, 7))
    inputs = generator.normal(size=(4, 3))
    expected = measured[0]
    for k in range(4):
        state = nominal.at(k, measured[k])
        np.testing.assert_allclose(state, expected, atol=1e-12)
        base = nominal.mpc_state(state, measured[k])
        np.testing.assert_array_equal(base, state if reading == "tube" else measured[k])
        nominal.advance(k, base, inputs[k])
        expected = a[k] @ base + b[k] @ inputs[k]


def test_nominal_state_starts_again_after_a_missed_tick():
    a, b = stages()
    nominal = NominalState(a, b, "tube")
    nominal.advance(0, np.ones(7), np.zeros(3))
    np.testing.assert_array_equal(nominal.at(2, np.full(7, 0.5)), np.full(7, 0.5))


def test_gains_must_be_positive():
    with pytest.raises(InvalidTuning, match="proportional"):
        RobustGains(proportional=(1.0, 0.0, 1.0))
