"""Conformal calibration: its coverage in closed form, ties, lost runs, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import beta, kstest

from ttempc.errors import InvalidTube
from ttempc.tube.conformal import calibrate, fewest_scores, largest_score


@pytest.fixture
def generator():
    return np.random.default_rng(11)


@pytest.mark.parametrize(("count", "coverage"), [(19, 0.95), (40, 0.95), (30, 0.5), (7, 0.8)])
def test_the_coverage_given_a_calibration_has_a_beta_distribution(count, coverage, generator):
    """Of uniform scores, the coverage of a calibration is its factor itself."""
    drawn = [calibrate(scores, coverage) for scores in generator.uniform(size=(2000, count))]
    rank = drawn[0].rank
    factors = [one.factor for one in drawn]
    assert kstest(factors, beta(rank, count + 1 - rank).cdf).pvalue > 0.01
    assert coverage <= drawn[0].coverage < coverage + 1.0 / (count + 1)
    low, high = drawn[0].coverage_interval(0.9)
    assert np.mean([low <= factor <= high for factor in factors]) == pytest.approx(0.9, abs=0.02)


def test_the_next_run_is_inside_as_often_as_promised_whatever_the_distribution(generator):
    """Heavy-tailed random walks, each of a heavy-tailed size of its own."""
    inside = []
    for _ in range(400):
        size = generator.pareto(1.5, (30, 1, 1)) + 0.1
        walks = np.cumsum(size * generator.standard_t(3, (30, 40, 2)), axis=1)
        *scores, fresh = [largest_score(walk, np.array([1.0, 2.0])) for walk in walks]
        calibration = calibrate(scores, 0.9)
        inside.append(fresh <= calibration.factor)
    assert calibration.coverage == 0.9
    assert np.mean(inside) == pytest.approx(0.9, abs=0.045)  # three standard deviations


def test_ties_raise_the_coverage(generator):
    rounded = generator.integers(0, 3, (2000, 20)).astype(float)
    inside = [row[-1] <= calibrate(row[:-1], 0.6).factor for row in rounded]
    assert np.mean(inside) > 0.62


def test_a_lost_run_counts_as_outside_of_everything():
    assert calibrate([1.0, np.inf, 2.0, 3.0], 0.6).factor == 3.0
    assert calibrate([1.0, np.inf, 2.0, 3.0], 0.8).factor == np.inf


def test_the_order_of_the_runs_has_no_effect_and_the_unit_scales_the_factor(generator):
    scores = generator.exponential(size=25)
    assert calibrate(scores, 0.9) == calibrate(generator.permutation(scores), 0.9)
    assert calibrate(3.0 * scores, 0.9).factor == pytest.approx(3.0 * calibrate(scores, 0.9).factor)


def test_a_score_is_that_of_the_worst_time_and_quantity():
    deviation = np.array([[0.1, -0.4], [-0.3, 0.2]])
    assert largest_score(deviation, np.array([0.1, 0.2])) == pytest.approx(3.0)
    along = np.array([[0.1, 0.1], [0.3, 0.1]])  # of a tube that widens
    assert largest_score(deviation, along) == pytest.approx(4.0)


@pytest.mark.parametrize("coverage", [0.5, 0.6, 0.9, 0.95, 0.99, 0.999])
def test_fewest_scores_are_enough_and_one_less_is_refused(coverage):
    fewest = fewest_scores(coverage)
    assert calibrate(np.arange(fewest), coverage).rank == fewest
    if fewest > 1:
        with pytest.raises(
            InvalidTube, match=rf"got {fewest - 1} scores.* takes {fewest} at least"
        ):
            calibrate(np.arange(fewest - 1), coverage)


@pytest.mark.parametrize("coverage", [0.0, 1.0, -1.0, np.nan])
def test_impossible_coverages_are_refused(coverage):
    with pytest.raises(InvalidTube, match="must be between 0 and 1"):
        calibrate([1.0, 2.0], coverage)


def test_bad_scores_and_scales_are_refused():
    with pytest.raises(InvalidTube, match="not NaN"):
        calibrate([1.0, np.nan], 0.5)
    with pytest.raises(InvalidTube, match=r"scale: .* must be above 0"):
        largest_score(np.ones((3, 2)), np.array([1.0, 0.0]))
    with pytest.raises(InvalidTube, match="must be finite and not empty"):
        largest_score(np.array([[np.nan]]), np.array([1.0]))
