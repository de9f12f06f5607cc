"""Nearest admissible first input."""

from __future__ import annotations

import numpy as np

from ttempc.mpc.lmpc import nearest_admissible


def test_it_is_the_point_of_both_intervals_that_is_nearest():
    generator = np.random.default_rng(31)
    for _ in range(200):
        upper, step = generator.uniform(0.1, 1.0, (2, 4, 6))
        inputs, previous = 2.0 * generator.normal(size=3), generator.uniform(-0.1, 0.1, 3)
        k = generator.integers(4)
        result = nearest_admissible(k, inputs, previous, -upper, upper, -step, step)
        grid = np.linspace(-1.0, 1.0, 4001)[:, None]
        allowed = (np.abs(grid) <= upper[k, :3]) & (np.abs(grid - previous) <= step[k, :3])
        distance = np.where(allowed, np.abs(grid - inputs), np.inf).min(axis=0)
        assert np.all(np.abs(result) <= upper[k, :3])
        assert np.all(np.abs(result - previous) <= step[k, :3] + 1e-12)
        assert np.all(np.abs(result - inputs) <= distance + 1e-12)
