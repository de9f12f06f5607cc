"""Log reader: messages and record of a log that is whole, truncated or damaged, and recovery."""

import io
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
import zstandard
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Chunk, DataEnd, Footer, McapRecord, Message, Metadata, Schema
from mcap.records import Channel as McapChannel
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from ..errors import LogError
from ..foreign_files import read_bounded
from ..messages.encoding import LEVELS, message_class, row_fields
from ..messages.publisher import Topic
from ..recording.channels import CHANNELS, EVENT_TOPIC, Channel
from ..recording.record import Event, Record, Table
from . import LOG_NAME, log_path
from .writer import FORMAT, FORMAT_KEY, RUN_METADATA

SALVAGED_KEY: Final = "salvaged"  # metadata of a truncated log: extent of what was read
RECOVERED_KEY: Final = "recovered"  # metadata of a recovered log: the same

# A file can be a thousand times larger once decompressed. A run logs 250 messages and 20 kB per
# simulated second.
_MOST_FILE_BYTES: Final = 2 * 2**30
_MOST_BYTES: Final = 2 * 2**30  # of all chunks, decompressed
_MOST_RATIO: Final = 64  # of decompressed bytes to those of the file
_SMALL_BYTES: Final = 64 * 2**20  # decompressed, at any ratio
_MOST_MESSAGES: Final = 10_000_000  # that are read into memory

_DATA_END_BYTES: Final = 13  # https://mcap.dev/spec#data-end-op0x0f
_CRC_BYTES: Final = 4

# Exceptions that truncated, damaged or foreign bytes raise in their readers.
_DAMAGE: Final = (
    *(McapError, ZstdError, DecodeError, struct.error),
    *(AttributeError, LookupError, OverflowError, TypeError, ValueError),
)


@dataclass(frozen=True, slots=True)
class Content:
    """Messages of a log by topic, in the order of the file, with metadata and attachments."""

    path: Path
    metadata: Mapping[str, str]  # of the run, without the log's own keys
    attachments: Mapping[str, bytes]
    topics: Mapping[str, Topic]  # by name
    messages: Mapping[str, list[Message]]  # by topic
    # Extent of what is read of a truncated or damaged log, and why; "" of a whole one
    salvage: str


class _Found:
    """What the records of a log have said so far."""

    def __init__(self, is_read: Callable[[str], bool]) -> None:
        self.metadata: dict[str, str] = {}
        self.attachments: dict[str, bytes] = {}
        self.topics: dict[str, Topic] = {}
        self.messages: dict[str, list[Message]] = {}
        self._is_read = is_read  # whether messages on a topic are taken
        self._schemas: dict[int, Schema] = {}
        self._names: dict[int, str] = {}  # name of the topic of each channel

    def take(self, record: McapRecord) -> None:
        """Take over a record; messages only on topics that are read."""
        match record:
            case Metadata(name=name, metadata=content) if name == RUN_METADATA:
                self.metadata = dict(content)
            case Attachment(name=name, data=content):
                self.attachments[name] = content
            case Schema() as schema:
                self._schemas[schema.id] = schema
            case McapChannel(id=number, topic=name) as each if each.schema_id in self._schemas:
                schema = self._schemas[each.schema_id]
                self._names[number] = name
                self.topics[name] = Topic(name, schema.name, schema.data, dict(each.metadata))
                if self._is_read(name):
                    self.messages.setdefault(name, [])
            case Message() as message:
                if (name := self._names.get(message.channel_id, "")) in self.messages:
                    self.messages[name].append(message)
            case _:
                pass


