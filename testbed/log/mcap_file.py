"""MCAP writer: one chunk per flush, zstandard compression, all indexes.

The format is that of https://mcap.dev/spec. Messages and their index records are packed here; all
other records are those of the package `mcap`. With the package's own writer, messages and their
index took three quarters of the time of logging.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping
from typing import BinaryIO, Final

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

# opcode, length, channel, sequence, log time, publish time; the data follow
_MESSAGE: Final = struct.Struct("<BQHIQQ")
_MESSAGE_HEAD: Final = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)  # the same
_MESSAGE_HEAD_BYTES: Final = 22  # of the length: without opcode and length
# opcode, length, channel, bytes of the pairs (time, offset in the chunk) that follow
_MESSAGE_INDEX: Final = struct.Struct("<BQHI")
_MESSAGE_INDEX_HEAD_BYTES: Final = 6
_LEVEL: Final = -1  # of zstandard: 2 % more bytes than with 1, in 80 % of the time
_FOOTER: Final = struct.Struct("<BQQQ")  # the part of it that its checksum covers


class McapFile:
    """Writer of an MCAP file of protobuf messages to a stream that supports `tell`.

    Metadata, attachments and topics come first, then messages.
    """

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream = stream
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._described: list[AttachmentIndex | MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._buffer = bytearray()
        self._places: list[array] = []  # by channel: time [ns] and offset of every message
        self._crc = 0  # of all bytes written so far
        self._put(MCAP0_MAGIC)
        self._write(Header("", library))

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write key-value pairs."""
        offset = self._stream.tell()
        length = self._write(Metadata(name=name, metadata=dict(content)))
        self._described.append(MetadataIndex(offset=offset, length=length, name=name))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment."""
        offset = self._stream.tell()
        length = self._write(
            Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)
        )
        self._described.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_topic(
        self, name: str, schema_name: str, schema: bytes, metadata: Mapping[str, str]
    ) -> int:
        """Write schema and channel of a topic, and return the number of the channel."""
        ids = {each.name: each.id for each in self._schemas}
        if schema_name not in ids:
            ids[schema_name] = len(self._schemas) + 1
            self._schemas.append(
                Schema(ids[schema_name], schema, SchemaEncoding.Protobuf, schema_name)
            )
            self._write(self._schemas[-1])
        number = len(self._channels) + 1
        self._channels.append(
            Channel(number, name, MessageEncoding.Protobuf, dict(metadata), ids[schema_name])
        )
        self._write(self._channels[-1])
        self._places.append(array("Q"))
        return number

    def add_message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add one message to the current chunk."""
        buffer = self._buffer
        self._places[channel - 1].extend((time_ns, len(buffer)))
        length = _MESSAGE_HEAD_BYTES + len(data)
        buffer += _MESSAGE.pack(Opcode.MESSAGE, length, channel, 0, time_ns, time_ns)
        buffer += data

    def add_messages(
        self, channel: int, times_ns: NDArray[np.int64], messages: NDArray[np.uint8]
    ) -> None:
        """Add messages of one length, (n, bytes), to the current chunk."""
        count, size = messages.shape
        heads = np.zeros(count, _MESSAGE_HEAD)
        heads["opcode"], heads["channel"] = Opcode.MESSAGE, channel
        heads["length"] = _MESSAGE_HEAD_BYTES + size
        heads["log_time"] = heads["publish_time"] = times_ns
        block = np.column_stack([heads.view(np.uint8).reshape(count, -1), messages])
        places = len(self._buffer) + block.shape[1] * np.arange(count)
        self._places[channel - 1].frombytes(np.column_stack([times_ns, places]).tobytes())
        self._buffer += block.tobytes()

    def flush(self) -> None:
        """Write the current chunk and flush the stream."""
        if self._buffer:
            self._end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the last chunk and the indexes; the stream stays open."""
        self.flush()
        self._write(DataEnd(self._crc))
        start, summary, offsets = self._stream.tell(), RecordBuilder(), []
        for opcode, records in self._summary().items():
            place = summary.count
            for record in records:
                record.write(summary)
            if records:
                offsets.append(SummaryOffset(opcode, summary.count - place, start + place))
        offset_start = start + summary.count
        for offset in offsets:
            offset.write(summary)
        data = summary.end()
        footer_start = _FOOTER.pack(Opcode.FOOTER, 20, start, offset_start)
        self._stream.write(data)
        self._write(Footer(start, offset_start, zlib.crc32(footer_start, zlib.crc32(data))))
        self._stream.write(MCAP0_MAGIC)

    def _write(self, record: McapRecord) -> int:
        """Write a record and return its length in the file."""
        builder = RecordBuilder()
        record.write(builder)
        data = builder.end()
        self._put(data)
        return len(data)

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._crc = zlib.crc32(data, self._crc)

    def _end_chunk(self) -> None:
        data, self._buffer = bytes(self._buffer), bytearray()
        times = [(places[::2], number) for number, places in enumerate(self._places, 1) if places]
        first = min(min(each) for each, _ in times)
        last = max(max(each) for each, _ in times)
        for each, number in times:
            self._counts[number] = self._counts.get(number, 0) + len(each)
        packed = zstandard.compress(data, level=_LEVEL)
        offset = self._stream.tell()
        length = self._write(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        index_start, offsets = self._stream.tell(), {}
        for number, places in enumerate(self._places, 1):
            if places:
                offsets[number] = self._stream.tell()
                pairs = places.tobytes()
                content_bytes = _MESSAGE_INDEX_HEAD_BYTES + len(pairs)
                head = _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, content_bytes, number, len(pairs))
                self._put(head + pairs)
                self._places[number - 1] = array("Q")
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=offset,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=self._stream.tell() - index_start,
                compression="zstd",
                compressed_size=len(packed),
                uncompressed_size=len(data),
            )
        )

    def _summary(self) -> dict[Opcode, list[McapRecord]]:
        """Return the records at the end of the file, by kind."""
        attachments = [each for each in self._described if isinstance(each, AttachmentIndex)]
        metadata = [each for each in self._described if isinstance(each, MetadataIndex)]
        statistics = Statistics(
            attachment_count=len(attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((each.message_end_time for each in self._chunks), default=0),
            message_start_time=min((each.message_start_time for each in self._chunks), default=0),
            metadata_count=len(metadata),
            schema_count=len(self._schemas),
        )
        return {
            Opcode.SCHEMA: list(self._schemas),
            Opcode.CHANNEL: list(self._channels),
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: list(self._chunks),
            Opcode.ATTACHMENT_INDEX: list(attachments),
            Opcode.METADATA_INDEX: list(metadata),
        }
