"""A product of a matrix and a vector in a fixed order of summation."""

from __future__ import annotations

import math

import numpy as np

from ttempc.models.linear import ordered_product

GENERATOR_SEED = 41


def test_it_is_the_product():
    generator = np.random.default_rng(GENERATOR_SEED)
    matrix, vector = generator.normal(size=(12, 19)), generator.normal(size=19)
    exact = [math.fsum(row * vector) for row in matrix]
    np.testing.assert_allclose(ordered_product(matrix, vector), exact, rtol=0, atol=1e-14)


def test_it_sums_from_the_first_column_to_the_last():
    """In any other order the small terms survive, or the large ones do not cancel."""
    matrix = np.array([[1e16, 1.0, -1e16, 1.0], [1e16, -1e16, 1.0, 1.0]])
    np.testing.assert_array_equal(ordered_product(matrix, np.ones(4)), [1.0, 2.0])


def test_the_layout_of_the_matrix_changes_no_bit():
    generator = np.random.default_rng(GENERATOR_SEED)
    matrix, vector = generator.normal(size=(12, 19)), generator.normal(size=19)
    np.testing.assert_array_equal(
        ordered_product(matrix, vector), ordered_product(np.asfortranarray(matrix), vector)
    )
