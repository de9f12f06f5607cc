"""Error processes: stated deviation, autocorrelation, tails."""

import numpy as np
import pytest
from proving_ground.testbed.sensing.sensor_errors import Correlated, HeavyTailed, White
from scipy.stats import kurtosis

SD = np.array([0.03, 0.05])
N = 20_000


def samples(source):
    return np.concatenate([source.errors(n) for n in (1, 2, 60, 7, N - 70)])


def correlated(white_share, correlation_time=2.0, seed=1):
    rngs = (np.random.default_rng([seed, part]) for part in range(2))
    return Correlated(SD, white_share, correlation_time, 0.2, *rngs)


def test_a_bias_is_the_mean_and_noise_lies_around_it():
    errors = samples(White(SD, np.random.default_rng(1), np.array([0.5, -0.2])))
    assert (np.abs(errors.mean(axis=0) - [0.5, -0.2]) < 4 * SD / np.sqrt(N)).all()
    np.testing.assert_allclose(errors.std(axis=0), SD, rtol=4 / np.sqrt(2 * N))


@pytest.mark.parametrize("white_share", [0.0, 0.3])
def test_autocorrelation_of_the_slow_part_is_exponential(white_share):
    """Within four deviations of Bartlett's formula for a first-order process."""
    errors = samples(correlated(white_share))
    correlation = np.exp(-0.2 / 2.0)
    for lag in (1, 5, 10, 20):
        expected = (1.0 - white_share) * correlation**lag
        independent = N * (1.0 - correlation**2) / (1.0 + correlation**2)
        for column in errors.T:
            rho = np.mean(column[:-lag] * column[lag:]) / np.mean(column**2)
            assert abs(rho - expected) < 4 / np.sqrt(independent)


@pytest.mark.parametrize("white_share", [0.0, 0.1, 1.0])
def test_both_parts_together_have_the_stated_deviation_from_the_first_sample_on(white_share):
    first = np.array([correlated(white_share, seed=seed).errors(1)[0] for seed in range(1000)])
    np.testing.assert_allclose(first.std(axis=0), SD, rtol=4 / np.sqrt(2 * len(first)))
    assert samples(correlated(white_share)).std(axis=0) == pytest.approx(SD, rel=0.1)


class Even:
    """A generator of shares that cover [0, 1) evenly, and of ones for normal numbers."""

    def __init__(self, count):
        self._shares = iter((np.arange(count) + 0.5) / count)

    def random(self):
        return next(self._shares)

    def standard_normal(self, size):
        return np.ones(size)


def test_both_components_together_have_the_stated_deviation():
    """Exactly: a mean over a sample of the size that a test can draw misses 3 %."""
    errors = HeavyTailed(SD, Even(1000)).errors(1000)
    np.testing.assert_allclose(np.sqrt(np.mean(errors**2, axis=0)), SD, rtol=1e-12)


def test_heavy_tails_have_the_stated_deviation_and_kurtosis():
    """The bands are four deviations of the sample moments, from the mixture's own moments."""
    errors = samples(HeavyTailed(SD, np.random.default_rng(2)))
    good = 1.0 / np.sqrt(1.8)  # deviation of the good component where the mixture has 1
    moments = {k: f * (0.9 + 0.1 * 3.0**k) * good**k for k, f in ((4, 3), (6, 15), (8, 105))}
    kurtosis_sd = np.sqrt((moments[8] - moments[4] ** 2) / N)
    assert moments[4] - 3.0 == pytest.approx(5.33, abs=0.005)  # as the docstring says
    for column, sd in zip(errors.T, SD, strict=True):
        assert column.std() == pytest.approx(sd, rel=4 * np.sqrt((moments[4] - 1.0) / N) / 2)
        assert abs(kurtosis(column) - (moments[4] - 3.0)) < 4 * kurtosis_sd
        assert abs(np.corrcoef(column[:-1], column[1:])[0, 1]) < 4 / np.sqrt(N)
