"""Reader of foreign files: what a file is, and the reader of its format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..errors import UnreadableFile
from . import agopengps, nmea
from .columns import read_columns
from .geographic import read_geojson, read_gpx, read_kml
from .isoxml import read_taskdata, read_time_log
from .mapping import FormatMap
from .text import parse_xml, read_text

if TYPE_CHECKING:
    from .table import ForeignFile

FORMATS: Final = (
    "columns of text (CSV), GeoJSON, KML, GPX, TASKDATA.XML and TLG logs of ISOXML, a field folder "
    "of AgOpenGPS, NMEA 0183 with $PANDA and $PAOGI, rosbag2, MCAP or .bag of ROS"
)
"""Formats that are read, in words."""

_ROS_SUFFIXES: Final = (".mcap", ".db3", ".bag")
_ELEVATIONS: Final = "Latitude,Longitude,Elevation"  # header in Elevation.txt of AgOpenGPS


def read_foreign(path: Path, mapping: FormatMap | None = None) -> ForeignFile:
    """Return the content of a file, or of the folder of a program.

    Raises:
        UnreadableFile: it is missing, damaged, too large, or of a format that is not read.
    """
    mapping = mapping or FormatMap()
    try:
        return _read(path, mapping)
    except UnreadableFile as error:
        raise UnreadableFile(f"{path}: {error}") from None


def _read(path: Path, mapping: FormatMap) -> ForeignFile:
    if path.is_dir():
        return _read_folder(path, mapping)
    if path.suffix.lower() in _ROS_SUFFIXES:
        return _read_ros(path, mapping)
    if path.suffix.lower() == ".bin" and path.stem.upper().startswith("TLG"):
        return read_time_log(path)
    text = read_text(path)
    begin = text.lstrip()
    if begin.startswith("<"):
        return _read_xml(text)
    if begin.startswith(("{", "[")) or path.suffix.lower() == ".geojson":
        return read_geojson(text)
    if begin.startswith(agopengps.HEADERS):
        return agopengps.read_field(path.parent, path.name)
    if nmea.SEEN.search(text[:100_000]):
        return nmea.read_nmea(text)
    if (place := text.find(_ELEVATIONS)) > 0:
        text = text[place:]
    return read_columns(text, mapping.columns, mapping.decimal)


def _read_folder(folder: Path, mapping: FormatMap) -> ForeignFile:
    if (folder / "metadata.yaml").is_file():
        return _read_ros(folder, mapping)
    if agopengps.is_field(folder):
        return agopengps.read_field(folder)
    for name in ("TASKDATA.XML", "TASKDATA.xml", "taskdata.xml"):
        if (folder / name).is_file():
            return _read_xml(read_text(folder / name))
    raise UnreadableFile(
        "is a folder without metadata.yaml (rosbag2), TrackLines.txt (AgOpenGPS) or TASKDATA.XML"
    )


def _read_xml(text: str) -> ForeignFile:
    root = parse_xml(text)
    readers = {"kml": read_kml, "gpx": read_gpx, "ISO11783_TaskData": read_taskdata}
    if root.tag not in readers:
        raise UnreadableFile(f"is XML <{root.tag[:40]}>; of XML are read: {', '.join(readers)}")
    return readers[root.tag](root)


def _read_ros(path: Path, mapping: FormatMap) -> ForeignFile:
    # Imported here, since rosbags is an extra.
    from .ros import read_bag

    return read_bag(path, mapping)
