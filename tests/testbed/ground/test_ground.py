"""Ground: cone index of the nearest grid point."""

import numpy as np
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.terrain import Terrain


def test_the_cone_index_is_that_of_the_nearest_point_and_of_the_border_beyond():
    strength = np.arange(12.0).reshape(3, 4)  # rows along y, columns along x
    ground = Ground(Terrain(np.zeros((3, 4)), 0.5, (10.0, -1.0)), strength)
    x = np.array([10.0, 10.24, 10.26, 11.5, 99.0, -99.0])
    y = np.array([-1.0, -0.76, -0.74, 0.0, 99.0, -99.0])
    expected = strength[[0, 0, 1, 2, 2, 0], [0, 0, 1, 3, 3, 0]]
    np.testing.assert_array_equal(ground.cone_index_at(x, y), expected)
