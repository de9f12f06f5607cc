"""Field folders of AgOpenGPS: lines, recorded path and boundary (sources at commit d3cfa14)."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..errors import UnreadableFile
from .table import ForeignFile, Table
from .text import number_of, read_text

LINES: Final = "TrackLines.txt"
RECORDED: Final = "RecPath.txt"
BOUNDARY: Final = "Boundary.txt"
PLANE: Final = "Field.txt"
HEADERS: Final = ("$TrackLines", "$TwolTracks", "$RecPath", "$Boundary")
"""First lines of the files."""

_CURVE_MODES: Final = (4, 8, 16, 32)  # of a line that has points of its own; 2: AB line
_KMH: Final = 1.0 / 3.6


def is_field(folder: Path) -> bool:
    """Return whether a folder is one of AgOpenGPS."""
    return any((folder / name).is_file() for name in (LINES, RECORDED, BOUNDARY))


def read_field(folder: Path, only: str = "") -> ForeignFile:
    """Return lines, recorded path and boundary of a folder; `only` is the one file to read.

    Metres are of a local plane about `StartFix` of Field.txt and become degrees by its own
    formula; without Field.txt they stay metres.

    Raises:
        UnreadableFile: a file is damaged; the message names it and the line.
    """
    readers = {LINES: _lines, RECORDED: _recorded, BOUNDARY: _boundary}
    origin = _start_fix(folder)
    tables: list[Table] = []
    rings: list[FloatArray] = []
    for name, reader in readers.items():
        if (only and name != only) or not (folder / name).is_file():
            continue
        text = _LineReader(name, read_text(folder / name))
        for table in reader(text):
            if isinstance(table, Table):
                tables.append(_placed(table, origin))
            else:
                rings.append(_degrees(table, origin) if origin else table)
    notes = () if origin else (f"no {PLANE}: the metres have no place on the earth",)
    return ForeignFile("a field of AgOpenGPS", tables, rings, notes)


class _LineReader:
    """Lines of a file, one by one, with messages that name the line."""

    def __init__(self, name: str, text: str) -> None:
        self._name = name
        self._lines = [line.strip() for line in text.splitlines()]
        self._next = 0

    @property
    def left(self) -> bool:
        """Whether there are more lines that are not empty."""
        while self._next < len(self._lines) and not self._lines[self._next]:
            self._next += 1
        return self._next < len(self._lines)

    def line(self) -> str:
        """Return the next line."""
        if self._next >= len(self._lines):
            raise UnreadableFile(f"{self._name}: ends after line {self._next}, more must follow")
        self._next += 1
        return self._lines[self._next - 1]

    def numbers(self, least: int) -> list[float]:
        """Return the numbers of the next line, at least so many; words behind them are ignored."""
        words = self.line().split(",")
        where = f"{self._name}: line {self._next}"
        if len(words) < least:
            raise UnreadableFile(f"{where}: got {len(words)} numbers, must be {least} or more")
        return [number_of(word.strip(), where) for word in words[:least]]

    def count(self) -> int:
        """Return the number of lines that follow."""
        (count,) = self.numbers(1)
        if not 0 <= count <= len(self._lines) - self._next or count != int(count):
            raise UnreadableFile(
                f"{self._name}: line {self._next}: {count:g} points are announced, "
                f"{len(self._lines) - self._next} lines follow"
            )
        return int(count)


def _lines(text: _LineReader) -> Iterator[Table]:
    """Yield AB lines and curves."""
    twol = text.line() == "$TwolTracks"
    while text.left:
        name = text.line()
        text.numbers(1)  # heading
        ends = [text.numbers(2), text.numbers(2)]
        text.numbers(1)  # nudge
        (mode,) = text.numbers(1)
        text.line()  # visible
        points = [text.numbers(3)[:2] for _ in range(text.count())]
        if twol:
            text.line()
            text.line()
        line = np.array(points if mode in _CURVE_MODES and len(points) > 1 else ends)
        yield Table("metres", {"x_m": line[:, 0], "y_m": line[:, 1]}, name)


def _recorded(text: _LineReader) -> Iterator[Table]:
    """Yield the recorded path: easting, northing, heading from north [rad], speed [km/h]."""
    text.line()
    rows = np.array([text.numbers(4) for _ in range(text.count())]).reshape(-1, 4)
    if not len(rows):
        return
    east, north, heading, speed = rows.T
    columns = {
        "x_m": east,
        "y_m": north,
        "yaw_rad": math.pi / 2.0 - heading,
        "speed_mps": _KMH * speed,
    }
    yield Table("metres", columns, "recorded path")


def _boundary(text: _LineReader) -> Iterator[FloatArray]:
    """Yield the rings, the outer one first."""
    text.line()
    while text.left:
        word = text.line()
        while word in ("True", "False"):  # drive through; old files have it twice
            word = text.line()
        count = number_of(word, BOUNDARY)
        yield np.array([text.numbers(2) for _ in range(int(count))]).reshape(-1, 2)


def _start_fix(folder: Path) -> tuple[float, float] | None:
    """Return latitude and longitude of the plane's origin, None without Field.txt."""
    if not (folder / PLANE).is_file():
        return None
    lines = read_text(folder / PLANE).splitlines()
    for line, below in zip(lines, [*lines[1:], ""], strict=True):
        if line.startswith("StartFix"):
            words = below.split(",")
            latitude = number_of(words[0], f"{PLANE}: StartFix")
            return latitude, number_of(words[-1], f"{PLANE}: StartFix")
    raise UnreadableFile(f"{PLANE}: has no StartFix")


def _placed(table: Table, origin: tuple[float, float] | None) -> Table:
    """Return a table in metres of the plane as one in degrees."""
    if origin is None:
        return table
    latitude, longitude = _degrees(table.places(), origin).T
    rest = {name: values for name, values in table.columns.items() if name not in ("x_m", "y_m")}
    return Table(
        "degrees", {"latitude_deg": latitude, "longitude_deg": longitude, **rest}, table.name
    )


def _degrees(points: FloatArray, origin: tuple[float, float]) -> FloatArray:
    """Return latitudes and longitudes of points of AgOpenGPS' local plane.

    It has the length of a degree of latitude at the origin and that of longitude at the point:
    series of the WGS 84 ellipsoid (LocalPlane.cs).
    """
    phi = math.radians(origin[0])
    per_latitude = 111132.92 - 559.82 * math.cos(2.0 * phi) + 1.175 * math.cos(4.0 * phi)
    per_latitude -= 0.0023 * math.cos(6.0 * phi)
    latitude = origin[0] + points[:, 1] / per_latitude
    phi = np.radians(latitude)
    per_longitude = 111412.84 * np.cos(phi) - 93.5 * np.cos(3.0 * phi) + 0.118 * np.cos(5.0 * phi)
    return np.column_stack([latitude, origin[1] + points[:, 0] / per_longitude])
