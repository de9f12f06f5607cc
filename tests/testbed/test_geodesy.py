"""Both conversions of the WGS 84 module agree, and lengths of a degree are the published ones."""

import numpy as np
import pytest
from proving_ground.testbed.geodesy import ORIGIN_DEG, degrees, east_north


@pytest.mark.parametrize(
    ("latitude_deg", "latitude_length_m", "longitude_length_m"),
    [(0.0, 110574.0, 111320.0), (45.0, 111132.0, 78847.0), (60.0, 111412.0, 55800.0)],
)
def test_lengths_of_a_degree_are_the_published_ones(
    latitude_deg, latitude_length_m, longitude_length_m
):
    """Lengths of a degree on WGS 84, rounded to a metre, as tables of the ellipsoid print them."""
    north, east = 1.0 / (degrees(np.ones(2), (latitude_deg, 0.0)) - (latitude_deg, 0.0))
    assert north == pytest.approx(latitude_length_m, abs=1.0)
    assert east == pytest.approx(longitude_length_m, abs=1.0)


@pytest.mark.parametrize(("east", "north"), [(50.0, 0.0), (-20.0, 45.0), (3.0, -50.0)])
def test_metres_to_degrees_and_back_is_the_same_point(east, north):
    back = east_north(*degrees(np.array([east, north])), ORIGIN_DEG)
    np.testing.assert_allclose(back, [east, north], atol=5e-4)  # the plane is off by 0.3 mm at 50 m
