"""Protobuf messages of the flat channels, built at run time from the channels' field lists.

Every message is a row: `time_s` first, then the channel's numbers, all doubles. No compiler is
needed, and a reader needs nothing of this project: the schema travels inside the log.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
    SourceCodeInfo,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..recording.channels import Channel
from .protobuf_wire import MessageTemplate

PACKAGE: Final = "ttempc"
TIME_FIELD: Final = "time_s"

_MESSAGE_PATH: Final = (4, 0)  # FileDescriptorProto.message_type[0], where comments hang
_WIRE_DOUBLE: Final = 1


def message_name(channel: Channel) -> str:
    """Return the full protobuf name of the channel's message, "/mpc/info" -> "ttempc.MpcInfo"."""
    words = channel.topic.replace("/", " ").replace("_", " ").split()
    return f"{PACKAGE}.{''.join(word.capitalize() for word in words)}"


def row_fields(channel: Channel) -> tuple[str, ...]:
    """Return the names of the message's fields in the order of their numbers, which start at 1."""
    return (TIME_FIELD, *channel.fields)


def file_descriptor(channel: Channel) -> FileDescriptorProto:
    """Return the .proto file of one channel, with the channel's `about` as its comment."""
    short_name = message_name(channel).removeprefix(f"{PACKAGE}.")
    file = FileDescriptorProto(
        name=f"{PACKAGE}/{short_name}.proto", package=PACKAGE, syntax="proto3"
    )
    message = file.message_type.add(name=short_name)
    for number, name in enumerate(row_fields(channel), start=1):
        message.field.add(
            name=name,
            number=number,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
    comment = SourceCodeInfo.Location(
        path=_MESSAGE_PATH, span=(0, 0, 0), leading_comments=f" {channel.about}\n"
    )
    file.source_code_info.location.append(comment)
    return file


def descriptor_set(channel: Channel) -> bytes:
    """Return the serialised FileDescriptorSet that a log carries as the channel's schema."""
    return FileDescriptorSet(file=[file_descriptor(channel)]).SerializeToString()


@cache
def message_class(channel: Channel) -> type[Message]:
    """Return the message class of the channel, in a descriptor pool of its own."""
    pool = DescriptorPool()
    pool.Add(file_descriptor(channel))
    return GetMessageClass(pool.FindMessageTypeByName(message_name(channel)))


class RowEncoder:
    """Encoder of rows of one channel in protobuf's wire format.

    Doubles have a fixed length on the wire, so that rows differ in fixed positions only.
    """

    def __init__(self, channel: Channel) -> None:
        self.width = len(row_fields(channel))  # numbers in a row, time included
        self._template = MessageTemplate.of_doubles(
            [_tag(number) for number in range(1, self.width + 1)]
        )

    def encode(self, rows: FloatArray) -> NDArray[np.uint8]:
        """Return the messages of rows (n, `width`), each with its time first, (n, bytes)."""
        return self._template.fill(rows)


def _tag(number: int) -> bytes:
    """Return the wire tag of the double field `number`, 1..2047."""
    key = number << 3 | _WIRE_DOUBLE
    return bytes([key]) if key < 0x80 else bytes([key & 0x7F | 0x80, key >> 7])
