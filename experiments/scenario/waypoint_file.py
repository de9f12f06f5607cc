"""Waypoints: a line of a file, in the map frame, with or without speeds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ttempc.types import FloatArray

from ...testbed.geodesy import DEFAULT_FRAME, MapFrame
from ..errors import InvalidScenario, InvalidWaypoints, UnreadableFile
from ..formats.field import FieldSettings

_MOST_POINTS = 100_000  # 10 km with a point every 10 cm


@dataclass(frozen=True, slots=True, eq=False)
class Waypoints:
    """Points of a path in driving order."""

    points: FloatArray  # (n, 2) x, y [m], map frame
    speed: FloatArray | None = None  # (n,) [m/s]; None if the file has no speeds
    frame: MapFrame = DEFAULT_FRAME  # in which the points are
    notes: tuple[str, ...] = ()  # lines for the log


def read_waypoints(file: Path, field: FieldSettings | None = None, line: str = "") -> Waypoints:
    """Return the waypoints of a file in one of `formats.read.FORMATS`.

    Args:
        file: path of the file, or of the folder of a program.
        field: place of the map frame.
        line: name or number of the line, where the file has several.

    Raises:
        InvalidWaypoints: the file cannot be read; the message names the file, the line or point,
            and the allowed content.
    """
    from ..formats.read import read_foreign  # here, since a path by numbers needs no reader

    field = field or FieldSettings()
    try:
        content = read_foreign(file)
    except UnreadableFile as error:
        raise InvalidWaypoints(str(error)) from None
    try:
        table = content.table(line)
        places = table.places()
        speed = table.columns.get("speed_mps")
        _check_points(places, speed)
        points, frame, notes = field.place(table.coordinates, places)
    except (InvalidScenario, UnreadableFile) as error:
        raise InvalidWaypoints(f"{file}: {error}") from None
    if content.boundary:
        notes = (*notes, f"path: {len(content.boundary)} boundary rings of the file are not used")
    return Waypoints(points, speed, frame, (*content.notes, *notes))


def _check_points(places: FloatArray, speed: FloatArray | None) -> None:
    """Refuse a line with too many points, or with a gap."""
    if len(places) > _MOST_POINTS:
        raise UnreadableFile(f"has {len(places)} points, at most {_MOST_POINTS} are read")
    if not len(places):
        raise UnreadableFile("has a line without points")
    values = places if speed is None else np.column_stack([places, speed])
    gaps = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(gaps):
        raise UnreadableFile(f"point {gaps[0]} has no number for its place or speed")
