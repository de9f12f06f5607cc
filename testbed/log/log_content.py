"""Content of a log: its messages as bytes, of a whole, a truncated or a damaged file."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import zstandard
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, McapRecord, Message, Metadata, Schema, Statistics
from mcap.records import Channel as Topic
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from ..bounded_read import read_bounded
from ..errors import LogError
from .integrity import integrity_error
from .log import FORMAT, FORMAT_KEY, RUN_METADATA
from .log_path import LOG_NAME, log_path

# A file can be a thousand times larger once decompressed. A run logs 250 messages and 20 kB per
# simulated second.
_MOST_FILE_BYTES: Final = 2 * 2**30
_MOST_BYTES: Final = 2 * 2**30  # of all chunks, decompressed
_MOST_RATIO: Final = 64  # of decompressed bytes to those of the file
_SMALL_BYTES: Final = 64 * 2**20  # decompressed, at any ratio
_MOST_MESSAGES: Final = 10_000_000  # read into memory

_HEAD: Final = struct.Struct("<BQ")  # opcode and length of a record
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CRC_BYTES: Final = 4
_RECORDS: Final[Mapping[int, type[McapRecord]]] = {
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHANNEL: Topic,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.STATISTICS: Statistics,
}

_DAMAGE: Final = (
    McapError,
    ZstdError,
    DecodeError,
    struct.error,
    AttributeError,
    IndexError,
    KeyError,
    OverflowError,
    TypeError,
    ValueError,
)
# Exceptions that truncated, damaged or foreign bytes raise in their readers.


@dataclass(frozen=True, slots=True)
class Salvage:
    """Extent of what was recovered from a truncated or damaged log."""

    reason: str  # why the log is not whole
    chunks: int  # recovered, each complete and with a correct checksum
    damaged: int  # chunks and attachments of full length with a wrong checksum, left out
    kept_bytes: int  # up to the end of the last whole MCAP record
    total_bytes: int
    last_time_s: float  # of the newest message recovered

    def __str__(self) -> str:
        damaged = f", {self.damaged} damaged left out" if self.damaged else ""
        return (
            f"{self.chunks} whole chunks{damaged}, up to {self.last_time_s:.2f} s, "
            f"{self.kept_bytes} of {self.total_bytes} bytes; {self.reason}"
        )


@dataclass(frozen=True, slots=True)
class Content:
    """Messages of a log by topic, in the order of the file, with metadata and attachments."""

    path: Path
    metadata: Mapping[str, str]  # of the run, without the log's own keys
    attachments: Mapping[str, bytes]
    schemas: Mapping[str, Schema]  # by topic
    descriptions: Mapping[str, Mapping[str, str]]  # metadata of channels, by topic
    messages: Mapping[str, list[Message]]  # by topic
    salvage: Salvage | None  # None where the log is whole


def read_content(path: str | Path, is_read: Callable[[str], bool] = lambda topic: True) -> Content:
    """Return the content of a log on the topics for which `is_read` is true.

    The folder of a run stands for the log in it. A log that is truncated or damaged gives the
    content of its complete chunks and attachments, and the reason in `salvage`.

    Raises:
        LogError: no such file, not a log of this project, of another format of it, or larger than
            can be read.
    """
    path = log_path(path)
    data = _bytes(path)
    collector = _Collector(path, is_read)
    limit = min(_MOST_BYTES, max(_SMALL_BYTES, _MOST_RATIO * len(data)))
    chunks, damaged, unpacked, last_ns, kept = 0, 0, 0, 0, len(MCAP0_MAGIC)
    statistics: Statistics | None = None
    for opcode, start, end in _whole_records(data, len(MCAP0_MAGIC)):
        kept = end
        try:
            record = _record(opcode, data[start:end])
            if isinstance(record, Chunk):
                unpacked += record.uncompressed_size
                if unpacked > limit:
                    raise LogError(
                        f"{path}: declares {unpacked} bytes of messages or more, at most {limit} "
                        f"are read from {len(data)}"
                    )
                collector.add_chunk(_unpacked(record))
                chunks, last_ns = chunks + 1, max(last_ns, record.message_end_time)
            elif isinstance(record, Statistics):
                statistics = record
            elif record is not None:
                collector.add(record)
        except _DAMAGE:
            damaged += 1
    reason = integrity_error(data)
    if not reason and damaged:
        reason = "not as this program writes it"
    if not reason and (statistics is None or statistics.channel_message_counts != collector.counts):
        reason = "the numbers of messages are not those of its statistics"
    if not reason:
        return collector.content(None)
    return collector.content(Salvage(reason, chunks, damaged, kept, len(data), last_ns / 1e9))


@contextmanager
def decoding(path: Path, what: str) -> Iterator[None]:
    """Convert what foreign bytes raise in a decoder to one line.

    Raises:
        LogError: with the file and `what` was decoded.
    """
    try:
        yield
    except _DAMAGE as error:
        raise LogError(f"{path}: {what} is not as this program writes it: {error}") from error


def _bytes(path: Path) -> bytes:
    try:
        data = read_bounded(path, _MOST_FILE_BYTES)
    except IsADirectoryError:
        raise LogError(f"{path}: is a folder without {LOG_NAME}") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    if not data.startswith(MCAP0_MAGIC):
        raise LogError(f"{path}: is not an MCAP log")
    return data


def _whole_records(data: bytes, place: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of MCAP records up to the first that is incomplete."""
    while place + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, place)
        start, place = place + _HEAD.size, place + _HEAD.size + length
        if place > len(data):
            return
        yield opcode, start, place
        if opcode == Opcode.FOOTER:
            return


