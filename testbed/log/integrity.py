"""Checksums of a log file: together they cover every byte of it."""

from __future__ import annotations

import struct
import zlib
from typing import Final

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

# Records with opcode and length, https://mcap.dev/spec#records
_DATA_END: Final = struct.Struct("<BQI")  # checksum of the data section
_FOOTER: Final = struct.Struct("<BQQQI")  # starts of summary and offsets, checksum of the summary
_FOOTER_CRC_BYTES: Final = 4


def integrity_error(data: bytes) -> str | None:
    """Return the reason why a log is not as it was written, None if all checksums are correct.

    The checksum of the data section covers the bytes up to its end, that of the footer the summary
    and the footer; the two records that hold them have one place and one length.
    """
    footer = len(data) - _FOOTER.size - len(MCAP0_MAGIC)
    if footer < len(MCAP0_MAGIC) + _DATA_END.size or not data.endswith(MCAP0_MAGIC):
        return "truncated"
    opcode, length, start, _, summary_crc = _FOOTER.unpack_from(data, footer)
    data_end = start - _DATA_END.size
    if (opcode, length) != (Opcode.FOOTER, 20) or not len(MCAP0_MAGIC) <= data_end < footer:
        return "footer damaged"
    if zlib.crc32(data[start : footer + _FOOTER.size - _FOOTER_CRC_BYTES]) != summary_crc:
        return "checksum of the summary wrong"
    opcode, length, data_crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, 4):
        return "end of the data section damaged"
    if data_crc == 0:
        return "no checksum of the data section"
    if zlib.crc32(memoryview(data)[:data_end]) != data_crc:
        return "checksum of the data section wrong"
    return None
