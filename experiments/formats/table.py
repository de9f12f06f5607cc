"""Tables of foreign files: lines and records with named columns, in SI units."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from ttempc.types import FloatArray

from ..errors import UnreadableFile

Coordinates = Literal["degrees", "metres", "map"]
"""Coordinates of a file: latitude and longitude, eastings and northings, or our map frame."""

MOST_ROWS: Final = 1_000_000
"""Largest number of rows of a table: five hours at 50 Hz."""

PLACE_COLUMNS: Final[Mapping[Coordinates, tuple[str, str]]] = {
    "degrees": ("latitude_deg", "longitude_deg"),
    "metres": ("x_m", "y_m"),
    "map": ("x_m", "y_m"),
}

COLUMNS: Final[Mapping[str, str]] = {
    "time_s": "time from any beginning [s]",
    "latitude_deg": "latitude of the logged point (WGS 84)",
    "longitude_deg": "longitude of the logged point",
    "x_m": "easting of the logged point [m]",
    "y_m": "northing of the logged point [m]",
    "status": "kind of fix: 1 fixed, 2 float, 0 not known",
    "sd_m": "standard deviation of the position, as the receiver states it [m]",
    "yaw_rad": "heading, counter-clockwise from east [rad]",
    "speed_mps": "speed over ground, negative in reverse [m/s]",
    "yaw_rate_radps": "yaw rate, counter-clockwise [rad/s]",
    "roll_rad": "roll, positive with the left side up [rad]",
    "pitch_rad": "pitch, positive with the front down [rad]",
    "wheel_speed_mps": "speed of the rear wheels' circumference [m/s]",
    "steering_rad": "front steering angle, positive to the left [rad]",
    "trailer_steering_rad": "steering angle of the trailer, delta_i [rad]",
    "hitch_rad": "yaw of the tractor minus yaw of the drawbar, beta [rad]",
    "steering_command_rad": "commanded front steering angle [rad]",
    "trailer_steering_command_rad": "commanded steering angle of the trailer [rad]",
    "speed_command_mps": "commanded speed [m/s]",
    "hydrostat_command": "commanded hydrostat or throttle position, 0 to 1",
    "trailer_latitude_deg": "latitude of the trailer's logged point",
    "trailer_longitude_deg": "longitude of the trailer's logged point",
    "trailer_x_m": "easting of the trailer's logged point [m]",
    "trailer_y_m": "northing of the trailer's logged point [m]",
    "trailer_status": "kind of fix of the trailer's receiver",
    "trailer_yaw_rad": "heading of the trailer [rad]",
    "pose_x_m": "x of a pose, in the frame of its own program [m]",
    "pose_y_m": "y of a pose [m]",
    "pose_yaw_rad": "yaw of a pose [rad]",
    "trailer_pose_x_m": "x of the trailer's pose [m]",
    "trailer_pose_y_m": "y of the trailer's pose [m]",
    "trailer_pose_yaw_rad": "yaw of the trailer's pose [rad]",
}
"""Columns that a table may have, and their meaning."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Rows of a line or of a record; a row is NaN where a column has no sample."""

    coordinates: Coordinates
    columns: Mapping[str, FloatArray]  # (n,) each, by the names of `COLUMNS`
    name: str = ""  # of a line among others

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def places(self, body: str = "") -> FloatArray:
        """Return the places of the logged point, (n, 2), in the file's coordinates.

        `body` is "" for the tractor or the line, "trailer_" for the trailer.
        """
        first, second = PLACE_COLUMNS[self.coordinates]
        return np.column_stack([self.columns[body + first], self.columns[body + second]])


@dataclass(frozen=True, slots=True, eq=False)
class ForeignFile:
    """Content of a foreign file."""

    kind: str  # its format, in words
    tables: Sequence[Table]  # lines, or one record
    boundary: Sequence[FloatArray] = ()  # rings (n, 2) in the coordinates of the tables
    notes: tuple[str, ...] = ()  # what was left out, and what was assumed

    def table(self, name: str = "") -> Table:
        """Return the table of a name or of a number from 1; without one, the only table.

        Raises:
            UnreadableFile: there is none, or there are several to choose from.
        """
        names = [table.name or str(number) for number, table in enumerate(self.tables, 1)]
        if not names:
            raise UnreadableFile(f"is {self.kind} without a line or a track{_with(self.boundary)}")
        if not name and len(names) == 1:
            return self.tables[0]
        if name in names:
            return self.tables[names.index(name)]
        if name.isdecimal() and 1 <= int(name) <= len(names):
            return self.tables[int(name) - 1]
        shown = ", ".join(names[:10])
        raise UnreadableFile(
            f"is {self.kind} with {len(names)} lines: {shown}; choose one by path.line"
            + (f", which is {name!r}" if name else "")
        )


def _with(boundary: Sequence[FloatArray]) -> str:
    return f"; it has {len(boundary)} boundary rings" if boundary else ""


@dataclass(slots=True)
class Rows:
    """Rows of a record as they come; rows of one time that follow each other become one."""

    _rows: list[dict[str, float]] = field(default_factory=list)

    def add(self, time_s: float, values: Mapping[str, float]) -> None:
        """Add samples of a time [s].

        Raises:
            UnreadableFile: there are too many rows.
        """
        last = self._rows[-1] if self._rows else None
        if last is not None and last["time_s"] == time_s and not (last.keys() & values.keys()):
            last.update(values)
            return
        if len(self._rows) >= MOST_ROWS:
            raise UnreadableFile(f"has more than {MOST_ROWS} rows")
        self._rows.append({"time_s": time_s, **values})

    def add_to_last(self, values: Mapping[str, float]) -> None:
        """Add samples that belong to the latest row; before the first row they are dropped."""
        if self._rows:
            self._rows[-1].update(values)

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns; rows are in the order of their times."""
        names = dict.fromkeys(name for row in self._rows for name in row)
        columns = {name: np.array([row.get(name, np.nan) for row in self._rows]) for name in names}
        if not columns:
            return {}
        order = np.argsort(columns["time_s"], kind="stable")
        return {name: values[order] for name, values in columns.items()}


def degrees_table(places: Iterable[Sequence[float]], name: str = "") -> Table:
    """Return a line through latitudes and longitudes [deg].

    Raises:
        UnreadableFile: a place is not on the earth, or the line is too long.
    """
    line = np.array(list(places), dtype=float).reshape(-1, 2)
    if len(line) > MOST_ROWS:
        raise UnreadableFile(f"has a line of {len(line)} points, at most {MOST_ROWS} are read")
    check_degrees(line)
    return Table("degrees", {"latitude_deg": line[:, 0], "longitude_deg": line[:, 1]}, name)


def check_degrees(places: FloatArray) -> None:
    """Refuse latitudes and longitudes (n, 2) [deg] beyond their range; NaN is no sample."""
    wrong = np.flatnonzero((np.abs(places) > (90.0, 180.0)).any(axis=1) | np.isinf(places).any(1))
    if len(wrong):
        latitude, longitude = places[wrong[0]]
        raise UnreadableFile(
            f"point {wrong[0]} is at latitude {latitude:g}, longitude {longitude:g} deg; a "
            "latitude is within 90, a longitude within 180 (are they exchanged?)"
        )
