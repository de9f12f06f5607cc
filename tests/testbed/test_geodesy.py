"""The map frame and UTM: published values, exact inverses, the antimeridian and the south."""

import numpy as np
import pytest
from proving_ground.testbed.geodesy import MapFrame, middle_deg, utm_degrees


@pytest.mark.parametrize(
    ("latitude_deg", "latitude_length_m", "longitude_length_m"),
    [(0.0, 110574.0, 111320.0), (45.0, 111132.0, 78847.0), (60.0, 111412.0, 55800.0)],
)
def test_lengths_of_a_degree_are_the_published_ones(
    latitude_deg, latitude_length_m, longitude_length_m
):
    """Lengths of a degree on WGS 84, rounded to a metre, as tables of the ellipsoid print them."""
    frame = MapFrame((latitude_deg, 0.0))
    north, east = 1.0 / (frame.degrees(np.ones(2)) - (latitude_deg, 0.0))
    assert north == pytest.approx(latitude_length_m, abs=1.0)
    assert east == pytest.approx(longitude_length_m, abs=1.0)


@pytest.mark.parametrize(
    "origin_deg", [(50.86, 4.68), (-37.0, 179.9999), (0.0, 0.0), (80.0, -120.0), (-89.9999, 10.0)]
)
def test_metres_to_degrees_and_back_is_the_same_point_a_kilometre_away(origin_deg):
    frame = MapFrame(origin_deg)
    points = np.random.default_rng(3).uniform(-1000.0, 1000.0, (200, 2))
    back = frame.points(*frame.degrees(points).T)
    np.testing.assert_allclose(back, points, atol=1e-7)


def test_a_point_of_a_field_in_minnesota_lies_where_proj_has_it():
    """PROJ 9.5: +proj=cart, then +proj=topocentric, of (44.973, -93.255) about (44.97, -93.26)."""
    point = MapFrame((44.97, -93.26)).points(44.973, -93.255)
    np.testing.assert_allclose(point, PROJ_TOPOCENTRIC_M, atol=1e-5)


PROJ_TOPOCENTRIC_M = (394.41929, 333.40582)

# Zone, hemisphere, easting, northing [m] and latitude, longitude [deg]. The first row is the
# example in the manual of GeographicLib's GeoConvert, to 1 cm; the others are of PROJ 9.5 (cs2cs).
UTM = [
    (38, "N", 444140.54, 3684706.36, 33.3, 44.4, 7e-3),
    (31, "N", 618235.9061, 5635601.1786, 50.86, 4.68, 1e-4),
    (15, "N", 479497.3320, 4979650.6661, 44.97, -93.26, 1e-4),
    (60, "S", 818052.3271, 8029394.4793, -17.8, 179.9999, 1e-4),
    (1, "S", 181947.6729, 8029394.4793, -17.8, -179.9999, 1e-4),
]


@pytest.mark.parametrize("row", UTM)
def test_utm_coordinates_are_the_published_ones(row):
    zone, hemisphere, easting, northing, latitude, longitude, accuracy_m = row
    place = utm_degrees(np.array([easting, northing]), zone, south=hemisphere == "S")
    offset = MapFrame((latitude, longitude)).points(*place)
    np.testing.assert_allclose(offset, 0.0, atol=accuracy_m)


def test_a_millimetre_of_utm_is_a_millimetre_of_the_map():
    places = np.array([[597_000.0, 5_635_000.0], [597_000.001, 5_635_000.0]])
    points = MapFrame().points(*utm_degrees(places, 31, south=False).T)
    length_m = np.hypot(*(points[1] - points[0]))
    assert length_m == pytest.approx(1e-3, abs=1e-6)  # the scale of UTM is 4e-4 off


def test_the_middle_of_points_on_both_sides_of_180_degrees_lies_between_them():
    latitude, longitude = middle_deg(np.array([-17.0, -17.2]), np.array([179.9, -179.9]))
    assert latitude == pytest.approx(-17.1)
    assert abs(longitude) == pytest.approx(180.0)
