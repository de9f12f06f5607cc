"""Log reader: messages and record of a log that is whole, truncated or damaged, and recovery."""

from __future__ import annotations

import io
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
import zstandard
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, McapRecord, Message, Metadata, Schema, Statistics
from mcap.records import Channel as McapChannel
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from ..atomic_write import atomic_write
from ..bounded_read import read_bounded
from ..errors import LogError
from ..messages.encoding import LEVELS, message_class, row_fields
from ..messages.publisher import Topic
from ..recording.channels import CHANNELS, EVENT_TOPIC, Channel
from ..recording.record import Event, Record, Table
from . import LOG_NAME, log_path
from .writer import FORMAT, FORMAT_KEY, RUN_METADATA, McapFile, refuse_existing_log

SALVAGED_KEY: Final = "salvaged"  # metadata of a truncated log: extent of what was read
RECOVERED_KEY: Final = "recovered"  # metadata of a recovered log: extent of what was recovered

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
# Records with opcode and length, https://mcap.dev/spec#records
_DATA_END: Final = struct.Struct("<BQI")  # checksum of the data section
_FOOTER: Final = struct.Struct("<BQQQI")  # starts of summary and offsets, checksum of the summary
_RECORDS: Final[Mapping[int, type[McapRecord]]] = {
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHANNEL: McapChannel,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
    Opcode.SCHEMA: Schema,
    Opcode.STATISTICS: Statistics,
}

# Exceptions that truncated, damaged or foreign bytes raise in their readers.
_DAMAGE: Final = (
    *(McapError, ZstdError, DecodeError, struct.error),
    *(AttributeError, LookupError, OverflowError, TypeError, ValueError),
)


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
    topics: Mapping[str, Topic]  # by name
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
    limit = min(_MOST_BYTES, max(_SMALL_BYTES, _MOST_RATIO * len(data)))
    chunks, damaged, unpacked, last_ns, kept = 0, 0, 0, 0, len(MCAP0_MAGIC)
    metadata: dict[str, str] = {}
    attachments: dict[str, bytes] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, McapChannel] = {}
    messages: dict[str, list[Message]] = {}
    counts: Counter[int] = Counter()  # of all messages, by channel
    counted: dict[int, int] | None = None
    for opcode, start, end in _whole_records(data, len(MCAP0_MAGIC)):
        kept = end
        try:
            match _record(opcode, data[start:end]):
                case Metadata(name=name, metadata=content) if name == RUN_METADATA:
                    metadata = dict(content)
                case Attachment(name=name, data=content):
                    attachments[name] = content
                case Schema() as schema:
                    schemas[schema.id] = schema
                case McapChannel() as channel:
                    channels[channel.id] = channel
                    if is_read(channel.topic):
                        messages.setdefault(channel.topic, [])
                case Chunk() as chunk:
                    unpacked += chunk.uncompressed_size
                    if unpacked > limit:
                        raise LogError(
                            f"{path}: declares {unpacked} bytes of messages or more, at most "
                            f"{limit} are read from {len(data)}"
                        )
                    for message in _messages(chunk):
                        counts[message.channel_id] += 1
                        channel = channels.get(message.channel_id)
                        if channel and channel.topic in messages:
                            messages[channel.topic].append(message)
                    chunks, last_ns = chunks + 1, max(last_ns, chunk.message_end_time)
                    if counts.total() > _MOST_MESSAGES:
                        raise LogError(f"{path}: more than {_MOST_MESSAGES} messages, the limit")
                case Statistics(channel_message_counts=numbers):
                    counted = numbers
        except _DAMAGE:
            damaged += 1
    reason = integrity_error(data)
    if not reason and damaged:
        reason = "not as this program writes it"
    if not reason and counted != counts:
        reason = "the numbers of messages are not those of its statistics"
    salvage = Salvage(reason, chunks, damaged, kept, len(data), last_ns / 1e9) if reason else None
    topics = {
        each.topic: Topic(each.topic, schema.name, schema.data, dict(each.metadata))
        for each in channels.values()
        if (schema := schemas.get(each.schema_id))
    }
    return Content(path, _of_run(path, metadata), attachments, topics, messages, salvage)


