"""Content of a log: its messages as bytes, of a whole, a truncated or a damaged file."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import SeekingReader
from mcap.records import Attachment, Chunk, McapRecord, Message, Metadata, Schema
from mcap.records import Channel as Topic
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from ..errors import LogError
from .log import FORMAT, FORMAT_KEY, RUN_METADATA

DAMAGE: Final = (
    McapError,
    CRCValidationError,
    ZstdError,
    DecodeError,
    struct.error,
    ValueError,
    KeyError,
    OverflowError,
)
"""Exceptions that truncated or damaged bytes raise in the reader."""


@dataclass(frozen=True, slots=True)
class Salvage:
    """Extent of what was recovered from a truncated or damaged log."""

    chunks: int  # recovered, each complete and with a correct checksum
    damaged: int  # chunks of full length with a wrong checksum, left out
    kept_bytes: int  # up to the end of the last whole MCAP record
    total_bytes: int
    last_time_s: float  # of the newest message recovered

    def __str__(self) -> str:
        damaged = f", {self.damaged} damaged left out" if self.damaged else ""
        return (
            f"{self.chunks} whole chunks{damaged}, up to {self.last_time_s:.2f} s, "
            f"{self.kept_bytes} of {self.total_bytes} bytes"
        )


@dataclass(frozen=True, slots=True)
class Content:
    """Messages of a log by topic, in the order of the file, with metadata and attachments."""

    path: Path
    metadata: Mapping[str, str]  # of the run, without the log's own keys
    attachments: Mapping[str, bytes]
    schemas: Mapping[str, Schema]  # by topic
    messages: Mapping[str, list[Message]]  # by topic
    salvage: Salvage | None  # None where the log is whole


def read_content(path: Path, is_read: Callable[[str], bool] = lambda topic: True) -> Content:
    """Return the content of a log on the topics for which `is_read` is true.

    A log that is truncated or damaged gives the content of its complete chunks.

    Raises:
        LogError: no such file, not a log of this project, or of another format of it.
    """
    data = _bytes(path)
    if data.endswith(MCAP0_MAGIC):
        try:
            return _whole(path, data, is_read)
        except DAMAGE:
            pass  # complete in length, damaged inside
    return salvage_content(path, is_read)


def salvage_content(path: Path, is_read: Callable[[str], bool] = lambda topic: True) -> Content:
    """Return the content of every complete chunk of a log, with `salvage` set.

    Raises:
        LogError: as `read_content`.
    """
    data = _bytes(path)
    stream, collector = io.BytesIO(data), _Collector(path, is_read)
    chunks, damaged, kept_bytes, last_ns = 0, 0, len(MCAP0_MAGIC), 0
    for record in _whole_records(stream, len(data)):
        kept_bytes = stream.tell()
        if not isinstance(record, Chunk):
            collector.add(record)
            continue
        try:
            parts = breakup_chunk(record, validate_crc=True)
        except DAMAGE:
            damaged += 1
            continue
        chunks += 1
        last_ns = max(last_ns, record.message_end_time)
        for part in parts:
            collector.add(part)
    return collector.content(Salvage(chunks, damaged, kept_bytes, len(data), last_ns / 1e9))


def _bytes(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    if not data.startswith(MCAP0_MAGIC):
        raise LogError(f"{path}: is not an MCAP log")
    return data


def _whole(path: Path, data: bytes, is_read: Callable[[str], bool]) -> Content:
    collector = _Collector(path, is_read)
    reader = SeekingReader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    if summary is None:
        raise EndOfFile
    described = (*reader.iter_metadata(), *reader.iter_attachments())
    for record in (*described, *summary.schemas.values(), *summary.channels.values()):
        collector.add(record)
    topics = [item.topic for item in summary.channels.values() if is_read(item.topic)]
    if topics:  # the reader takes an empty list for all of them
        # In the order of the file: the order in which the rows came, whatever their times.
        for _, _, message in reader.iter_messages(topics, log_time_order=False):
            collector.add(message)
    return collector.content(None)


def _whole_records(stream: io.BytesIO, total_bytes: int) -> Iterator[McapRecord]:
    """Yield MCAP records from the start of the stream up to the first that is incomplete."""
    # Without the limit a damaged length could request gigabytes.
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=total_bytes)
    records = reader.records
    while True:
        try:
            record = next(records)
        except (StopIteration, *DAMAGE):
            return
        yield record


@dataclass(slots=True)
class _Collector:
    """Collector of MCAP records in any order, from which a `Content` is made."""

    path: Path
    is_read: Callable[[str], bool]
    schemas: dict[int, Schema] = field(default_factory=dict)
    topics: dict[int, Topic] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, str] | None = None

    def add(self, record: McapRecord) -> None:
        """Add one MCAP record; kinds that do not describe the run are ignored."""
        if isinstance(record, Message):
            self.messages.append(record)
        elif isinstance(record, Topic):
            self.topics[record.id] = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Attachment):
            self.attachments[record.name] = record.data
        elif isinstance(record, Metadata) and record.name == RUN_METADATA:
            self.metadata = dict(record.metadata)

    def content(self, salvage: Salvage | None) -> Content:
        """Return the content.

        Raises:
            LogError: the log is not of this project, or of another format.
        """
        metadata = self._own_metadata()
        messages = {item.topic: [] for item in self.topics.values() if self.is_read(item.topic)}
        for message in self.messages:
            topic = self.topics.get(message.channel_id)  # None where a damaged chunk held it
            if topic is not None and topic.topic in messages:
                messages[topic.topic].append(message)
        schemas = {
            topic.topic: self.schemas[topic.schema_id]
            for topic in self.topics.values()
            if topic.schema_id in self.schemas
        }
        return Content(self.path, metadata, self.attachments, schemas, messages, salvage)

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
