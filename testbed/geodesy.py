"""Geodesy: the map frame on the WGS 84 ellipsoid, and UTM coordinates."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike

from ttempc.types import FloatArray

# World Geodetic System 1984 (NGA.STND.0036): semi-major axis and flattening of the ellipsoid.
_SEMI_MAJOR_M: Final = 6378137.0
_FLATTENING: Final = 1.0 / 298.257223563
_ECCENTRICITY_SQUARED: Final = _FLATTENING * (2.0 - _FLATTENING)

# Universal Transverse Mercator (NGA.SIG.0012): scale of the central meridian, false origins.
_UTM_SCALE: Final = 0.9996
_FALSE_EASTING_M: Final = 500_000.0
_FALSE_NORTHING_M: Final = 10_000_000.0  # of the southern hemisphere

ORIGIN_DEG: Final = 50.86, 4.68
"""Latitude and longitude of a field without a place of its own; open land near Leuven."""

ORIGIN_KEY: Final = "origin_deg"
"""Key of the origin in the metadata of a log."""


@dataclass(frozen=True, slots=True)
class MapFrame:
    """The map frame: x east, y north in the plane that touches the ellipsoid at an origin.

    A point of the ellipsoid is projected onto the plane along its normal at the origin. Both
    directions are closed forms, exact to the rounding of doubles (1e-9 m). A distance in the plane
    is shorter than on the ellipsoid by the share (d / R)^2 / 6: 4 um in 1 km.

    Points and origin are converted to earth-centred coordinates,

        X = N cos(phi) cos(l),  Y = N cos(phi) sin(l),  Z = N (1 - e^2) sin(phi),
        N = a / sqrt(1 - e^2 sin^2(phi)),

    and their difference is rotated to east and north at the origin
    (Hofmann-Wellenhof, Lichtenegger and Wasle, "GNSS", 2008, ch. 8).
    """

    origin_deg: tuple[float, float] = ORIGIN_DEG
    """Latitude and longitude of x = y = 0."""

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> Self:
        """Return the frame of a log, from its metadata; old logs have the default one."""
        latitude, _, longitude = metadata.get(ORIGIN_KEY, "").partition(",")
        return cls((float(latitude), float(longitude))) if longitude else cls()

    @property
    def metadata(self) -> dict[str, str]:
        """Entry of the frame in the metadata of a log."""
        latitude, longitude = self.origin_deg
        return {ORIGIN_KEY: f"{latitude!r}, {longitude!r}"}

    def points(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
        """Return the points of the map frame, (..., 2) [m], at latitudes and longitudes."""
        east, north, _ = self._axes()
        offset = _earth_centred(latitude_deg, longitude_deg) - _earth_centred(*self.origin_deg)
        return np.stack([offset @ east, offset @ north], axis=-1)

    def degrees(self, points: FloatArray) -> FloatArray:
        """Return latitudes and longitudes [deg], (..., 2), of points of the map frame [m].

        The height h over the plane at which the normal meets the ellipsoid solves

            |S (o + x east + y north + h up)|^2 = a^2,   S = diag(1, 1, 1 / sqrt(1 - e^2)).

        On the ellipsoid itself, tan(phi) = Z / ((1 - e^2) sqrt(X^2 + Y^2)).
        """
        east, north, up = self._axes()
        place = _earth_centred(*self.origin_deg) + points @ np.stack([east, north])  # (..., 3)
        stretch = np.array([1.0, 1.0, 1.0 / math.sqrt(1.0 - _ECCENTRICITY_SQUARED)])
        scaled_place = place * stretch
        scaled_up = up * stretch

        # a h^2 + 2 b h + c = 0; the root next to the plane, without cancellation
        a = float(scaled_up @ scaled_up)
        b = scaled_place @ scaled_up
        c = np.sum(scaled_place**2, axis=-1) - _SEMI_MAJOR_M**2
        height = -c / (b + np.sqrt(b**2 - a * c))
        place = place + height[..., None] * up

        across = np.hypot(place[..., 0], place[..., 1])
        latitude = np.arctan2(place[..., 2], (1.0 - _ECCENTRICITY_SQUARED) * across)
        longitude = np.arctan2(place[..., 1], place[..., 0])
        return np.degrees(np.stack([latitude, longitude], axis=-1))

    def _axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the directions east, north and up at the origin, earth-centred."""
        phi, lam = np.radians(self.origin_deg)
        east = np.array([-np.sin(lam), np.cos(lam), 0.0])
        north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
        up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
        return east, north, up


