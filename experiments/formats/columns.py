"""Columns of text: CSV with any usual delimiter, decimal points or commas, named columns."""

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, time
from types import MappingProxyType
from typing import Final

import numpy as np

from ttempc.suggestion import did_you_mean

from ..errors import UnreadableFile
from .table import COLUMNS, MOST_ROWS, ForeignFile, Table, check_degrees

_SHOWN: Final = 60  # characters of a wrong value
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_EXCEL: Final = re.compile(r"sep=(.)")  # a first line that tells Excel the delimiter
_UNIT: Final = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]$")
_KMH: Final = 1.0 / 3.6
_KNOT: Final = 1852.0 / 3600.0

# Columns without a header, by their number.
_UNNAMED: Final = {2: ("x_m", "y_m"), 3: ("x_m", "y_m", "speed_mps")}

# Units as they stand in headers, in the form that ends the names of `TARGETS`.
_UNITS: Final = {
    **dict.fromkeys(("m/s", "mps", "ms-1"), "mps"),
    **dict.fromkeys(("km/h", "kmh", "kph", "kmph"), "kmh"),
    **dict.fromkeys(("kn", "kt", "kts", "knots"), "knots"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("deg/s", "degps", "°/s"), "degps"),
    **dict.fromkeys(("rad/s", "radps"), "radps"),
    **{unit: unit for unit in ("m", "s", "ms", "us", "ns", "rad", "iso")},
}
# Quantities as they stand in headers, and their unit where the header names none.
_QUANTITIES: Final = {
    **dict.fromkeys(("lat", "latitude"), ("latitude", "deg")),
    **dict.fromkeys(("lon", "lng", "long", "longitude"), ("longitude", "deg")),
    **dict.fromkeys(("x", "east", "easting", "utm_x", "utm_e"), ("x", "m")),
    **dict.fromkeys(("y", "north", "northing", "utm_y", "utm_n"), ("y", "m")),
    **dict.fromkeys(("speed", "v", "velocity"), ("speed", "mps")),
    **dict.fromkeys(("heading", "course", "bearing"), ("heading", "deg")),
    **dict.fromkeys(("time", "t", "timestamp", "date", "datetime"), ("time", "")),
    **{name: (name, "") for name in ("yaw", "yaw_rate", "roll", "pitch")},
    **{name: (name, "") for name in ("steering", "trailer_steering", "hitch")},
}
# Columns of `ttempc log export`: the topic /state.
_OWN: Final = {
    "x_t_m": "x_m",
    "y_t_m": "y_m",
    "psi_t_rad": "yaw_rad",
    "v_mps": "speed_mps",
    "yaw_rate_t_radps": "yaw_rate_radps",
    "delta_t_rad": "steering_rad",
    "delta_i_rad": "trailer_steering_rad",
    "beta_rad": "hitch_rad",
    "x_i_m": "trailer_x_m",
    "y_i_m": "trailer_y_m",
    "psi_i_rad": "trailer_yaw_rad",
}


def _targets() -> dict[str, tuple[str, float, float]]:
    """Return column, factor and offset for every name of a quantity with a unit."""
    targets: dict[str, tuple[str, float, float]] = {}
    for name in COLUMNS:
        quantity, _, unit = name.rpartition("_")
        targets[name] = (name, 1.0, 0.0)
        if unit in ("rad", "radps"):
            targets[f"{quantity}_{unit.replace('rad', 'deg')}"] = (name, math.pi / 180.0, 0.0)
        if unit == "mps":
            targets[f"{quantity}_kmh"] = (name, _KMH, 0.0)
            targets[f"{quantity}_knots"] = (name, _KNOT, 0.0)
    for body in ("", "trailer_"):  # a heading is clockwise from north
        targets[f"{body}heading_deg"] = (f"{body}yaw_rad", -math.pi / 180.0, math.pi / 2.0)
        targets[f"{body}heading_rad"] = (f"{body}yaw_rad", -1.0, math.pi / 2.0)
    for unit, seconds in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("iso", 1.0)):
        targets[f"time_{unit}"] = ("time_s", seconds, 0.0)
    return targets


TARGETS: Final[Mapping[str, tuple[str, float, float]]] = MappingProxyType(_targets())
"""Names of a column map: column of the table, factor and offset from the unit of the name."""