class _Extent:
    """How much of a log has been unpacked, within what may be."""

    def __init__(self, path: Path, size_bytes: int) -> None:
        self.left_out = 0  # chunks that were damaged
        self._path = path
        self._size_bytes = size_bytes  # of the file
        self._limit_bytes = min(_MOST_BYTES, max(_SMALL_BYTES, _MOST_RATIO * size_bytes))
        self._chunks = 0
        self._bytes = 0
        self._messages = 0
        self._end_ns = 0

    def __str__(self) -> str:
        skipped = f", {self.left_out} left out" if self.left_out else ""
        return f"{self._chunks} whole chunks{skipped}, up to {self._end_ns / 1e9:.2f} s"

    def unpack(self, chunk: Chunk) -> list[McapRecord]:
        """Return the records in a chunk, none of a damaged one.

        Raises:
            LogError: with this chunk the log is larger than can be read.
        """
        self._bytes += chunk.uncompressed_size
        if self._bytes > self._limit_bytes:
            raise LogError(
                f"{self._path}: declares {self._bytes} bytes of messages or more, at most "
                f"{self._limit_bytes} are read from {self._size_bytes}"
            )
        try:
            records = _unpacked(chunk)
        except _DAMAGE:
            self.left_out += 1
            return []

        self._chunks += 1
        self._end_ns = max(self._end_ns, chunk.message_end_time)
        self._messages += len(records)
        if self._messages > _MOST_MESSAGES:
            raise LogError(f"{self._path}: more than {_MOST_MESSAGES} messages, the limit")
        return records


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
    found = _Found(is_read)
    extent = _Extent(path, len(data))
    faults: list[str] = []
    ends = 0  # of the sections of data and summary
    stream = io.BytesIO(data)
    try:
        for record in StreamReader(stream, emit_chunks=True).records:
            match record:
                case Chunk() as chunk:
                    for part in extent.unpack(chunk):
                        found.take(part)
                case DataEnd(data_section_crc=crc):
                    ends += 1
                    if zlib.crc32(memoryview(data)[: stream.tell() - _DATA_END_BYTES]) != crc:
                        faults.append("checksum of the data section wrong")
                case Footer(summary_start=start, summary_crc=crc):
                    ends += 1
                    if zlib.crc32(data[start : stream.tell() - _CRC_BYTES]) != crc:
                        faults.append("checksum of the summary wrong")
                case _:
                    found.take(record)
    except (EndOfFile, struct.error):
        faults.append("truncated")
    except _DAMAGE as error:
        faults.append(f"damaged: {error}")
    if extent.left_out or ends != 2:
        faults.append("damaged")

    _check_format(path, found.metadata)
    salvage = f"{extent}; {faults[0]}" if faults else ""
    return Content(path, found.metadata, found.attachments, found.topics, found.messages, salvage)


def _check_format(path: Path, metadata: dict[str, str]) -> None:
    """Take the format out of the metadata of a log and refuse another one.

    Raises:
        LogError: the log is of another format or describes no run.
    """
    if not metadata:
        raise LogError(f"{path}: describes no run: not a log of ttempc, or truncated at its start")
    if (version := metadata.pop(FORMAT_KEY, "none")) != FORMAT:
        raise LogError(f"{path}: log format {version}, this version reads {FORMAT}")


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Return the records in a chunk; wrong bytes raise one of `_DAMAGE`."""
    if chunk.compression == "zstd":
        # Before any allocation: decompression trusts the size in the compressed data.
        if zstandard.frame_content_size(chunk.data) != chunk.uncompressed_size:
            raise ValueError("size of a chunk")
    elif chunk.compression:
        raise ValueError(f"compression {chunk.compression!r}")
    return breakup_chunk(chunk, validate_crc=True)


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


_LEVEL_NAMES: Final = {number: name for name, number in LEVELS.items()}


def read_log(path: str | Path, channels: Sequence[Channel] = CHANNELS) -> Record:
    """Return the record of a log, see `read_content` and `record_of`."""
    topics = {EVENT_TOPIC, *(channel.topic for channel in channels)}
    return record_of(read_content(path, topics.__contains__), channels)


def record_of(content: Content, channels: Sequence[Channel] = CHANNELS) -> Record:
    """Return rows and events of a log, with `SALVAGED_KEY` in the metadata where it is not whole.

    Raises:
        LogError: a channel has other fields than in this version, or its messages do not decode.
    """
    tables = {}
    found = content.messages
    for channel in channels:
        with decoding(content.path, channel.topic):
            _check_fields(content, channel)
            tables[channel.topic] = _table(channel, found.get(channel.topic, []))
    with decoding(content.path, EVENT_TOPIC):
        lines = [(each.log_time, Log.FromString(each.data)) for each in found.get(EVENT_TOPIC, [])]
        events = [Event(at / 1e9, _LEVEL_NAMES[line.level], line.message) for at, line in lines]
    extent = {SALVAGED_KEY: content.salvage} if content.salvage else {}
    return Record(tables, tuple(events), {**content.metadata, **extent})


def _check_fields(content: Content, channel: Channel) -> None:
    topic = content.topics.get(channel.topic)
    if topic is None:
        return
    file = FileDescriptorSet.FromString(topic.schema).file[0]
    logged = tuple(field.name for field in file.message_type[0].field)
    if logged != row_fields(channel):
        differing = sorted(set(logged) ^ set(row_fields(channel))) or ["their order"]
        raise LogError(
            f"{content.path}: {channel.topic} has other fields than in this version "
            f"({', '.join(differing)}); written by ttempc "
            f"{content.metadata.get('ttempc', 'of unknown version')}"
        )


def _table(channel: Channel, messages: Sequence[Message]) -> Table:
    parse = message_class(channel).FromString
    numbers = attrgetter(*row_fields(channel))
    flat = array("d")
    for message in messages:
        flat.extend(numbers(parse(message.data)))
    rows = np.array(flat).reshape(-1, 1 + len(channel.fields))  # (n, 1 + fields), time first
    return Table(channel, rows[:, 0].copy(), rows[:, 1:].copy())