DEFAULT_FRAME: Final = MapFrame()
"""Frame of a field without a place of its own."""


def middle_deg(latitude_deg: FloatArray, longitude_deg: FloatArray) -> tuple[float, float]:
    """Return latitude and longitude of the middle of the bounding box of points.

    Longitudes are taken as differences from the first one, since 180 and -180 are one meridian.
    """
    first = float(longitude_deg[0])
    east = np.mod(longitude_deg - first + 180.0, 360.0) - 180.0
    latitude = 0.5 * float(latitude_deg.min() + latitude_deg.max())
    longitude = first + 0.5 * float(east.min() + east.max())
    return latitude, (longitude + 180.0) % 360.0 - 180.0


def utm_degrees(points: FloatArray, zone: int, *, south: bool) -> FloatArray:
    """Return latitudes and longitudes [deg], (..., 2), of UTM eastings and northings [m].

    Kruger's series to the fourth order of the third flattening n (C. Karney, "Transverse Mercator
    with an accuracy of a few nanometers", J. Geodesy 85, 2011, eq. (36)); the first term that is
    left out is 1e-7 m. The latitude follows from the conformal one by Newton's method (eq. (19)).
    """
    n = _FLATTENING / (2.0 - _FLATTENING)
    radius = _SEMI_MAJOR_M / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    beta = (
        n / 2.0 - 2.0 * n**2 / 3.0 + 37.0 * n**3 / 96.0 - n**4 / 360.0,
        n**2 / 48.0 + n**3 / 15.0 - 437.0 * n**4 / 1440.0,
        17.0 * n**3 / 480.0 - 37.0 * n**4 / 840.0,
        4397.0 * n**4 / 161280.0,
    )
    northing = points[..., 1] - (_FALSE_NORTHING_M if south else 0.0)
    plane = northing + 1j * (points[..., 0] - _FALSE_EASTING_M)
    plane = plane / (_UTM_SCALE * radius)  # xi + i eta
    sphere = plane - sum(b * np.sin(2.0 * (k + 1) * plane) for k, b in enumerate(beta))
    xi = sphere.real
    eta = sphere.imag

    conformal = np.sin(xi) / np.hypot(np.sinh(eta), np.cos(xi))  # tan of the conformal latitude
    eccentricity = math.sqrt(_ECCENTRICITY_SQUARED)
    tangent = conformal / (1.0 - _ECCENTRICITY_SQUARED)
    for _ in range(4):  # converges quadratically; three steps reach the rounding
        secant = np.hypot(1.0, tangent)
        sigma = np.sinh(eccentricity * np.arctanh(eccentricity * tangent / secant))
        reached = tangent * np.hypot(1.0, sigma) - sigma * secant
        gain = 1.0 + (1.0 - _ECCENTRICITY_SQUARED) * tangent**2
        gain = gain / ((1.0 - _ECCENTRICITY_SQUARED) * secant * np.hypot(1.0, reached))
        tangent = tangent + gain * (conformal - reached)
    latitude = np.arctan(tangent)
    longitude = np.arctan2(np.sinh(eta), np.cos(xi))
    central_deg = 6.0 * zone - 183.0
    longitude_deg = np.degrees(longitude) + central_deg
    longitude_deg = np.mod(longitude_deg + 180.0, 360.0) - 180.0
    return np.stack([np.degrees(latitude), longitude_deg], axis=-1)


def _earth_centred(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> FloatArray:
    """Return earth-centred coordinates X, Y, Z [m], (..., 3)."""
    phi = np.radians(latitude_deg)
    lam = np.radians(longitude_deg)
    radius = _SEMI_MAJOR_M / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(phi) ** 2)
    across = radius * np.cos(phi)
    polar = (1.0 - _ECCENTRICITY_SQUARED) * radius * np.sin(phi)
    return np.stack([across * np.cos(lam), across * np.sin(lam), polar], axis=-1)
