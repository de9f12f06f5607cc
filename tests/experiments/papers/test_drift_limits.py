"""Limits that the largest statistics of drives exceed as often as asked."""

import numpy as np
import pytest
from proving_ground.experiments.papers.studies.drift import gumbel_limit, joint_limits

DRAWS = 40_000


@pytest.mark.parametrize("probability", [0.02, 0.2])
def test_a_gumbel_variable_exceeds_its_limit_with_the_probability(probability):
    largest = np.random.default_rng(1).gumbel(5.0, 2.0, DRAWS)
    exceeded = np.mean(largest > gumbel_limit(largest, probability))
    assert exceeded == pytest.approx(probability, rel=0.1)


def test_any_of_several_limits_is_exceeded_with_the_probability_and_each_alike():
    scales = np.array([0.5, 1.0, 3.0])
    largest = np.random.default_rng(2).gumbel(6.0 * scales, scales, (DRAWS, 3))
    exceeds = largest > joint_limits(largest, 0.03)
    assert np.mean(exceeds.any(axis=1)) == pytest.approx(0.03, rel=0.25)
    assert np.ptp(exceeds.mean(axis=0)) < 0.006
