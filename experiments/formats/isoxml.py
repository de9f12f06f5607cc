"""ISOXML (ISO 11783-10): guidance lines and boundaries of TASKDATA.XML, binary time logs."""

import struct
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import UnreadableFile
from .table import ForeignFile, Rows, Table, check_degrees, degrees_table
from .text import number_of, parse_xml, read_data, read_text

_GUIDANCE: Final = "5"  # types of a LineString, attribute A
_RINGS: Final = ("1", "2")  # exterior, interior
_DEGREES: Final = 1e-7  # unit of a binary position
_DAY_S: Final = 86_400.0
_MOST_VALUES: Final = 255

# Fields of a record in a time log: attribute of PTN, format, name.
_POSITION: Final = (
    ("A", "i", "north"),
    ("B", "i", "east"),
    ("C", "i", "up"),
    ("D", "B", "status"),
    ("E", "H", "pdop"),
    ("F", "H", "hdop"),
    ("G", "B", "satellites"),
    ("H", "I", "utc_time"),
    ("I", "H", "utc_date"),
)
_FIXED: Final = 4  # status of a position as in NMEA 0183: RTK fixed, RTK float
_FLOAT: Final = 5
_NO_POSITION: Final = 2**31 - 1


def read_taskdata(root: Element) -> ForeignFile:
    """Return guidance lines and boundaries of the fields in a TASKDATA document.

    Files that it names, external lists and time logs, are not followed.

    Raises:
        UnreadableFile: a coordinate is no number.
    """
    lines = []
    rings = []
    for line in root.iter("LSG"):
        places = [
            (number_of(point.get("C"), "PNT C"), number_of(point.get("D"), "PNT D"))
            for point in line.iter("PNT")
        ]
        if line.get("A") == _GUIDANCE and places:
            lines.append(degrees_table(places, line.get("B") or ""))
        elif line.get("A") in _RINGS and places:
            rings.append(np.array(places))
    logs = [str(log.get("A")) for log in root.iter("TLG")]
    links = sum(1 for _ in root.iter("XFR"))
    notes = []
    if logs:
        notes.append(f"time logs are files of their own: {', '.join(logs[:5])}.bin")
    if links:
        notes.append(f"{links} external files are not followed")
    return ForeignFile("ISOXML", lines, rings, tuple(notes))


def read_time_log(file: Path) -> ForeignFile:
    """Return the positions of a binary time log; the XML file of its name describes the records.

    Raises:
        UnreadableFile: the description is missing or foreign, or there is no position.
    """
    described = [file.with_suffix(suffix) for suffix in (".xml", ".XML")]
    header = next((each for each in described if each.is_file()), None)
    if header is None:
        raise UnreadableFile(
            f"is a time log of ISOXML; {described[0].name}, which describes its records, must be "
            "beside it"
        )
    root = parse_xml(read_text(header))
    position = root.find("PTN") if root.tag == "TIM" else root.find("TIM/PTN")
    if position is None:
        raise UnreadableFile(f"{header.name} has no position (TIM, PTN)")
    present = [field for field in _POSITION if position.get(field[0]) == ""]
    head = struct.Struct("<IH" + "".join(kind for _, kind, _ in present) + "B")
    names = ["ms", "day", *(name for _, _, name in present), "count"]
    data = read_data(file)

    rows = Rows()
    place = 0
    while place + head.size <= len(data):
        record = dict(zip(names, head.unpack_from(data, place), strict=True))
        place += head.size + 5 * record["count"]
        if record.get("north", _NO_POSITION) == _NO_POSITION or not record["day"]:
            continue
        status = {_FIXED: 1.0, _FLOAT: 2.0}.get(record.get("status", 0), 0.0)
        rows.add(
            record["day"] * _DAY_S + 1e-3 * record["ms"],
            {
                "latitude_deg": record["north"] * _DEGREES,
                "longitude_deg": record["east"] * _DEGREES,
                "status": status,
            },
        )
    columns = rows.columns()
    if "latitude_deg" not in columns:
        raise UnreadableFile(f"has no position in its {len(data)} bytes")
    table = Table("degrees", columns, file.stem)
    check_degrees(table.places())
    if (np.abs(np.diff(columns["time_s"])) > _DAY_S).any():
        raise UnreadableFile(
            f"has days between its records: it does not fit {header.name}, or is damaged"
        )
    notes = ("the last record is cut off",) if place != len(data) else ()
    return ForeignFile("a time log of ISOXML", (table,), notes=notes)
