"""Waypoint files: points of a path, with or without speeds."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Never

import numpy as np

from ttempc.types import FloatArray

from ...testbed.bounded_read import MOST_TEXT_BYTES, read_bounded
from ...testbed.geodesy import east_north
from ..errors import InvalidWaypoints

_GEOJSON: Final = (".geojson", ".json")
# Columns without a header, by their number.
_UNNAMED: Final = {
    2: ("x", "y"),
    3: ("x", "y", "speed"),
    # Fields2Cover, Path::serializePath. The sixth is the length of the section that starts here,
    # in older versions its duration.
    8: ("x", "y", "z", "angle", "speed", "extent", "direction", "type"),
}
_NAMES: Final = {  # of a header, in lower case and without unit
    **dict.fromkeys(("x", "east", "easting"), "x"),
    **dict.fromkeys(("y", "north", "northing"), "y"),
    **dict.fromkeys(("speed", "v", "velocity"), "speed"),
}
_USED: Final = ("x", "y", "speed", "angle", "extent", "direction")
_MOST_LINES: Final = 100_000  # 10 km with a point every 10 cm
_SHOWN: Final = 100  # characters of a wrong value
_UNIT: Final = re.compile(r"(_mps|_m|_s)$|\s*\[.*\]$")


@dataclass(frozen=True, slots=True, eq=False)
class Waypoints:
    """Points of a path in driving order."""

    points: FloatArray  # (n, 2) x, y [m], map frame
    speed: FloatArray | None = None  # (n,) [m/s]; None if the file has no speeds
    backward: bool = False  # the file drives in reverse gear


def read_waypoints(
    file: Path,
    origin_m: tuple[float, float] | None = None,
    origin_deg: tuple[float, float] | None = None,
) -> Waypoints:
    """Return the waypoints of a file.

    A .geojson or .json file contains one LineString in WGS84. Any other file contains columns
    that commas, semicolons or blanks separate: x y, x y speed, or the eight columns of
    Fields2Cover, in metres and m/s. A header may name columns x, y and speed in any order.

    Args:
        file: path of the file.
        origin_m: file coordinates of (0, 0) of the map, for files of columns; default (0, 0).
        origin_deg: latitude and longitude of it, for GeoJSON; default the first point.

    Raises:
        InvalidWaypoints: the file cannot be read; the message names the file, the line or point,
            and the allowed content.
    """
    try:
        text = read_bounded(file, MOST_TEXT_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise InvalidWaypoints(f"{file}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InvalidWaypoints(f"{file}: cannot be read as text: {error}") from None
    try:
        if file.suffix.lower() in _GEOJSON:
            if origin_m is not None:
                raise InvalidWaypoints(
                    "is GeoJSON, its origin is given as origin_deg, not origin_m"
                )
            return Waypoints(_geojson_points(text, origin_deg))
        if origin_deg is not None:
            raise InvalidWaypoints("is in metres, its origin is given as origin_m, not origin_deg")
        return _columns_waypoints(text, origin_m or (0.0, 0.0))
    except InvalidWaypoints as error:
        raise InvalidWaypoints(f"{file}: {error}") from None


def _columns_waypoints(text: str, origin_m: tuple[float, float]) -> Waypoints:
    if (count := text.count("\n")) > _MOST_LINES:
        raise InvalidWaypoints(f"holds {count} lines, at most {_MOST_LINES} are read")
    lines = [(number, _words(line)) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, words) for number, words in lines if words]
    names, lines = _header(lines)
    rows = [_row(number, words, names) for number, words in lines]
    values = np.array(rows).reshape(-1, len(names))
    column = dict(zip(names, values.T, strict=True))
    points = np.column_stack([column["x"], column["y"]]) - origin_m
    numbers = [number for number, _ in lines]
    if "direction" in column:
        return _fields2cover_waypoints(points, column, numbers)
    if "speed" in column:
        return Waypoints(points, column["speed"])
    return Waypoints(points)


def _words(line: str) -> list[str]:
    """Return the words of a line, none for a comment; a comment may be the header."""
    words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
    if words and words[0].startswith("#"):
        words = [words[0].lstrip("#"), *words[1:]]
        words = [word for word in words if word]
        return words if {"x", "y"} <= {_plain(word) for word in words} else []
    return words


def _plain(word: str) -> str:
    name = _UNIT.sub("", word.strip("\"'").lower())
    return _NAMES.get(name, name)


def _header(
    lines: list[tuple[int, list[str]]],
) -> tuple[Sequence[str], list[tuple[int, list[str]]]]:
    """Return the names of the columns and the lines of numbers."""
    if not lines:
        raise InvalidWaypoints("is empty, must hold points")
    number, words = lines[0]
    if any(math.isnan(_number(word)) for word in words):
        names = [_plain(word) for word in words]
        for name in ("x", "y"):
            if names.count(name) != 1:
                raise InvalidWaypoints(
                    f"line {number}: header {' '.join(words)}: needs one column x and one y, "
                    "may have speed"
                )
        return names, lines[1:]
    if len(words) not in _UNNAMED:
        raise InvalidWaypoints(
            f"line {number}: got {len(words)} columns, must be 2 (x y), 3 (x y speed), 8 "
            "(Fields2Cover), or have a header"
        )
    return _UNNAMED[len(words)], lines


def _row(number: int, words: Sequence[str], names: Sequence[str]) -> list[float]:
    """Return the numbers of a line, 0 in columns that are not used."""
    if len(words) != len(names):
        raise InvalidWaypoints(f"line {number}: got {len(words)} columns, must be {len(names)}")
    row = [_number(word) if name in _USED else 0.0 for name, word in zip(names, words, strict=True)]
    for name, word, value in zip(names, words, row, strict=True):
        if not math.isfinite(value):
            raise InvalidWaypoints(
                f"line {number}: {name} is {word[:_SHOWN]!r}, must be a finite number"
            )
    return row


def _number(word: str) -> float:
    """Return the number that a word is, NaN where it is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


