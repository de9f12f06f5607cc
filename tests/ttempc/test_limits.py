"""Limits of commands in amplitude and rate."""

from __future__ import annotations

import numpy as np

from ttempc.vehicle import CommandLimits, Vehicle

VEHICLE = Vehicle()
LIMITS = CommandLimits.of(VEHICLE, 0.2)


def random_command(generator):
    """Return entries of any size, a tenth of them not finite."""
    desired = 10.0 ** generator.uniform(-3, 3, size=3) * generator.normal(size=3)
    invalid = generator.uniform(size=3) < 0.1
    return np.where(invalid, generator.choice([np.nan, np.inf, -np.inf], size=3), desired)


def test_amplitude_and_rate_hold_for_any_command():
    generator = np.random.default_rng(41)
    previous = np.array([0.0, 0.0, 0.7])
    for _ in range(2000):
        desired = random_command(generator)
        allowed, limited = LIMITS.apply(desired, previous)
        assert np.all(np.isfinite(allowed))
        assert np.all(VEHICLE.input_min <= allowed)
        assert np.all(allowed <= VEHICLE.input_max)
        assert np.all(np.abs(allowed - previous) <= VEHICLE.input_rate * 0.2 + 1e-12)
        np.testing.assert_array_equal(limited, ~(allowed == desired))
        previous = allowed


def test_a_law_that_ends_at_a_limit_by_itself_is_held_by_it():
    previous = np.array([0.1, -0.1, 0.5])
    for sign in (-1.0, 1.0):
        edge = np.clip(previous + sign * LIMITS.step, LIMITS.lower, LIMITS.upper)
        allowed, changed = LIMITS.apply(edge, previous)
        assert not changed.any()
        assert LIMITS.holds(allowed, previous).all()
        assert not LIMITS.holds(0.5 * (previous + edge), previous).any()
