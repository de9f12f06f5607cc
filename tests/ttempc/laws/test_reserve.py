"""Reserve of the trailer's steering by what is known of its side slip."""

import numpy as np
import pytest

from ttempc.laws.reserve import SteeringReserve
from ttempc.mpc.condensing import StageBounds


@pytest.mark.parametrize("known", [0.0, 0.5, 0.84, 1.0])
def test_half_width_of_the_tube_is_that_of_the_unknown_variance(known):
    """Bounds are limits less the half width of a tube; other rows stay as they are."""
    limit = np.full((3, 4), 0.4)
    width = np.array([[0.1], [0.2], [0.3]]) * np.ones(4)
    relaxed = StageBounds(-limit, limit, -limit, limit)
    reserved = StageBounds(width - limit, limit - width, -limit, limit)
    bounds = StageBounds(*(values.copy() for values in reserved))
    SteeringReserve(reserved, relaxed).write(1, known, bounds)

    unknown_width = limit[1] - bounds.upper[1]
    np.testing.assert_allclose(unknown_width**2, (1.0 - known) * width[1] ** 2, atol=1e-15)
    np.testing.assert_array_equal(bounds.lower, -bounds.upper)
    np.testing.assert_array_equal(bounds.step_upper, limit)
    np.testing.assert_array_equal(bounds.upper[::2], reserved.upper[::2])
