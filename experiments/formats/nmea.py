"""NMEA 0183 records of receivers, and $PANDA, $PAOGI of AgOpenGPS' boards."""

import functools
import math
import operator
import re
from collections.abc import Sequence
from typing import Final

from ..errors import UnreadableFile
from .table import ForeignFile, Rows, Table, check_degrees

_SENTENCE: Final = re.compile(r"\$(P[A-Z]{4}|[A-Z]{5}),([^*$\r\n]*)(?:\*([0-9A-Fa-f]{2}))?")
SEEN: Final = re.compile(r"\$(P(ANDA|AOGI)|[A-Z]{2}(GGA|RMC|VTG|GST|HDT|GSA|GLL|GNS|ZDA)),")
"""Sentences by which a text is known for such a record."""

_KNOT: Final = 1852.0 / 3600.0
_DAY_S: Final = 86_400.0
_STATUS: Final = {"4": 1.0, "5": 2.0}  # quality of GGA: RTK fixed, RTK float
_NO_HEADING: Final = 65535.0  # of PANDA


def read_nmea(text: str) -> ForeignFile:
    """Return the record in a text of sentences; anything before "$" in a line is ignored.

    Sentences with a wrong checksum are left out.

    Raises:
        UnreadableFile: there is no position, or a position is damaged.
    """
    rows = Rows()
    wrong = 0
    day_s = 0.0
    last_s = -math.inf
    for match in _SENTENCE.finditer(text):
        name, body, checksum = match.groups()
        if checksum and _checksum(f"{name},{body}") != int(checksum, 16):
            wrong += 1
            continue
        words = [word.strip() for word in body.split(",")]
        reader = _READERS.get(name if name.startswith("PA") else name[2:])
        values = reader(words) if reader else {}
        if not values:
            continue
        if "latitude_deg" not in values:
            rows.add_to_last(values)
            continue
        time_s = values.pop("time_s") + day_s
        if time_s < last_s - 0.5 * _DAY_S:  # midnight
            day_s += _DAY_S
            time_s += _DAY_S
        last_s = time_s
        rows.add(time_s, values)
    columns = rows.columns()
    if "latitude_deg" not in columns:
        raise UnreadableFile(
            f"is a record of NMEA 0183 without a position (GGA, PANDA or PAOGI); {wrong} sentences "
            "have a wrong checksum"
        )
    table = Table("degrees", columns)
    check_degrees(table.places())
    notes = (f"{wrong} sentences with a wrong checksum are left out",) if wrong else ()
    return ForeignFile("a record of NMEA 0183", (table,), notes=notes)


def _checksum(sentence: str) -> int:
    return functools.reduce(operator.xor, sentence.encode("ascii", "replace"), 0)


def _number(words: Sequence[str], place: int) -> float:
    """Return the number at a place; NaN where it is empty or missing."""
    try:
        return float(words[place])
    except (IndexError, ValueError):
        return math.nan


def _degrees(words: Sequence[str], place: int) -> float:
    """Return degrees of a word dddmm.mmmm and the hemisphere behind it."""
    value = _number(words, place)
    whole = math.floor(value / 100.0) if math.isfinite(value) else math.nan
    degrees = whole + (value - 100.0 * whole) / 60.0
    return -degrees if words[place + 1] in ("S", "W") else degrees


def _time(word: str) -> float:
    """Return the seconds of the day of a word hhmmss.ss."""
    value = _number([word], 0)
    if not 0.0 <= value < 240_000.0:
        return math.nan
    hours, rest = divmod(value, 10_000.0)
    minutes, seconds = divmod(rest, 100.0)
    return 3600.0 * hours + 60.0 * minutes + seconds


def _known(**values: float) -> dict[str, float]:
    return {name: value for name, value in values.items() if math.isfinite(value)}


def _gga(words: Sequence[str]) -> dict[str, float]:
    if len(words) < 6 or not words[1] or words[5] == "0":
        return {}
    if words[2] not in ("N", "S") or words[4] not in ("E", "W"):
        return {}  # a sentence whose fields were lost, by chance with the right checksum
    values = _known(
        time_s=_time(words[0]),
        latitude_deg=_degrees(words, 1),
        longitude_deg=_degrees(words, 3),
        status=_STATUS.get(words[5], 0.0),
    )
    return values if {"time_s", "latitude_deg", "longitude_deg"} <= values.keys() else {}


def _heading(clockwise_deg: float) -> float:
    return math.radians(90.0 - clockwise_deg)


def _board(words: Sequence[str], scale: float) -> dict[str, float]:
    """Return the values of a board's sentence; headings and rolls of PANDA are tenths."""
    values = _gga(words)
    heading = _number(words, 11)
    if heading == _NO_HEADING:
        heading = math.nan
    return values and values | _known(
        speed_mps=_KNOT * _number(words, 10),
        yaw_rad=_heading(scale * heading),
        roll_rad=math.radians(scale * _number(words, 12)),
    )


_READERS: Final = {
    "GGA": _gga,
    "VTG": lambda words: _known(speed_mps=_number(words, 6) / 3.6),
    "RMC": lambda words: _known(speed_mps=_KNOT * _number(words, 6)),
    "HDT": lambda words: _known(yaw_rad=_heading(_number(words, 0))),
    "GST": lambda words: _known(sd_m=math.hypot(_number(words, 5), _number(words, 6)) / 2**0.5),
    "PANDA": lambda words: _board(words, 0.1),
    "PAOGI": lambda words: _board(words, 1.0),
}
