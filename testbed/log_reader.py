"""Reads logs back into records: whole ones by their index, torn ones by what is still there."""

from __future__ import annotations

import io
import struct
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError
from mcap.exceptions import EndOfFile, McapError
from mcap.reader import SeekingReader
from mcap.records import Channel as Topic
from mcap.records import Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from testbed.channels import CHANNELS, Channel
from testbed.errors import LogError
from testbed.log import EVENT_TOPIC, FORMAT, FORMAT_KEY, RUN_METADATA
from testbed.record import Event, Record, Table
from testbed.schemas import message_class, row_fields
from testbed.viewer_messages import LEVELS

SALVAGED_KEY: Final = "salvaged"  # in the metadata of a torn log: what was kept, in words

_LEVEL_NAMES: Final = {number: name for name, number in LEVELS.items()}
# What the bytes at a tear or in a damaged place can make of the reader.
_DAMAGE: Final = (
    *(McapError, CRCValidationError, ZstdError, DecodeError, struct.error),
    *(ValueError, KeyError, OverflowError),
)


@dataclass(frozen=True, slots=True)
class Salvage:
    """What was left of a torn or damaged log."""

    record: Record
    chunks: int  # kept, each whole and with its checksum right
    damaged: int  # chunks of full length with wrong content, left out
    kept_bytes: int  # up to the end of the last whole MCAP record
    total_bytes: int

    def __str__(self) -> str:
        ends = [float(table.time_s[-1]) for table in self.record.tables.values() if len(table)]
        last_time_s = max(ends, default=0.0)
        damaged = f", {self.damaged} damaged left out" if self.damaged else ""
        return (
            f"{self.chunks} whole chunks{damaged}, up to {last_time_s:.2f} s, "
            f"{self.kept_bytes} of {self.total_bytes} bytes"
        )


def read_log(path: Path, channels: Sequence[Channel] = CHANNELS) -> Record:
    """Return the record of a log, with `SALVAGED_KEY` among its metadata where it is torn.

    Raises:
        LogError: no such file, not a log of this project, or of another version of it.
    """
    data = _content(path)
    if data.endswith(MCAP0_MAGIC):
        try:
            return _read_whole(path, data, channels)
        except _DAMAGE:
            pass  # whole in shape, damaged inside: keep what can be kept
    salvage = _salvage(path, data, channels)
    record = salvage.record
    return Record(record.tables, record.events, {**record.metadata, SALVAGED_KEY: str(salvage)})


def salvage_log(path: Path, channels: Sequence[Channel] = CHANNELS) -> Salvage:
    """Return what every whole chunk of a log holds, torn or not.

    Raises:
        LogError: as `read_log`.
    """
    return _salvage(path, _content(path), channels)


def _content(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    if not data.startswith(MCAP0_MAGIC):
        raise LogError(f"{path}: is not an MCAP log")
    return data


def _read_whole(path: Path, data: bytes, channels: Sequence[Channel]) -> Record:
    content = _Content(path, channels)
    reader = SeekingReader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    if summary is None:
        raise EndOfFile
    for record in (*reader.iter_metadata(), *summary.schemas.values(), *summary.channels.values()):
        content.take(record)
    # In the order of the file: the order in which the rows came, whatever their times.
    for _, _, message in reader.iter_messages(content.topics, log_time_order=False):
        content.take(message)
    return content.record()


def _salvage(path: Path, data: bytes, channels: Sequence[Channel]) -> Salvage:
    content = _Content(path, channels)
    stream = io.BytesIO(data)
    chunks, damaged, kept_bytes = 0, 0, len(MCAP0_MAGIC)
    for record in _whole_records(stream, len(data)):
        kept_bytes = stream.tell()
        if not isinstance(record, Chunk):
            content.take(record)
            continue
        try:
            parts = breakup_chunk(record, validate_crc=True)
        except _DAMAGE:
            damaged += 1
            continue
        chunks += 1
        for part in parts:
            content.take(part)
    return Salvage(content.record(), chunks, damaged, kept_bytes, len(data))


def _whole_records(stream: io.BytesIO, total_bytes: int) -> Iterator[McapRecord]:
    """Yield MCAP records from the start of the stream up to the first that is not whole."""
    # The limit keeps a garbled length from asking for gigabytes.
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=total_bytes)
    records = reader.records
    while True:
        try:
            record = next(records)
        except (StopIteration, *_DAMAGE):
            return
        yield record


