"""Gates of the filter against the distribution of chi-square."""

import pytest
from scipy.stats import chi2

from ttempc.estimation.filter.records import chi_square_limit
from ttempc.learning.learner import LENGTHS
from ttempc.learning.lengths import _REJECTED


@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("probability", [1e-8, 1e-4, 0.05, 0.5])
def test_a_limit_is_exceeded_with_its_probability(size, probability):
    assert chi2.sf(chi_square_limit(size, probability), size) == pytest.approx(probability)


def test_lengths_are_rejected_with_one_per_cent():
    assert chi2.sf(_REJECTED, len(LENGTHS)) == pytest.approx(0.01)