def read_columns(
    text: str, columns: Mapping[str, str] = MappingProxyType({}), decimal: str = ""
) -> ForeignFile:
    """Return the table in a text of columns.

    Args:
        text: lines with the delimiter ";", tab, "," or blanks. A first line of words is a header;
            without one, two or three columns are x y [speed]. Lines that begin with # are comments.
        columns: names in the header by names of `TARGETS`; a name after "-" changes the sign.
        decimal: decimal character, "." or ","; empty: as the numbers say.

    Raises:
        UnreadableFile: with the line and the cause.
    """
    if (count := text.count("\n")) > MOST_ROWS:
        raise UnreadableFile(f"has {count} lines, at most {MOST_ROWS} are read")
    numbered = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1)]
    delimiter = ""
    if numbered and (excel := _EXCEL.fullmatch(numbered[0][1])):
        delimiter = excel[1]
        numbered = numbered[1:]
    lines = _without_comments(numbered)
    if not lines:
        raise UnreadableFile("is empty, must have points")
    split = _splitter([line for _, line in lines], delimiter)
    rows = [(number, split(line)) for number, line in lines]
    header, rows = _header(rows, columns)
    used, notes = _used_columns(header, columns, rows[0][1] if rows else ())
    _check_widths(rows, len(header))
    decimal = decimal or _decimal(rows, used)
    values = {
        target: np.array([_cell(number, row[k], target, decimal) for number, row in rows])
        for target, k in used.items()
    }
    table = _in_si(values, columns)
    if not rows:
        raise UnreadableFile("has a header and no rows")
    return ForeignFile("a table of columns", (table,), notes=notes)