def _record(opcode: int, body: bytes) -> McapRecord | None:
    """Return a record of a kind that matters here.

    Raises:
        ValueError: an attachment with a wrong checksum; other bytes raise others of `_DAMAGE`.
    """
    kind = _RECORDS.get(opcode)
    if kind is None:
        return None
    if kind is Attachment:  # its checksum is not read by `mcap`
        expected = int.from_bytes(body[-_CRC_BYTES:], "little")
        if zlib.crc32(body[:-_CRC_BYTES]) != expected:
            raise ValueError("checksum of an attachment")
    return kind.read(ReadDataStream(io.BytesIO(body)))


def _unpacked(chunk: Chunk) -> bytes:
    """Return the records of a chunk.

    Raises:
        ValueError: wrong size, checksum or compression; a compression that is not
            understood raises `ZstdError`.
    """
    data = chunk.data
    if chunk.compression == "zstd":
        # Before any allocation: `decompress` trusts the size in the compressed data.
        if zstandard.frame_content_size(data) != chunk.uncompressed_size:
            raise ValueError("size of a chunk")
        data = zstandard.decompress(data)
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r}")
    if len(data) != chunk.uncompressed_size or zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("checksum of a chunk")
    return data


@dataclass(slots=True)
class _Collector:
    """Collector of MCAP records in the order of the file, from which a `Content` is made."""

    path: Path
    is_read: Callable[[str], bool]
    schemas: dict[int, Schema] = field(default_factory=dict)
    topics: dict[int, Topic] = field(default_factory=dict)
    messages: dict[int, list[Message]] = field(default_factory=dict)  # by channel
    counts: dict[int, int] = field(default_factory=dict)  # of all messages, by channel
    kept: int = 0  # messages
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, str] | None = None

    def add(self, record: McapRecord) -> None:
        """Add one MCAP record; kinds that do not describe the run are ignored."""
        if isinstance(record, Topic):
            self.topics[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data
        elif isinstance(record, Metadata) and record.name == RUN_METADATA:
            self.metadata = dict(record.metadata)

    def add_chunk(self, data: bytes) -> None:
        """Add the messages of a chunk.

        Raises:
            LogError: more messages than are read into memory.
            ValueError, struct.error: there is something else in it.
        """
        for opcode, start, end in _whole_records(data, 0):
            if opcode != Opcode.MESSAGE:
                raise ValueError(f"record of kind {opcode} in a chunk")
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
            self.counts[channel] = self.counts.get(channel, 0) + 1
            if channel in self.topics and self.is_read(self.topics[channel].topic):
                body = data[start + _MESSAGE.size : end]
                message = Message(channel, log_time, body, publish_time, sequence)
                self.messages.setdefault(channel, []).append(message)
                self.kept += 1
                if self.kept > _MOST_MESSAGES:
                    raise LogError(f"{self.path}: more than {_MOST_MESSAGES} messages, the limit")

    def content(self, salvage: Salvage | None) -> Content:
        """Return the content.

        Raises:
            LogError: the log is not of this project, or of another format.
        """
        metadata = self._own_metadata()
        messages = {
            topic.topic: self.messages.get(number, [])
            for number, topic in self.topics.items()
            if self.is_read(topic.topic)
        }
        schemas = {
            topic.topic: self.schemas[topic.schema_id]
            for topic in self.topics.values()
            if topic.schema_id in self.schemas
        }
        descriptions = {topic.topic: dict(topic.metadata) for topic in self.topics.values()}
        return Content(
            self.path, metadata, self.attachments, schemas, descriptions, messages, salvage
        )

    def _own_metadata(self) -> dict[str, str]:
        """Return the metadata of the run without the log's own keys."""
        if self.metadata is None:
            raise LogError(
                f"{self.path}: describes no run: not a log of ttempc, or truncated at its start"
            )
        metadata = dict(self.metadata)
        version = metadata.pop(FORMAT_KEY, "none")
        if version != FORMAT:
            raise LogError(f"{self.path}: log format {version}, this version reads {FORMAT}")
        return metadata