class _Content:
    """Gathers MCAP records in any order, and makes a `Record` of them."""

    def __init__(self, path: Path, channels: Sequence[Channel]) -> None:
        self._path = path
        self._channels = {channel.topic: channel for channel in channels}
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, Topic] = {}
        self._messages: list[Message] = []
        self._metadata: dict[str, str] | None = None

    @property
    def topics(self) -> list[str]:
        """The topics of which the record is made."""
        return [EVENT_TOPIC, *self._channels]

    def take(self, record: McapRecord) -> None:
        """Take one MCAP record; kinds that say nothing of the run are passed over."""
        if isinstance(record, Message):
            self._messages.append(record)
        elif isinstance(record, Topic):
            self._topics[record.id] = record
        elif isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Metadata) and record.name == RUN_METADATA:
            self._metadata = dict(record.metadata)

    def record(self) -> Record:
        """Return the record.

        Raises:
            LogError: the log is none of ours, or of another version.
        """
        metadata = self._own_metadata()
        by_topic: dict[str, list[bytes]] = {topic: [] for topic in self.topics}
        events: list[Event] = []
        self._check_fields(metadata)
        for message in self._messages:
            topic = self._topics.get(message.channel_id)  # None where a damaged chunk held it
            if topic is not None and topic.topic == EVENT_TOPIC:
                events.append(_event(message))
            elif topic is not None and topic.topic in by_topic:
                by_topic[topic.topic].append(message.data)
        tables = {name: _table(channel, by_topic[name]) for name, channel in self._channels.items()}
        return Record(tables, tuple(events), metadata)

    def _own_metadata(self) -> dict[str, str]:
        """Return the description of the run without what concerns the log alone."""
        if self._metadata is None:
            raise LogError(
                f"{self._path}: describes no run: not a log of ttempc, or torn at its very start"
            )
        metadata = dict(self._metadata)
        version = metadata.pop(FORMAT_KEY, "none")
        if version != FORMAT:
            raise LogError(f"{self._path}: log format {version}, this version reads {FORMAT}")
        return metadata

    def _check_fields(self, metadata: dict[str, str]) -> None:
        for topic in self._topics.values():
            channel = self._channels.get(topic.topic)
            schema = self._schemas.get(topic.schema_id)
            if channel is None or schema is None:
                continue
            file = FileDescriptorSet.FromString(schema.data).file[0]
            logged = tuple(field.name for field in file.message_type[0].field)
            if logged != row_fields(channel):
                differing = sorted(set(logged) ^ set(row_fields(channel))) or ["their order"]
                raise LogError(
                    f"{self._path}: {topic.topic} has other fields than in this version "
                    f"({', '.join(differing)}); written by ttempc "
                    f"{metadata.get('ttempc', 'of unknown version')}"
                )


def _event(message: Message) -> Event:
    line = Log.FromString(message.data)
    return Event(message.log_time / 1e9, _LEVEL_NAMES[line.level], line.message)


def _table(channel: Channel, messages: Sequence[bytes]) -> Table:
    parse, numbers = message_class(channel).FromString, attrgetter(*row_fields(channel))
    flat = array("d")
    for data in messages:
        flat.extend(numbers(parse(data)))
    rows = np.array(flat).reshape(-1, 1 + len(channel.fields))  # (n, 1 + fields), time first
    return Table(channel, rows[:, 0].copy(), rows[:, 1:].copy())
