"""`[field]`: the place of the field on the earth, and the coordinates of its files."""

import re
from typing import Annotated, Final

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ...testbed.configuration.config_io import STRICT
from ...testbed.geodesy import MapFrame, middle_deg, utm_degrees
from ..errors import InvalidScenario
from .table import Coordinates

Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
GridM = Annotated[float, Field(ge=-1e8, le=1e8)]

_UTM: Final = re.compile(r"(\d{1,2})([NS])")
_LARGEST_LOCAL_M: Final = 10_000.0  # metres beyond it belong to a grid of a country or of UTM


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FieldSettings:
    """Origin of the map frame; path, log, exports and datagrams share it."""

    origin_deg: tuple[Latitude, Longitude] | None = None
    """Latitude and longitude of (0, 0) of the map; absent: the middle of the path's file, where
    it has degrees or UTM coordinates, else open land near Leuven."""
    utm: str = ""
    """Zone and hemisphere of UTM coordinates in files and in `origin_m`, as "31N" or "55S"; empty:
    metres in files are of a grid of their own."""
    origin_m: tuple[GridM, GridM] | None = None
    """Easting and northing, in the grid of the files, of (0, 0) of the map; absent: (0, 0), of
    files with coordinates beyond 10 km their middle."""

    def __post_init__(self) -> None:
        if self.utm and not self._zone():
            raise ValueError(
                f"utm: got {self.utm!r}, must be a zone 1 to 60 and a hemisphere N or S, as '31N'"
            )
        if self.utm and self.origin_deg and self.origin_m:
            raise ValueError("origin_deg and origin_m are two origins in UTM: give one of them")

    def frame(self) -> MapFrame:
        """Return the map frame of a path that has no place of its own.

        Raises:
            InvalidScenario: the origin is in metres of an unknown grid.
        """
        if self.origin_m is None:
            return MapFrame(self.origin_deg) if self.origin_deg else MapFrame()
        if not self.utm:
            raise InvalidScenario(
                "field.origin_m: needs field.utm, the zone of these metres, as '31N', or a path "
                "file in metres"
            )
        latitude, longitude = self._degrees(np.array(self.origin_m)).tolist()
        return MapFrame((latitude, longitude))

    def place(
        self, coordinates: Coordinates, places: FloatArray
    ) -> tuple[FloatArray, MapFrame, tuple[str, ...]]:
        """Return points of a file in the map frame, (n, 2) [m], that frame, and notes for the log.

        `places` (n, 2) are latitudes and longitudes [deg], or eastings and northings [m].

        Raises:
            InvalidScenario: the origin does not fit the coordinates, or the metres are not of UTM.
        """
        if coordinates == "map":
            return places, self.frame(), ()
        if coordinates == "metres" and not self.utm:
            return self._place_metres(places)
        if coordinates == "metres":
            _check_utm(places)
            places = self._degrees(places)
        elif self.origin_m is not None and not self.utm:
            raise InvalidScenario(
                "field.origin_m: the file is in degrees; give field.origin_deg, or field.utm with "
                "origin_m"
            )
        if self.origin_deg is None and self.origin_m is None:
            frame = MapFrame(middle_deg(*places.T))
        else:
            frame = self.frame()
        latitude, longitude = frame.origin_deg
        note = f"field: origin at {latitude:.7f}, {longitude:.7f} deg"
        return frame.points(*places.T), frame, (note,)

    def _place_metres(self, places: FloatArray) -> tuple[FloatArray, MapFrame, tuple[str, ...]]:
        """Return points of a grid that is not placed on the earth."""
        frame = MapFrame(self.origin_deg) if self.origin_deg else MapFrame()
        if self.origin_m is not None:
            return places - self.origin_m, frame, ()
        if np.abs(places).max() <= _LARGEST_LOCAL_M:
            return places, frame, ()
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        note = (
            f"field: origin at the middle of the file, {middle[0]:.3f}, {middle[1]:.3f} m; without "
            "field.utm its place on the earth is not known"
        )
        return places - middle, frame, (note,)

    def _zone(self) -> tuple[int, bool] | None:
        """Return number and southern hemisphere of the zone, None if it is none."""
        match = _UTM.fullmatch(self.utm)
        if match is None or not 1 <= int(match[1]) <= 60:
            return None
        return int(match[1]), match[2] == "S"

    def _degrees(self, places: FloatArray) -> FloatArray:
        zone = self._zone()
        assert zone is not None
        return utm_degrees(places, zone[0], south=zone[1])


def _check_utm(places: FloatArray) -> None:
    """Refuse metres that are not of UTM; ranges of the zones with their overlaps (NGA.SIG.0012)."""
    east, north = places.T
    beyond = np.flatnonzero((np.abs(east - 5e5) > 4e5) | (north < 0.0) | (north > 1e7))
    if len(beyond):
        x, y = places[beyond[0]]
        raise InvalidScenario(
            f"field.utm: point {beyond[0]} at {x:.6g}, {y:.6g} m is not in UTM, whose eastings are "
            "100 to 900 km and northings 0 to 10 000 km"
        )
