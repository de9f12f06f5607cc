"""Tools of detectors against numpy and closed forms."""

import numpy as np
import pytest

from ttempc.detectors.history import cusum, mean_in_span, median, remember, sums


@pytest.mark.parametrize("count", [1, 2, 3, 10, 15, 21])
def test_the_median_is_that_of_numpy(count):
    rng = np.random.default_rng(count)
    for values in (rng.normal(size=count), rng.integers(0, 3, count).astype(float)):
        assert median(values.copy(), count) == np.median(values)


def test_a_full_history_loses_its_oldest_entry_and_a_short_one_what_is_too_old():
    history = np.zeros((1 + 4, 3))
    for n in range(6):
        count = remember(history, -np.inf, float(n), 10.0 * n, 1.0)
    assert count == 4
    np.testing.assert_array_equal(history[1:, 0], [2.0, 3.0, 4.0, 5.0])
    assert sums(history) == (140.0, 4.0)
    assert mean_in_span(history, 3.0, 4.0) == 35.0
    assert np.isnan(mean_in_span(history, 7.0, 9.0))
    assert remember(history, 3.5, np.nan, 0.0, 0.0) == 2
    np.testing.assert_array_equal(history[1:3, 0], [4.0, 5.0])


def test_a_cumulative_sum_grows_by_what_is_above_the_allowance_and_saturates():
    total = 0.0
    for _ in range(4):
        total = cusum(total, 0.5, 0.2, 1.0)
    assert total == pytest.approx(4 * 0.3)
    for _ in range(4):
        total = cusum(total, 0.5, 0.2, 1.0)
    assert total == 1.5
    for _ in range(10):
        total = cusum(total, 0.0, 0.2, 1.0)
    assert total == 0.0