def _of_run(path: Path, metadata: dict[str, str]) -> dict[str, str]:
    """Return the metadata of the run without the log's own keys."""
    if not metadata:
        raise LogError(f"{path}: describes no run: not a log of ttempc, or truncated at its start")
    version = metadata.pop(FORMAT_KEY, "none")
    if version != FORMAT:
        raise LogError(f"{path}: log format {version}, this version reads {FORMAT}")
    return metadata


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
    if zlib.crc32(data[start : footer + _FOOTER.size - _CRC_BYTES]) != summary_crc:
        return "checksum of the summary wrong"
    opcode, length, data_crc = _DATA_END.unpack_from(data, data_end)
    if (opcode, length) != (Opcode.DATA_END, 4):
        return "end of the data section damaged"
    if data_crc == 0:
        return "no checksum of the data section"
    if zlib.crc32(memoryview(data)[:data_end]) != data_crc:
        return "checksum of the data section wrong"
    return None


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


def _messages(chunk: Chunk) -> list[Message]:
    """Return the messages of a chunk.

    Raises:
        ValueError: wrong size, checksum or compression, or something else than messages in it; a
            compression that is not understood raises `ZstdError`.
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
    messages = []
    for opcode, start, end in _whole_records(data, 0):
        if opcode != Opcode.MESSAGE:
            raise ValueError(f"record of kind {opcode} in a chunk")
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
        body = data[start + _MESSAGE.size : end]
        messages.append(Message(channel, log_time, body, publish_time, sequence))
    return messages


_LEVEL_NAMES: Final = {number: name for name, number in LEVELS.items()}


def read_log(path: str | Path, channels: Sequence[Channel] = CHANNELS) -> Record:
    """Return the record of a log, with `SALVAGED_KEY` in its metadata where it is truncated.

    Args:
        path: of the log, or the folder of its run.
        channels: that are read.

    Raises:
        LogError: no such file, not a log of this project, or of another version of it.
    """
    topics = {EVENT_TOPIC, *(channel.topic for channel in channels)}
    content = read_content(path, topics.__contains__)
    record = record_of(content, channels)
    if content.salvage is None:
        return record
    return replace(record, metadata={**record.metadata, SALVAGED_KEY: str(content.salvage)})


def record_of(content: Content, channels: Sequence[Channel] = CHANNELS) -> Record:
    """Return the rows and events of the content of a log.

    Raises:
        LogError: a channel has other fields than in this version, or its messages do not decode.
    """
    tables = {}
    for channel in channels:
        with decoding(content.path, channel.topic):
            _check_fields(content, channel)
            tables[channel.topic] = _table(channel, content.messages.get(channel.topic, []))
    with decoding(content.path, EVENT_TOPIC):
        events = tuple(_event(message) for message in content.messages.get(EVENT_TOPIC, []))
    return Record(tables, events, content.metadata)


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


def _event(message: Message) -> Event:
    line = Log.FromString(message.data)
    return Event(message.log_time / 1e9, _LEVEL_NAMES[line.level], line.message)


def _table(channel: Channel, messages: Sequence[Message]) -> Table:
    parse, numbers = message_class(channel).FromString, attrgetter(*row_fields(channel))
    flat = array("d")
    for message in messages:
        flat.extend(numbers(parse(message.data)))
    rows = np.array(flat).reshape(-1, 1 + len(channel.fields))  # (n, 1 + fields), time first
    return Table(channel, rows[:, 0].copy(), rows[:, 1:].copy())


def recover(content: Content, file: Path) -> None:
    """Write the content of a log to a new log, its messages byte for byte.

    Raises:
        LogError: the file or its partial file exists, or it cannot be written; no new file is left.
    """
    refuse_existing_log(file)
    extent = {} if content.salvage is None else {RECOVERED_KEY: str(content.salvage)}
    try:
        with atomic_write(file) as stream:
            mcap = McapFile(stream)
            mcap.add_metadata(RUN_METADATA, {**content.metadata, **extent, FORMAT_KEY: FORMAT})
            for name, data in content.attachments.items():
                mcap.add_attachment(name, data)
            numbers = {name: mcap.add_topic(topic) for name, topic in content.topics.items()}
            recovered = [
                (message.log_time, number, message.data)
                for name, number in numbers.items()
                for message in content.messages.get(name, [])
            ]
            for time_ns, number, data in sorted(recovered, key=lambda item: item[0]):
                mcap.add_message(number, time_ns, data)
            mcap.finish()
    except OSError as error:
        raise LogError(f"{file}: cannot be written: {error.strerror}") from error