def _fields2cover_waypoints(
    points: FloatArray, column: dict[str, FloatArray], numbers: Sequence[int]
) -> Waypoints:
    """Return the waypoints of Fields2Cover's states, each the start of a section.

    The end of the last section is a waypoint, too. The sixth column contains lengths or
    durations, depending on the version of Fields2Cover; the one that fits the distances between
    the other states is taken.
    """
    direction = column["direction"]
    for index, value in enumerate(direction):
        if value != direction[0] or abs(value) != 1.0:
            raise InvalidWaypoints(
                f"line {numbers[index]} (point {index} at x = {points[index, 0]:.2f}, "
                f"y = {points[index, 1]:.2f} m): direction is {value:g}, must be 1 (forward) or "
                "-1 (backward) and the same all along: a change of gear needs a path of its own"
            )
    speed, extent = column["speed"], column["extent"]
    steps = np.hypot(*np.diff(points, axis=0).T)
    driven = np.append(steps > 0.0, True)  # a section without length is no point
    lengths = min((extent, extent * speed), key=lambda read: float(np.abs(read[:-1] - steps).sum()))
    angle = column["angle"][-1]
    end = points[-1] + lengths[-1] * np.array([np.cos(angle), np.sin(angle)])
    points, speed = points[driven], speed[driven]
    if lengths[-1] > 0.0:
        points, speed = np.vstack([points, end]), np.append(speed, speed[-1])
    return Waypoints(points, speed, backward=bool(direction[0] < 0.0))


def _geojson_points(text: str, origin_deg: tuple[float, float] | None) -> FloatArray:
    try:
        content = json.loads(text)
        lines = list(_line_strings(content))
    except ValueError as error:
        raise InvalidWaypoints(f"is no JSON: {error}") from None
    except RecursionError:
        raise InvalidWaypoints("is nested too deeply") from None
    if len(lines) != 1:
        raise InvalidWaypoints(f"holds {len(lines)} LineStrings, must be one")
    places = []
    for index, place in enumerate(lines[0] if isinstance(lines[0], list) else _no_points()):
        numbers = place if isinstance(place, list) else []
        good = len(numbers) in (2, 3) and all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in numbers
        )
        # "not <=" refuses NaN, too
        if not (good and abs(numbers[0]) <= 180.0 and abs(numbers[1]) <= 90.0):
            raise InvalidWaypoints(
                f"point {index} is {str(place)[:_SHOWN]}, must be [longitude, latitude] in degrees "
                "(WGS84)"
            )
        places.append(numbers[:2])
    if not places:
        _no_points()
    longitude, latitude = np.array(places, dtype=float).T
    origin = origin_deg or (float(latitude[0]), float(longitude[0]))
    return east_north(latitude, longitude, origin)


def _line_strings(content: Any) -> Iterator[Any]:  # noqa: ANN401 - any JSON value
    """Yield the coordinates of every LineString in a GeoJSON object (RFC 7946)."""
    if not isinstance(content, dict):
        return
    match content.get("type"):
        case "LineString":
            yield content.get("coordinates")
        case "Feature":
            yield from _line_strings(content.get("geometry"))
        case "FeatureCollection":
            features = content.get("features")
            for feature in features if isinstance(features, list) else ():
                yield from _line_strings(feature)


def _no_points() -> Never:
    raise InvalidWaypoints("the LineString has no coordinates")
