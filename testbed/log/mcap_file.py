"""MCAP file whose messages come in arrays: a chunk per flush, with all indexes and checksums.

mcap's own writer takes messages one by one, which costs a run more than all else of its log. Here
the messages of a topic lie side by side in a chunk, where they compress well; readers go by the
index, which has their times. https://mcap.dev/spec
"""

import struct
import zlib
from collections import Counter
from typing import BinaryIO, Final

import numpy as np
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from zstandard import ZstdCompressor

_LEVEL: Final = -1  # of zstd: 3 takes twice its time for 5 % of the size
_ZSTD: Final = "zstd"
# Of a message, before its data: opcode, length from the channel on, channel, sequence, two times
_HEAD: Final = struct.Struct("<BQHIQQ")
_TIMES: Final = 15  # their place in it
_SUMMARY: Final = (
    *(records.Schema, records.Channel, records.Statistics),
    *(records.ChunkIndex, records.AttachmentIndex, records.MetadataIndex),
)


class McapFile:
    """Writer of an MCAP file; all but `add` raise the `OSError` of its stream, which stays open."""

    def __init__(self, stream: BinaryIO, library: str) -> None:
        self._stream = stream
        self._place = 0
        self._crc = 0
        self._builder = RecordBuilder()
        self._compressor = ZstdCompressor(_LEVEL)
        self._summary: list[records.McapRecord] = []
        self._parts: list[memoryview] = []  # of the next chunk
        self._size = 0  # bytes of the parts so far
        self._index: dict[int, list[NDArray[np.uint64]]] = {}  # of its channels: times, places
        self._counts: Counter[int] = Counter()  # messages of each channel
        self._spans: list[int] = []  # first and last times [ns] of the chunks
        self._write(MCAP0_MAGIC)
        self.put(records.Header("", library))

    def put(self, record: records.McapRecord) -> tuple[int, int]:
        """Write a record, and list it in the summary; return its place and length."""
        place = self._place
        record.write(self._builder)
        self._write(self._builder.end())
        length = self._place - place
        match record:
            case records.Schema() | records.Channel():
                self._summary.append(record)
            case records.Metadata(name=name):
                self._summary.append(records.MetadataIndex(place, length, name))
            case records.Attachment(name=name, media_type=kind, data=data):
                index = records.AttachmentIndex(place, length, 0, 0, len(data), name, kind)
                self._summary.append(index)
            case _:
                pass
        return place, length

    def add(self, channel: int, times_ns: NDArray[np.int64], messages: NDArray[np.uint8]) -> None:
        """Add messages (n, bytes) of a channel at the times (n,) [ns] to the next chunk."""
        count, length = messages.shape
        head = _HEAD.pack(Opcode.MESSAGE, 22 + length, channel, 0, 0, 0)
        stride = _HEAD.size + length
        size = self._size
        part = np.empty((count, stride), np.uint8)
        part[:, : _HEAD.size] = np.frombuffer(head, np.uint8)
        part[:, _HEAD.size :] = messages
        np.ndarray((count, 2), "<u8", part.data, _TIMES, (stride, 8))[:] = times_ns[:, None]
        index = np.empty((count, 2), "<u8")
        index[:, 0] = times_ns
        index[:, 1] = np.arange(size, size + count * stride, stride)
        self._index.setdefault(channel, []).append(index)
        self._parts.append(part.data)
        self._size += part.size

    def flush(self) -> None:
        """Write the added messages as a chunk with its index, and everything to the file."""
        if self._size:
            data = b"".join(self._parts)
            index = {channel: np.concatenate(parts) for channel, parts in self._index.items()}
            self._parts = []
            self._index = {}
            self._size = 0
            times = np.concatenate(list(index.values()))[:, 0]
            first = int(times.min())
            last = int(times.max())
            self._spans += first, last
            packed = self._compressor.compress(data)
            size = len(data)
            crc = zlib.crc32(data)
            place, length = self.put(records.Chunk(_ZSTD, packed, last, first, crc, size))
            start = self._place
            places = {}
            for channel, entries in index.items():
                places[channel] = self._place
                self._counts[channel] += len(entries)
                head = (6 + entries.nbytes, channel, entries.nbytes)
                self._write(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, *head) + entries.tobytes())
            entry = (length, place, _ZSTD, len(packed), last, self._place - start, places)
            self._summary.append(records.ChunkIndex(*entry, first, size))
        self._stream.flush()

    def finish(self) -> None:
        """Write the last chunk and the summary."""
        self.flush()
        counts = Counter(type(record) for record in self._summary)
        statistics = records.Statistics(
            attachment_count=counts[records.AttachmentIndex],
            channel_count=counts[records.Channel],
            channel_message_counts=dict(self._counts),
            chunk_count=counts[records.ChunkIndex],
            message_count=self._counts.total(),
            message_end_time=max(self._spans, default=0),
            message_start_time=min(self._spans, default=0),
            metadata_count=counts[records.MetadataIndex],
            schema_count=counts[records.Schema],
        )
        self.put(records.DataEnd(self._crc))
        start = self._place
        self._crc = 0  # from here on it is that of the summary
        summary = [*self._summary, statistics]
        self._summary = []
        for record in sorted(summary, key=lambda record: _SUMMARY.index(type(record))):
            self.put(record)
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, 0)  # no table of the groups
        self.put(records.Footer(start, 0, zlib.crc32(head, self._crc)))
        self._write(MCAP0_MAGIC)
        self._stream.flush()

    def _write(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._place += len(data)
        self._stream.write(data)
