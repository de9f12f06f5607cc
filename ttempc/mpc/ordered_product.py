"""Product of a matrix and a vector, summed in index order."""

from __future__ import annotations

import numpy as np

from ..types import FloatArray


def ordered_product(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return `matrix` (m, n) times `vector` (n,), (m,).

    Each entry is summed from the first column to the last: `cumsum` is sequential. The order in
    which `matrix @ vector` sums, and with it the last digit, depends on the BLAS build.
    """
    return np.cumsum(matrix * vector, axis=-1)[..., -1]
