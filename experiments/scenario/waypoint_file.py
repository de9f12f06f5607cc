"""Waypoint files: points of a path, with or without speeds."""

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
from ...testbed.geodesy import DEFAULT_FRAME, MapFrame
from ..errors import InvalidScenario, InvalidWaypoints
from .field import FieldSettings

_GEOJSON: Final = (".geojson", ".json")
# Columns without a header, by their number.
_UNNAMED: Final = {2: ("x", "y"), 3: ("x", "y", "speed")}  # by the number of columns
_NAMES: Final = {  # of a header, in lower case and without unit
    **dict.fromkeys(("x", "east", "easting"), "x"),
    **dict.fromkeys(("y", "north", "northing"), "y"),
    **dict.fromkeys(("speed", "v", "velocity"), "speed"),
}
_USED: Final = ("x", "y", "speed")
_MOST_LINES: Final = 100_000  # 10 km with a point every 10 cm
_SHOWN: Final = 100  # characters of a wrong value
_UNIT: Final = re.compile(r"(_mps|_m|_s)$|\s*\[.*\]$")


@dataclass(frozen=True, slots=True, eq=False)
class Waypoints:
    """Points of a path in driving order."""

    points: FloatArray  # (n, 2) x, y [m], map frame
    speed: FloatArray | None = None  # (n,) [m/s]; None if the file has no speeds
    frame: MapFrame = DEFAULT_FRAME  # in which the points are
    notes: tuple[str, ...] = ()  # lines for the log


def read_waypoints(file: Path, field: FieldSettings | None = None) -> Waypoints:
    """Return the waypoints of a file.

    A .geojson or .json file contains one LineString in WGS84. Any other file contains columns
    that commas, semicolons or blanks separate: x y or x y speed, in metres and m/s. A header may
    name columns x, y and speed in any order.

    Args:
        file: path of the file.
        field: place of the map frame.

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
            waypoints, coordinates = Waypoints(_geojson_places(text)), "degrees"
        else:
            waypoints, coordinates = _columns_waypoints(text), "metres"
        field = field or FieldSettings()
        points, frame, notes = field.place(coordinates, waypoints.points)
        return Waypoints(points, waypoints.speed, frame, notes)
    except (InvalidScenario, InvalidWaypoints) as error:
        raise InvalidWaypoints(f"{file}: {error}") from None


def _columns_waypoints(text: str) -> Waypoints:
    if (count := text.count("\n")) > _MOST_LINES:
        raise InvalidWaypoints(f"holds {count} lines, at most {_MOST_LINES} are read")
    lines = [(number, _words(line)) for number, line in enumerate(text.splitlines(), 1)]
    lines = [(number, words) for number, words in lines if words]
    names, lines = _header(lines)
    rows = [_row(number, words, names) for number, words in lines]
    values = np.array(rows).reshape(-1, len(names))
    column = dict(zip(names, values.T, strict=True))
    points = np.column_stack([column["x"], column["y"]])
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
            f"line {number}: got {len(words)} columns, must be 2 (x y), 3 (x y speed), "
            "or have a header"
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
    try:
        return float(word)
    except ValueError:
        return math.nan


def _geojson_places(text: str) -> FloatArray:
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
    return np.array(places, dtype=float)[:, ::-1]


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
