"""Zero-order hold: the matrix exponential, whatever the number of samples."""

import numpy as np
from scipy.linalg import expm

from ttempc.models.linear import zero_order_hold

PERIOD_S = 0.2


def test_every_sample_of_a_long_series_is_the_exponential_of_its_own():
    generator = np.random.default_rng(1)
    a, b = generator.normal(size=(1100, 5, 5)), generator.normal(size=(1100, 5, 2))
    a_d, b_d = zero_order_hold(a, b, PERIOD_S)
    for k in (0, 511, 512, 1023, 1024, 1099):
        block = np.zeros((7, 7))
        block[:5] = PERIOD_S * np.hstack([a[k], b[k]])
        exact = expm(block)[:5]
        assert np.abs(np.hstack([a_d[k], b_d[k]]) - exact).max() < 1e-14


def test_no_sample_gives_no_matrix():
    a_d, b_d = zero_order_hold(np.empty((0, 3, 3)), np.empty((0, 3, 1)), PERIOD_S)
    assert (a_d.shape, b_d.shape) == ((0, 3, 3), (0, 3, 1))
