"""GeoJSON (RFC 7946), KML 2.2 and GPX 1.1: lines, tracks and boundaries in WGS 84."""

import json
import math
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from ttempc.types import FloatArray

from ...testbed.foreign_files import json_table
from ..errors import UnreadableFile
from .table import ForeignFile, Table, check_degrees, degrees_table
from .text import number_of

_WGS84: Final = ("CRS84", "4326")
_SHOWN: Final = 100  # characters of a wrong value


def read_geojson(text: str) -> ForeignFile:
    """Return the lines and the boundary of a GeoJSON text.

    Raises:
        UnreadableFile: it is no GeoJSON, or not in WGS 84.
    """
    try:
        content = json_table(text.encode())
        features = list(_geometries(content, ""))
    except ValueError as error:
        raise UnreadableFile(str(error)) from None
    except RecursionError:
        raise UnreadableFile("is nested too deeply") from None
    crs = json.dumps(content.get("crs"))
    if crs != "null" and not any(name in crs for name in _WGS84):
        raise UnreadableFile(
            f"is GeoJSON in crs {crs[:_SHOWN]}, must be in WGS 84 (longitude, latitude): save it so"
        )
    lines: list[Table] = []
    rings: list[FloatArray] = []
    others: set[str] = set()
    for kind, coordinates, name in features:
        parts = coordinates if isinstance(coordinates, list) else []
        if kind == "LineString":
            lines.append(degrees_table(_positions(parts, "LineString"), name))
        elif kind == "MultiLineString":
            lines += [degrees_table(_positions(part, kind), name) for part in parts]
        elif kind == "Polygon":
            rings += [np.array(_positions(part, kind)) for part in parts]
        elif kind == "MultiPolygon":
            rings += [np.array(_positions(part, kind)) for area in parts for part in area]
        else:
            others.add(str(kind)[:_SHOWN])
    notes = (f"not used of the file: {', '.join(sorted(others))}",) if others else ()
    return ForeignFile("GeoJSON", lines, rings, notes)


def _geometries(content: Any, name: str) -> Iterator[tuple[Any, Any, str]]:  # noqa: ANN401 - JSON
    """Yield kind, coordinates and name of every geometry in a GeoJSON object."""
    if not isinstance(content, dict):
        return
    kind = content.get("type")
    if kind == "Feature":
        properties = content.get("properties")
        title = properties.get("name", "") if isinstance(properties, dict) else ""
        yield from _geometries(content.get("geometry"), str(title)[:_SHOWN])
    elif kind in ("FeatureCollection", "GeometryCollection"):
        parts = content.get("features" if kind == "FeatureCollection" else "geometries")
        for part in parts if isinstance(parts, list) else ():
            yield from _geometries(part, name)
    elif "coordinates" in content:
        yield kind, content["coordinates"], name


def _positions(coordinates: Any, kind: str) -> list[tuple[float, float]]:  # noqa: ANN401 - JSON
    """Return latitudes and longitudes of the positions of a line or a ring."""
    if not isinstance(coordinates, list) or not coordinates:
        raise UnreadableFile(f"the {kind} has no coordinates")
    places = []
    for index, place in enumerate(coordinates):
        numbers = place if isinstance(place, list) else []
        good = len(numbers) >= 2 and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in numbers[:2]
        )
        # "not <=" refuses NaN, too
        if not (good and abs(numbers[0]) <= 180.0 and abs(numbers[1]) <= 90.0):
            raise UnreadableFile(
                f"point {index} is {str(place)[:_SHOWN]}, must be [longitude, latitude] in degrees "
                "(WGS84)"
            )
        places.append((float(numbers[1]), float(numbers[0])))
    return places


def read_kml(root: Element) -> ForeignFile:
    """Return lines, tracks and boundaries of the placemarks; links to other files are not followed.

    Raises:
        UnreadableFile: a coordinate is no number.
    """
    lines: list[Table] = []
    rings: list[FloatArray] = []
    for placemark in root.iter("Placemark"):
        name = (placemark.findtext("name") or "").strip()[:_SHOWN]
        for line in placemark.iter("LineString"):
            lines.append(degrees_table(_kml_places(line.findtext("coordinates")), name))
        for ring in placemark.iter("LinearRing"):
            rings.append(np.array(_kml_places(ring.findtext("coordinates"))))
        for track in placemark.iter("Track"):
            lines.append(_kml_track(track, name))
    links = sum(1 for _ in root.iter("NetworkLink"))
    notes = (f"{links} links to other files are not followed",) if links else ()
    return ForeignFile("KML", lines, rings, notes)


def _kml_places(text: str | None) -> list[tuple[float, float]]:
    places = []
    for word in (text or "").split():
        longitude, _, rest = word.partition(",")
        latitude = rest.partition(",")[0]
        places.append((number_of(latitude, "a latitude"), number_of(longitude, "a longitude")))
    return places


def _kml_track(track: Element, name: str) -> Table:
    """Return a gx:Track, whose `when` and `coord` elements go together one by one."""
    words = [(each.text or "").split() for each in track.iter("coord")]
    times = [_seconds(each.text) for each in track.iter("when")]
    if len(times) != len(words) or any(len(word) < 2 for word in words):
        raise UnreadableFile(f"has a track with {len(times)} times and {len(words)} coordinates")
    places = [(number_of(w[1], "a latitude"), number_of(w[0], "a longitude")) for w in words]
    return _timed(places, times, name)


def read_gpx(root: Element) -> ForeignFile:
    """Return the routes, and the segments of the tracks, of a GPX document.

    Raises:
        UnreadableFile: a coordinate is no number.
    """
    tables = []
    for track in root.iter("trk"):
        name = (track.findtext("name") or "").strip()[:_SHOWN]
        tables += [_gpx_line(part.findall("trkpt"), name) for part in track.iter("trkseg")]
    for route in root.iter("rte"):
        name = (route.findtext("name") or "").strip()[:_SHOWN]
        tables.append(_gpx_line(route.findall("rtept"), name))
    return ForeignFile("GPX", [table for table in tables if len(table)])


def _gpx_line(points: Sequence[Element], name: str) -> Table:
    places = [
        (number_of(point.get("lat"), "lat"), number_of(point.get("lon"), "lon")) for point in points
    ]
    return _timed(places, [_seconds(point.findtext("time")) for point in points], name)


def _timed(places: Sequence[tuple[float, float]], times: Sequence[float], name: str) -> Table:
    """Return a line with its times, where it has some."""
    table = degrees_table(places, name)
    if not times or all(math.isnan(time) for time in times):
        return table
    check_degrees(table.places())
    return Table("degrees", {"time_s": np.array(times), **table.columns}, name)


def _seconds(text: str | None) -> float:
    """Return seconds since 1970 of an ISO time; NaN without one."""
    try:
        return datetime.fromisoformat((text or "").strip()).timestamp()
    except ValueError:
        return math.nan