def _without_comments(lines: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return the lines without comments and empty ones; the first comment may be the header."""
    kept = [(number, line) for number, line in lines if line and not line.startswith("#")]
    for number, line in lines:
        if not line:
            continue
        words = {_base(word) for word in re.split(r"[,;\s]+", line.lstrip("# "))}
        if line.startswith("#") and ({"x", "y"} <= words or {"latitude", "longitude"} <= words):
            return [(number, line.lstrip("# ")), *kept]
        break
    return kept


def _splitter(lines: Sequence[str], given: str = "") -> Callable[[str], list[str]]:
    """Return the function that splits a line by the delimiter of most of the first lines."""
    some = lines[:50]
    if given:
        return lambda line: [word.strip() for word in _quoted(line, given)]
    for delimiter in (";", "\t", ","):
        if sum(delimiter in line for line in some) > 0.5 * len(some):
            if delimiter == "," and _blanks_between_decimals(some):
                break
            return lambda line: [word.strip() for word in _quoted(line, delimiter)]
    return lambda line: [word.strip("\"',") for word in line.split()]


def _quoted(line: str, delimiter: str) -> list[str]:
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def _blanks_between_decimals(lines: Sequence[str]) -> bool:
    """Return whether lines look like "1,5 0,25": blanks delimit, commas are decimal."""
    tokens = [line.split() for line in lines[1:] or lines]
    return all(
        len(words) > 1 and all(re.fullmatch(r"[+-]?\d+(,\d+)?", word) for word in words)
        for words in tokens
    )


def _header(
    rows: list[tuple[int, list[str]]], columns: Mapping[str, str]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the names of the columns and the rows below them."""
    number, words = rows[0]
    numbers = sum(map(_is_number, words))
    if numbers > 0.5 * len(words) and numbers < len(words):
        raise UnreadableFile(
            f"line {number}: {' '.join(words)[:100]!r} is neither a header nor all numbers"
            f"{_comma_hint([word for word in words if _is_number(word)])}"
        )
    if any(word and not _is_number(word) for word in words):
        return words, rows[1:]
    if columns:
        raise UnreadableFile(f"line {number}: has no header, the map's [columns] needs one")
    if len(words) not in _UNNAMED:
        raise UnreadableFile(
            f"line {number}: got {len(words)} columns, must be 2 (x y), 3 (x y speed), or have a "
            f"header{_comma_hint(words)}"
        )
    if all(_may_be_degrees(row) for _, row in rows):
        raise UnreadableFile(
            f"line {number}: numbers without a header differ by less than 0.1 and may be degrees; "
            "name the columns in a first line: lat,lon or x,y"
        )
    return list(_UNNAMED[len(words)]), rows


def _may_be_degrees(row: Sequence[str]) -> bool:
    digits = [word.replace(",", ".").rpartition(".")[2] for word in row[:2]]
    return all(len(word) >= 5 and word.isdecimal() for word in digits) and all(
        _is_number(word) and abs(float(word.replace(",", "."))) <= 180.0 for word in row[:2]
    )


def _comma_hint(words: Sequence[str]) -> str:
    whole = all(re.fullmatch(r"[+-]?\d+", word) for word in words)
    if not whole or len(words) % 2:
        return ""
    return (
        "; decimal commas between column commas cannot be told apart: save with semicolons or "
        "decimal points"
    )


def _used_columns(
    header: Sequence[str], columns: Mapping[str, str], first: Sequence[str]
) -> tuple[dict[str, int], tuple[str, ...]]:
    """Return the places of the columns that are used by names of `TARGETS`, and notes."""
    used: dict[str, int] = {}
    notes: list[str] = []
    for target, source in columns.items():
        if target not in TARGETS:
            raise UnreadableFile(
                f"map: columns.{target}: unknown column{did_you_mean(target, list(TARGETS))}; "
                f"allowed: {', '.join(TARGETS)}"
            )
        name = source.removeprefix("-").strip()
        if header.count(name) != 1:
            raise UnreadableFile(
                f"map: columns.{target} = {source!r}: the header has {', '.join(header)[:300]}"
            )
        used[target] = header.index(name)
    for k, word in enumerate(header):
        target, note = _target(word, first[k] if k < len(first) else "")
        taken = {TARGETS[name][0] for name in used}
        if note:
            notes.append(note)
        if target and TARGETS[target][0] not in taken:
            used[target] = k
        elif target and not columns and TARGETS[target][0] in ("x_m", "y_m", "latitude_deg"):
            raise UnreadableFile(f"header {' '.join(header)[:300]}: {target} twice")
    found = {TARGETS[name][0] for name in used}
    if not ({"x_m", "y_m"} <= found or {"latitude_deg", "longitude_deg"} <= found):
        raise UnreadableFile(
            f"line 1: header {' '.join(header)[:300]}: needs columns lat and lon, or x and y "
            "(easting, northing); may have speed, heading, time"
        )
    return used, tuple(notes)


def _base(word: str) -> str:
    """Return the quantity of a header's word, the word itself if it is none."""
    target, _ = _target(word, "")
    return target.rpartition("_")[0] if target else word.strip("\"'").lower()


def _target(word: str, sample: str) -> tuple[str, str]:
    """Return the name in `TARGETS` of a header's word, empty for none, and a note."""
    name = word.strip().strip("\"'").strip().lower().replace(" ", "_")
    name = _OWN.get(name, name)
    if name in TARGETS:
        return name, ""
    match = _UNIT.search(name)
    unit = _UNITS.get(match[1], "") if match else ""
    name = name[: match.start()].rstrip("_") if match else name
    base, _, suffix = name.rpartition("_")
    if base and suffix in _UNITS:
        name = base
        unit = _UNITS[suffix]
    if name not in _QUANTITIES:
        return "", ""
    quantity, default = _QUANTITIES[name]
    if quantity == "time" and not unit:
        unit = "s" if _is_number(sample) else "iso"
    unit = unit or default
    if not unit:
        return "", f"column {word!r} is left out: its header names no unit, as {name}_deg"
    target = f"{quantity}_{unit}"
    return (target, "") if target in TARGETS else ("", f"column {word!r} is left out: its unit")


def _check_widths(rows: Sequence[tuple[int, list[str]]], width: int) -> None:
    for number, row in rows:
        if len(row) == width + 1 and not row[-1]:
            row.pop()  # a delimiter at the end of the line
        if len(row) != width:
            hint = _comma_hint([*row, *row[: len(row) % 2]]) if len(row) > width else ""
            raise UnreadableFile(f"line {number}: got {len(row)} columns, must be {width}{hint}")


def _decimal(rows: Sequence[tuple[int, list[str]]], used: Mapping[str, int]) -> str:
    """Return the decimal character of the numbers.

    Raises:
        UnreadableFile: some have points and some have commas.
    """
    seen = {}
    for number, row in rows:
        for target, k in used.items():
            if target == "time_iso":
                continue
            for character in ".,":
                if character in row[k]:
                    seen.setdefault(character, (number, row[k]))
    if len(seen) == 2:
        (first, one), (second, other) = seen.values()
        raise UnreadableFile(
            f"lines {first} and {second}: {one!r} and {other!r} mix decimal points and commas"
        )
    return next(iter(seen), ".")


def _cell(number: int, word: str, target: str, decimal: str) -> float:
    """Return the number in a cell; an empty one is NaN."""
    if not word or word.lower() == "nan":
        return math.nan
    if target == "time_iso":
        return _seconds(number, word)
    plain = word.replace(",", ".") if decimal == "," else word
    if not _is_number(plain) or (decimal == "," and word.count(",") > 1):
        shown = target.rpartition("_")[0] or target
        raise UnreadableFile(
            f"line {number}: {shown} is {word[:_SHOWN]!r}, must be a finite number"
        )
    return float(plain)


def _seconds(number: int, word: str) -> float:
    """Return seconds of a date and time, or of a time of day."""
    try:
        if ":" in word and "-" not in word and "T" not in word and "." not in word[:6]:
            moment = time.fromisoformat(word)
            whole = 3600 * moment.hour + 60 * moment.minute + moment.second
            return whole + 1e-6 * moment.microsecond
        date = datetime.fromisoformat(word.replace("/", "-"))
    except ValueError:
        raise UnreadableFile(
            f"line {number}: time is {word[:_SHOWN]!r}, must be seconds or a date and time as "
            "2026-05-01T08:00:00.2"
        ) from None
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _in_si(values: Mapping[str, np.ndarray], columns: Mapping[str, str]) -> Table:
    """Return the table in SI units and in our signs."""
    converted = {}
    for target, numbers in values.items():
        name, factor, offset = TARGETS[target]
        sign = -1.0 if columns.get(target, "").startswith("-") else 1.0
        converted[name] = sign * factor * numbers + offset
    degrees = "latitude_deg" in converted
    table = Table("degrees" if degrees else "metres", converted)
    if degrees:
        check_degrees(table.places())
    return table


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return bool(_DECIMAL_COMMA.fullmatch(word))
