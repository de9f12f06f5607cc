"""Subset simulation against closed forms: estimate, coverage, events that do not occur."""

import math

import numpy as np
import pytest
from proving_ground.experiments.search.subset_simulation import subset_simulation
from scipy.stats import norm


def linear(probability, dimension):
    """Return a limit state of a half space with this probability."""
    direction = np.ones(dimension) / math.sqrt(dimension)
    return lambda z: -norm.ppf(probability) - z @ direction


def repeated(limit_state, dimension, samples, times=100):
    generators = map(np.random.default_rng, range(times))
    return [subset_simulation(limit_state, dimension, samples, rng) for rng in generators]


@pytest.mark.parametrize(("dimension", "probability"), [(2, 1e-2), (5, 1e-4), (2, 1e-6)])
def test_the_interval_covers_the_probability_of_a_half_space(dimension, probability):
    results = repeated(linear(probability, dimension), dimension, samples=100)
    covered = sum(result.low <= probability <= result.high for result in results)
    assert covered >= 90  # of 100 at 95 %: fewer than 90 have a chance of 3 %
    assert np.median([result.estimate for result in results]) == pytest.approx(probability, rel=0.5)
    assert all(result.samples <= 100 * result.levels for result in results)


def test_the_estimate_converges_with_the_number_of_samples():
    results = repeated(linear(1e-3, 3), 3, samples=2000, times=10)
    assert np.mean([result.estimate for result in results]) == pytest.approx(1e-3, rel=0.1)


def test_a_ball_in_uniform_space():
    """P(all of three uniforms below 0.05) = 0.05^3, through their normal quantiles."""
    edge = norm.ppf(0.05)
    results = repeated(lambda z: z.max(axis=1) - edge, 3, samples=200)
    assert sum(result.low <= 0.05**3 <= result.high for result in results) >= 90


def test_a_frequent_event_is_counted_directly():
    result = subset_simulation(linear(0.5, 2), 2, 1000, np.random.default_rng(1))
    assert (result.levels, result.samples) == (1, 1000)
    assert result.low < 0.5 < result.high
    assert result.high - result.low < 0.2


@pytest.mark.parametrize("g", [lambda z: np.ones(len(z)), lambda z: 1.0 + np.abs(z[:, 0])])
def test_an_event_that_does_not_occur_has_an_upper_limit(g):
    result = subset_simulation(g, 2, 100, np.random.default_rng(1))
    assert result.estimate is None
    assert result.low == 0.0
    assert 0.0 < result.high < 0.05


@pytest.mark.parametrize("samples", [40, 55])
def test_too_few_samples_are_refused(samples):
    with pytest.raises(ValueError, match="multiple of 10 from 50"):
        subset_simulation(linear(0.1, 2), 2, samples, np.random.default_rng(1))
