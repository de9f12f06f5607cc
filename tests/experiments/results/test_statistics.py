"""Estimates over runs: coverage of their intervals, closed forms, invariance to order."""

import numpy as np
import pytest
from scipy.stats import beta

from proving_ground.experiments.results.statistics import (
    bootstrap,
    cvar95,
    fewest_samples,
    mean,
    pair,
    proportion,
    quantile95,
    survival,
)


def covered(estimates, truth):
    return np.mean([found.low <= truth <= found.high for found in estimates])


@pytest.mark.parametrize("count", [5, 8, 30])
def test_the_interval_of_a_mean_covers_it_as_often_as_it_says(count):
    generator = np.random.default_rng(count)
    found = [bootstrap(generator.normal(3.0, 1.0, count)) for _ in range(400)]
    # three standard deviations of a share of 0.95 in 400 trials, and what few samples still miss
    assert 0.917 - (0.03 if count == 5 else 0.0) <= covered(found, 3.0) <= 0.983


def test_samples_of_one_unit_are_no_independent_samples():
    generator = np.random.default_rng(2)
    units = np.repeat(np.arange(10), 6)
    shared = [
        generator.normal(0.0, 1.0, 10)[units] + generator.normal(0.0, 0.3, 60) for _ in range(150)
    ]
    assert covered([bootstrap(values, units) for values in shared], 0.0) >= 0.9
    assert covered([bootstrap(values) for values in shared], 0.0) < 0.75


@pytest.mark.parametrize("statistic", [mean, quantile95, cvar95])
def test_an_interval_does_not_depend_on_the_order_of_the_samples(statistic):
    generator = np.random.default_rng(3)
    values, units = generator.gamma(2.0, size=60), np.repeat(np.arange(6), 10)
    other = generator.permutation(60)
    here, there = (
        bootstrap(values[order], units[order], statistic) for order in (np.arange(60), other)
    )
    assert here == there
    assert here.low <= here.value <= here.high


@pytest.mark.parametrize("statistic", [mean, quantile95, cvar95])
def test_a_statistic_moves_and_grows_with_its_samples(statistic):
    values = np.random.default_rng(4).gamma(2.0, size=40)
    plain, moved = bootstrap(values, None, statistic), bootstrap(3 * values + 7, None, statistic)
    ends = np.array([plain.value, plain.low, plain.high])
    np.testing.assert_allclose([moved.value, moved.low, moved.high], 3 * ends + 7)


@pytest.mark.parametrize("statistic", [mean, quantile95, cvar95])
def test_a_sample_that_counts_twice_is_the_same_as_two(statistic):
    generator = np.random.default_rng(5)
    values, weights = generator.normal(size=25), generator.integers(0, 4, 25)
    assert statistic(values, weights[np.newaxis].astype(float))[0] == pytest.approx(
        statistic(np.repeat(values, weights), np.ones((1, weights.sum())))[0]
    )


@pytest.mark.parametrize("count", [1, 2, 19, 20, 21, 300])
def test_the_worst_five_percent_are_worse_than_the_quantile_and_no_worse_than_the_worst(count):
    values = np.random.default_rng(count).normal(size=count)
    once = np.ones((1, count))
    quantile, tail = quantile95(values, once)[0], cvar95(values, once)[0]
    assert quantile <= tail <= values.max()
    assert np.mean(values <= quantile) >= 0.95
    assert np.mean(values < quantile) < 0.95
    if count == 300:
        assert tail == pytest.approx(np.sort(values)[-15:].mean())


def test_differences_of_equal_runs_are_none_and_one_sample_has_no_interval():
    equal = bootstrap(np.zeros(9))
    assert (equal.value, equal.low, equal.high) == (0.0, 0.0, 0.0)
    alone = bootstrap(np.array([2.0, 3.0]), np.array([7, 7]))
    assert (alone.value, alone.low, alone.high) == (2.5, None, None)
    assert alone.ends == (2.5, 2.5)


def test_pairing_takes_out_what_runs_share():
    generator = np.random.default_rng(6)
    ground = generator.normal(20.0, 10.0, 12)
    keys, others = generator.permutation(12), generator.permutation(14)
    mine, theirs = ground[keys] + 1.0, np.append(ground, [0.0, 0.0])[others]
    here, there = pair(keys, others)
    difference = bootstrap(mine[here] - theirs[there])
    np.testing.assert_allclose([difference.value, difference.low, difference.high], 1.0)
    assert len(here) == 12


@pytest.mark.parametrize("count", [1, 5, 14, 100])
def test_no_failure_and_nothing_but_failures_have_clopper_and_pearsons_closed_forms(count):
    none, all_ = proportion(0, count), proportion(count, count)
    assert (none.low, all_.high) == (0.0, 1.0)
    assert none.high == pytest.approx(1.0 - 0.025 ** (1.0 / count))
    assert all_.low == pytest.approx(0.025 ** (1.0 / count))


@pytest.mark.parametrize("probability", [0.05, 0.3, 0.5])
def test_the_interval_of_a_share_covers_it_at_least_as_often_as_it_says(probability):
    hits = np.random.default_rng(7).binomial(20, probability, 1000)
    known = {int(k): proportion(int(k), 20) for k in set(hits)}
    assert covered([known[int(k)] for k in hits], probability) >= 0.95
    found = proportion(6, 20)
    assert found.low == pytest.approx(beta.ppf(0.025, 6, 15))
    assert found.high == pytest.approx(beta.ppf(0.975, 7, 14))


def test_survival_falls_to_the_share_of_those_that_failed():
    values, above = survival(np.array([3.0, 1.0, 2.0]), worse=1)
    assert values.tolist() == [1.0, 2.0, 3.0]
    assert above.tolist() == [0.75, 0.5, 0.25]
    assert survival(np.array([1.0, 2.0]))[1][-1] == 0.0


def test_proportions_have_the_published_intervals_and_refuse_more_than_all():
    found = proportion(90, 100)  # tables of Clopper and Pearson
    assert (round(found.low, 4), round(found.high, 4)) == (0.8238, 0.9510)
    assert proportion(0, 0).ends == (0.0, 1.0)
    with pytest.raises(ValueError, match="from 0 to 2, got 3"):
        proportion(3, 2)


def test_the_largest_of_the_fewest_samples_bounds_the_quantile():
    assert fewest_samples(0.99, 0.95) == 299  # Wilks (1941)
    for coverage in (0.5, 0.9, 0.999):
        samples = fewest_samples(coverage)
        assert coverage**samples <= 0.05 < coverage ** (samples - 1)
