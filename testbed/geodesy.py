"""Geodesy: conversions between degrees on the WGS 84 ellipsoid and metres in the map frame."""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

# World Geodetic System 1984 (NGA.STND.0036): semi-major axis and flattening of the ellipsoid.
_SEMI_MAJOR_M: Final = 6378137.0
_FLATTENING: Final = 1.0 / 298.257223563
_ECCENTRICITY_SQUARED: Final = _FLATTENING * (2.0 - _FLATTENING)


ORIGIN_DEG: Final = 50.86, 4.68
"""Latitude and longitude of the map's origin for viewers; assumed: open land near Leuven."""


def degrees(points: FloatArray, origin_deg: tuple[float, float] = ORIGIN_DEG) -> FloatArray:
    """Return latitudes and longitudes [deg] of points of the map frame (..., 2) [m].

    The field is a plane. With the ellipsoid's radii of curvature at the origin the error grows
    with the square of the distance, to 0.3 mm at 50 m.
    """
    latitude = math.radians(origin_deg[0])
    w = math.sqrt(1.0 - _ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)
    meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_SQUARED) / w**3
    parallel_m = _SEMI_MAJOR_M / w * math.cos(latitude)
    return origin_deg + np.degrees(points[..., ::-1] / (meridian_m, parallel_m))


def east_north(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, origin_deg: tuple[float, float]
) -> FloatArray:
    """Return points of the ellipsoid in the plane that touches it at an origin, (..., 2) [m].

    Points and origin (latitude, longitude) are converted to earth-centred coordinates,

        X = N cos(phi) cos(l),  Y = N cos(phi) sin(l),  Z = N (1 - e^2) sin(phi),
        N = a / sqrt(1 - e^2 sin^2(phi)),

    and their difference is rotated to east and north at the origin
    (Hofmann-Wellenhof, Lichtenegger and Wasle, "GNSS", 2008, ch. 8).
    """
    phi, lam = np.radians(origin_deg)
    offset = _earth_centred(latitude_deg, longitude_deg) - _earth_centred(*origin_deg)  # (..., 3)
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    return np.stack([offset @ east, offset @ north], axis=-1)


def _earth_centred(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
    """Return earth-centred coordinates X, Y, Z [m], (..., 3)."""
    phi, lam = np.radians(latitude_deg), np.radians(longitude_deg)
    radius = _SEMI_MAJOR_M / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(phi) ** 2)
    across = radius * np.cos(phi)
    polar = (1.0 - _ECCENTRICITY_SQUARED) * radius * np.sin(phi)
    return np.stack([across * np.cos(lam), across * np.sin(lam), polar], axis=-1)
