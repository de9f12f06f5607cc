"""Estimates over runs: coverage of their intervals, closed forms, invariance to order."""

import numpy as np
import pytest
from proving_ground.experiments.results.statistics import (
    cvar95,
    fewest_samples,
    holm,
    mean,
    paired_p,
    proportion,
    rate,
)
from scipy.stats import ttest_1samp


def covered(estimates, truth):
    return np.mean([found.low <= truth <= found.high for found in estimates])


def test_the_interval_of_a_mean_is_students_over_units_of_equal_size():
    values = np.random.default_rng(8).gamma(2.0, size=(5, 6))
    found = mean(values.ravel(), np.repeat(np.arange(5), 6))
    by_unit = ttest_1samp(values.mean(axis=1), 0.0).confidence_interval(0.95)
    np.testing.assert_allclose([found.low, found.high], by_unit)
    assert found.value == pytest.approx(values.mean())


def test_the_paired_p_value_is_that_of_students_test():
    values = np.random.default_rng(9).normal(0.5, 1.0, 7)
    assert paired_p(values) == pytest.approx(ttest_1samp(values, 0.0).pvalue)
    assert (paired_p(np.zeros(4)), paired_p(np.ones(4))) == (1.0, 0.0)
    assert np.isnan(paired_p(np.ones(1)))


def test_holm_rejects_as_its_steps_do_and_keeps_the_error_of_the_family():
    assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]).tolist() == [1.0, 1.0]
    uniform = np.random.default_rng(10).uniform(size=(2000, 12))
    families = np.mean([holm(family).min() < 0.05 for family in uniform])
    assert families == pytest.approx(0.05, abs=0.015)


def test_the_worst_five_percent_are_the_mean_of_the_largest():
    values = np.random.default_rng(3).normal(size=300)
    once = np.ones((1, 300))
    assert cvar95(values, once)[0] == pytest.approx(np.sort(values)[-15:].mean())
    assert cvar95(values[:1], once[:, :1])[0] == pytest.approx(values[0])


@pytest.mark.parametrize("probability", [0.05, 0.3, 0.5])
def test_the_interval_of_a_share_covers_it_at_least_as_often_as_it_says(probability):
    hits = np.random.default_rng(7).binomial(20, probability, 1000)
    known = {int(k): proportion(int(k), 20) for k in set(hits)}
    assert covered([known[int(k)] for k in hits], probability) >= 0.95


def test_proportions_have_the_published_intervals():
    found = proportion(90, 100)  # tables of Clopper and Pearson
    assert (round(found.low, 4), round(found.high, 4)) == (0.8238, 0.9510)
    assert proportion(0, 0).ends == (0.0, 1.0)


def test_rates_have_the_published_intervals():
    found = rate(10, 2.0)  # table of Garwood (1936): 4.795 to 18.390 for 10 events
    assert found.value == 5.0
    assert found.ends == pytest.approx((4.795 / 2.0, 18.390 / 2.0), abs=5e-4)
    assert rate(0, 1.0).ends == pytest.approx((0.0, 3.689), abs=5e-4)


def test_the_largest_of_the_fewest_samples_bounds_the_quantile():
    assert fewest_samples(0.99, 0.95) == 299  # Wilks (1941)
    for coverage in (0.5, 0.9, 0.999):
        samples = fewest_samples(coverage)
        assert coverage**samples <= 0.05 < coverage ** (samples - 1)
