"""Text and XML of foreign files: encodings, and what the file is where it is no text."""

import re
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree
from defusedxml import DefusedXmlException

from ...testbed.foreign_files import MOST_TEXT_BYTES, read_bounded
from ..errors import UnreadableFile

_SIGNATURES: Final = (
    (b"PK\x03\x04", "is a ZIP archive (as KMZ, XLSX or an exported folder): unpack it, or save "
     "it as text"),
    (b"\x1f\x8b", "is compressed by gzip: unpack it"),
    (b"\x28\xb5\x2f\xfd", "is compressed by zstd: unpack it"),
    (b"\xd0\xcf\x11\xe0", "is an Excel workbook: save it as CSV"),
    (b"ULog", "is a ULog of PX4, which is not read: convert it to CSV (ulog2csv)"),
    (b"\xa3\x95", "is a DataFlash log of ArduPilot, which is not read: convert it to CSV"),
    (b"%PDF", "is a PDF document"),
    (b"\x00\x00\x27\x0a", "is a shapefile, which is not read: save it as GeoJSON in WGS 84"),
)  # fmt: skip
_WEB_PAGE: Final = re.compile(r"\s*(<!--.*?-->\s*)*<(!doctype\s+html|html)\b", re.IGNORECASE)


def read_text(file: Path) -> str:
    """Return the text of a file in UTF-8, UTF-16 with a mark, or Windows-1252.

    Raises:
        UnreadableFile: the file cannot be read, or is no text; the message says what it is.
    """
    data = read_data(file)
    for signature, what in _SIGNATURES:
        if data.startswith(signature):
            raise UnreadableFile(what)
    marked = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = data.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        if marked or b"\0" in data:
            raise UnreadableFile("is a binary file of an unknown kind, not text") from None
        text = data.decode("cp1252", errors="replace")  # German names from Windows programs
    if "\0" in text:
        raise UnreadableFile(
            "has characters NUL, as UTF-16 without a byte order mark: save as UTF-8"
        )
    if _WEB_PAGE.match(text):
        raise UnreadableFile("is a web page (HTML): the download gave a page instead of the file")
    return text


def read_data(file: Path) -> bytes:
    """Return the bytes of a file of bounded size.

    Raises:
        UnreadableFile: it cannot be read.
    """
    try:
        return read_bounded(file, MOST_TEXT_BYTES)
    except OSError as error:
        raise UnreadableFile(f"cannot be read: {error.strerror}") from None


def parse_xml(text: str) -> Element:
    """Return the root of an XML document, names without their name spaces.

    Entities, document types and references to other files are refused.

    Raises:
        UnreadableFile: the text is no XML, or has declarations that are not allowed.
    """
    text = re.sub(r"^\s*<\?xml[^>]*\?>", "", text, count=1)  # the text is decoded already
    try:
        root = defusedxml.ElementTree.fromstring(text, forbid_dtd=True)
    except DefusedXmlException as error:
        what = type(error).__name__
        raise UnreadableFile(
            f"is XML with a document type or an entity, which is not allowed ({what})"
        ) from None
    except (ParseError, ValueError) as error:
        raise UnreadableFile(f"is damaged XML: {error}") from None
    except RecursionError:
        raise UnreadableFile("is XML that is nested too deeply") from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    return root


def number_of(word: str | None, what: str) -> float:
    """Return a finite number.

    Raises:
        UnreadableFile: it is none; the message has `what`.
    """
    try:
        value = float(word or "")
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise UnreadableFile(f"{what} is {(word or '')[:60]!r}, must be a finite number")
    return value
