"""Log writer: a run as an MCAP file, one chunk per flush, with all indexes and checksums.

The format is that of https://mcap.dev/spec. Messages and their index records are packed here, all
other records by the package `mcap`: of a run of two seconds its own writer takes 0.13 s, this one
0.05 s.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self

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
)
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from ..atomic_write import partial_path
from ..errors import LogError, TestbedError
from ..messages.encoding import Encoded
from ..messages.publisher import Publisher, Topic, topics_of
from ..messages.scenery import Scenery
from ..recording import channels as flat

PROGRAM: Final = "ttempc"  # writer of the log, in its header
RUN_METADATA: Final = "run"  # the name of the MCAP metadata record that describes the run
FORMAT_KEY: Final = "log_format"
FORMAT: Final = "1"  # incremented when an old reader would misread a new log

_FLUSH_PERIOD_S: Final = 5.0  # simulated time that a killed process can lose
_MEDIA_TYPES: Final = {
    ".toml": "application/toml",
    ".xml": "application/xml",
    ".npz": "application/zip",
}
_MESSAGE_HEAD: Final = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
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

    def __init__(self, stream: BinaryIO, library: str = PROGRAM) -> None:
        self._stream = stream
        groups = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX)
        groups += (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX)
        self._summary: dict[Opcode, list[McapRecord]] = {kind: [] for kind in groups}
        self._schema_ids: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._times: list[tuple[int, int]] = []  # first and last of every chunk
        self._buffer = bytearray()  # of the current chunk
        self._places: dict[int, list[NDArray[np.int64]]] = {}  # time [ns] and offset, by channel
        self._crc = 0  # of all bytes written so far
        self._put(MCAP0_MAGIC)
        self._write(Header("", library))

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write key-value pairs."""
        offset = self._stream.tell()
        length = self._write(Metadata(name=name, metadata=dict(content)))
        self._summary[Opcode.METADATA_INDEX].append(MetadataIndex(offset, length, name))

    def add_attachment(self, name: str, data: bytes) -> None:
        """Write an attachment; its media type follows from the suffix of its name."""
        kind = _MEDIA_TYPES.get(Path(name).suffix, "text/plain")
        offset = self._stream.tell()
        length = self._write(
            Attachment(create_time=0, log_time=0, name=name, media_type=kind, data=data)
        )
        self._summary[Opcode.ATTACHMENT_INDEX].append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=0,
                data_size=len(data),
                name=name,
                media_type=kind,
            )
        )

    def add_topic(self, topic: Topic) -> int:
        """Write schema and channel of a topic, and return the number of the channel."""
        schema = self._schema_ids.get(topic.schema_name)
        if schema is None:
            schema = self._schema_ids[topic.schema_name] = len(self._schema_ids) + 1
            record = Schema(schema, topic.schema, SchemaEncoding.Protobuf, topic.schema_name)
            self._summary[Opcode.SCHEMA].append(record)
            self._write(record)
        channels = self._summary[Opcode.CHANNEL]
        number = len(channels) + 1
        metadata = dict(topic.metadata)
        channels.append(Channel(number, topic.name, MessageEncoding.Protobuf, metadata, schema))
        self._write(channels[-1])
        return number

    def add_messages(self, channel: int, times_ns: NDArray[np.int64], messages: Encoded) -> None:
        """Add messages of one length to the current chunk."""
        count, size = messages.shape
        heads = np.zeros(count, _MESSAGE_HEAD)
        heads["opcode"], heads["channel"] = Opcode.MESSAGE, channel
        heads["length"] = _MESSAGE_HEAD_BYTES + size
        heads["log_time"] = heads["publish_time"] = times_ns
        block = np.column_stack([heads.view(np.uint8).reshape(count, -1), messages])
        offsets = len(self._buffer) + block.shape[1] * np.arange(count)
        self._places.setdefault(channel, []).append(np.column_stack([times_ns, offsets]))
        self._buffer += block.tobytes()

    def add_message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add one message to the current chunk."""
        self.add_messages(channel, np.array([time_ns]), np.frombuffer(data, np.uint8)[None])

    def flush(self) -> None:
        """Write the current chunk and flush the stream."""
        if self._buffer:
            self._end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the last chunk and the indexes; the stream stays open."""
        self.flush()
        self._write(DataEnd(self._crc))
        self._summary[Opcode.STATISTICS].append(self._statistics())
        start, summary = self._stream.tell(), RecordBuilder()
        for records in self._summary.values():
            for record in records:
                record.write(summary)
        data = summary.end()
        footer_start = _FOOTER.pack(Opcode.FOOTER, 20, start, 0)  # without offsets of groups
        self._stream.write(data)
        self._write(Footer(start, 0, zlib.crc32(footer_start, zlib.crc32(data))))
        self._stream.write(MCAP0_MAGIC)

    def _write(self, record: McapRecord) -> int:
        """Write a record and return its length in the file."""
        builder = RecordBuilder()
        record.write(builder)
        return self._put(builder.end())

    def _put(self, data: bytes) -> int:
        self._crc = zlib.crc32(data, self._crc)
        return self._stream.write(data)

    def _end_chunk(self) -> None:
        data, self._buffer = bytes(self._buffer), bytearray()
        places, self._places = self._places, {}
        index = {number: np.concatenate(parts) for number, parts in places.items()}
        times = np.concatenate([pairs[:, 0] for pairs in index.values()])
        first, last = int(times.min()), int(times.max())
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
        for number, pairs in index.items():
            self._counts[number] = self._counts.get(number, 0) + len(pairs)
            offsets[number] = self._stream.tell()
            size = _MESSAGE_INDEX_HEAD_BYTES + pairs.nbytes
            head = _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, size, number, pairs.nbytes)
            self._put(head + pairs.astype("<i8").tobytes())
        self._times.append((first, last))
        self._summary[Opcode.CHUNK_INDEX].append(
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

    def _statistics(self) -> Statistics:
        numbers = {kind: len(records) for kind, records in self._summary.items()}
        return Statistics(
            attachment_count=numbers[Opcode.ATTACHMENT_INDEX],
            channel_count=numbers[Opcode.CHANNEL],
            channel_message_counts=self._counts,
            chunk_count=numbers[Opcode.CHUNK_INDEX],
            message_count=sum(self._counts.values()),
            message_end_time=max((last for _, last in self._times), default=0),
            message_start_time=min((first for first, _ in self._times), default=0),
            metadata_count=numbers[Opcode.METADATA_INDEX],
            schema_count=numbers[Opcode.SCHEMA],
        )


def refuse_existing_log(path: Path) -> None:
    """Refuse to write a log over an existing log or partial log.

    Raises:
        LogError: one of them exists.
    """
    for file in (path, partial_path(path)):
        if file.exists():
            raise LogError(f"{file}: exists already and is not written over")


class LogWriter(Publisher):
    """Writer of one log; a sink and a context manager.

    The file is `<path>.part` until the `with` block ends. It is renamed to `path` after a regular
    end: no exception, or one of the testbed's own, such as a diverged plant. After any other
    exception, or if the log could not be written, the `.part` stays: it is readable up to its last
    flush. In this it differs from `atomic_write`, which removes the partial file.

    Raises:
        LogError: the log or its partial file exists already, or the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        metadata: Mapping[str, str],
        attachments: Mapping[str, str | bytes],
        scenery: Scenery | None = None,
        channels: Sequence[flat.Channel] = flat.CHANNELS,
    ) -> None:
        self.file = path
        self.metadata = dict(metadata)
        self.part = partial_path(path)
        refuse_existing_log(path)
        with self._writing():
            self._stream = open(self.part, "xb")  # noqa: SIM115 - closed by __exit__
            self._mcap = McapFile(self._stream)
            self._mcap.add_metadata(RUN_METADATA, {**metadata, FORMAT_KEY: FORMAT})
            for name, content in attachments.items():
                data = content.encode() if isinstance(content, str) else content
                self._mcap.add_attachment(name, data)
            self._ids = {each.name: self._mcap.add_topic(each) for each in topics_of(channels)}
        self._next_flush_s = _FLUSH_PERIOD_S
        super().__init__(scenery or Scenery(), channels)

    def __enter__(self) -> Self:
        with self._writing():
            self._stream.flush()  # metadata and attachments, before the run begins
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        by_design = isinstance(error, TestbedError) and not isinstance(error, LogError)
        if error is None or by_design:
            with self._writing():
                self._finish()
                self.part.rename(self.file)
        else:
            # The exception that ended the run is more useful than one of closing the file.
            with contextlib.suppress(OSError):
                self._finish()

    def _finish(self) -> None:
        """Write the index, flush to the disk and close the file."""
        try:
            self._publish()
            self._mcap.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
        finally:
            self._stream.close()

    def _send(self, topic: str, time_ns: int, data: bytes) -> None:
        self._mcap.add_message(self._ids[topic], time_ns, data)

    def _send_all(self, topic: str, times_ns: NDArray[np.int64], messages: Encoded) -> None:
        self._mcap.add_messages(self._ids[topic], times_ns, messages)

    def _collected(self, time_s: float) -> None:
        if time_s >= self._next_flush_s:
            self._next_flush_s = time_s + _FLUSH_PERIOD_S
            self._publish()
            with self._writing():
                self._mcap.flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Convert an `OSError` to a `LogError`."""
        try:
            yield
        except OSError as error:
            raise LogError(f"{self.part}: cannot be written: {error.strerror}") from error
