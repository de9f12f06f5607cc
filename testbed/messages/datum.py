"""Where on Earth the map frame lies: only for viewers that draw positions on a map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

_SEMI_MAJOR_M: Final = 6378137.0  # WGS 84
_ECCENTRICITY_SQUARED: Final = 6.69437999014e-3  # WGS 84


@dataclass(frozen=True)
class Datum:
    """The geodetic place of the map frame's origin (WGS 84)."""

    latitude_deg: float
    longitude_deg: float

    @cached_property
    def metres_per_degree(self) -> tuple[float, float]:
        """Length of a degree of latitude and of one of longitude at the origin [m]."""
        latitude = math.radians(self.latitude_deg)
        w = math.sqrt(1.0 - _ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)
        meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_SQUARED) / w**3
        parallel_m = _SEMI_MAJOR_M / w * math.cos(latitude)
        return math.radians(meridian_m), math.radians(parallel_m)

    def degrees(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return latitude and longitude [deg] of a point of the map frame.

        The field is flat: with the ellipsoid's radii of curvature at the origin the error grows
        with the square of the distance, to 0.3 mm at 50 m.
        """
        north_per_degree, east_per_degree = self.metres_per_degree
        return (
            self.latitude_deg + north_m / north_per_degree,
            self.longitude_deg + east_m / east_per_degree,
        )


DATUM: Final = Datum(50.86, 4.68)  # assumed: open land by Leuven, the home of the paper's tractor
