"""Roots in a bracket: those of scipy, bit for bit."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from proving_ground.testbed.root import bracketed_root


@pytest.mark.parametrize(
    ("function", "low", "high"),
    [
        (lambda x: x * x - 2.0, 0.0, 2.0),
        (lambda x: math.cos(x) - x, 0.0, 1.0),
        (lambda x: math.exp(30.0 * x) - 2.0, -1.0, 1.0),
        (lambda x: 1e-20 if x > 0.123 else -1.0, 0.0, 0.9),
        (lambda x: math.atan(1e4 * (x - 0.7)), 1.0, 0.0),
    ],
)
def test_roots_are_those_of_scipy(function, low, high):
    assert bracketed_root(function, low, high) == brentq(function, low, high)


def test_roots_of_random_cubics_are_those_of_scipy():
    for a, b, c in np.random.default_rng(3).normal(size=(300, 3)):

        def cubic(x, a=a, b=b, c=c):
            return ((x + a) * x + b) * x + c

        assert bracketed_root(cubic, -9.0, 9.0) == brentq(cubic, -9.0, 9.0)


def test_a_root_at_an_end_is_returned():
    assert bracketed_root(lambda x: x, 0.0, 1.0) == 0.0
    assert bracketed_root(lambda x: x - 1.0, 0.0, 1.0) == 1.0


def test_a_function_of_one_sign_is_refused():
    with pytest.raises(ValueError, match="no change of sign between 1 and 2"):
        bracketed_root(lambda x: x, 1.0, 2.0)


def test_a_triple_root_is_refused_as_by_scipy():
    def cube(x):
        return (x - 0.3) ** 3

    with pytest.raises(RuntimeError):
        brentq(cube, -1.0, 2.0)
    with pytest.raises(ValueError, match="no root within 100 steps"):
        bracketed_root(cube, -1.0, 2.0)
