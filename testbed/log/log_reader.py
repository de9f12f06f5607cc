"""Log reader: the record of a log, complete or truncated."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.records import Message

from ..errors import LogError
from ..messages.schemas import message_class, row_fields
from ..messages.viewer_messages import LEVELS
from ..recording.channels import CHANNELS, Channel
from ..recording.record import Event, Record, Table
from ..recording.topics import EVENT_TOPIC
from .log_content import Content, decoding, read_content

SALVAGED_KEY: Final = "salvaged"  # metadata of a truncated log: extent of what was read

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
    schema = content.schemas.get(channel.topic)
    if schema is None:
        return
    file = FileDescriptorSet.FromString(schema.data).file[0]
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
