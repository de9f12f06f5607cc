"""Geodetic coordinates to local east and north."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

# World Geodetic System 1984 (NGA.STND.0036): semi-major axis and flattening of the ellipsoid.
_SEMI_MAJOR_M: Final = 6378137.0
_FLATTENING: Final = 1.0 / 298.257223563
_ECCENTRICITY_SQUARED: Final = _FLATTENING * (2.0 - _FLATTENING)


def east_north(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, origin_deg: tuple[float, float]
) -> FloatArray:
    """Return east and north of points in the tangent plane at an origin, (..., 2) [m].

    Points and origin have the earth-centred coordinates

        X = N cos(phi) cos(l),  Y = N cos(phi) sin(l),  Z = N (1 - e^2) sin(phi),
        N = a / sqrt(1 - e^2 sin^2(phi)),

    and their difference is rotated to east and north at the origin (latitude, longitude)
    (Hofmann-Wellenhof, Lichtenegger and Wasle, "GNSS", 2008, ch. 8).
    """
    phi, lam = np.radians(origin_deg)
    away = _earth_centred(latitude_deg, longitude_deg) - _earth_centred(*origin_deg)  # (..., 3)
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    return np.stack([away @ east, away @ north], axis=-1)


def _earth_centred(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
    phi, lam = np.radians(latitude_deg), np.radians(longitude_deg)
    radius = _SEMI_MAJOR_M / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(phi) ** 2)
    across = radius * np.cos(phi)
    polar = (1.0 - _ECCENTRICITY_SQUARED) * radius * np.sin(phi)
    return np.stack([across * np.cos(lam), across * np.sin(lam), polar], axis=-1)
