"""Protobuf messages of a run: rows of channels and Foxglove's messages for viewers, in batches.

To fill message objects fifty times a second would cost more than the rest of logging. Here protobuf
writes one example of a message, and numpy copies it and writes the numbers and stamps of many
messages over those of the example. Rows of channels have all their bits; poses and shapes are
rounded to single precision (2 um at 30 m), which halves the size of a log.
"""

import itertools
from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
    SourceCodeInfo,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..errors import LogError
from ..geodesy import DATUM
from ..recording.channels import Channel
from ..recording.record import Event

PACKAGE: Final = "ttempc"
TIME_FIELD: Final = "time_s"
MAP_FRAME: Final = "map"
LEVELS: Final = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

Encoded = NDArray[np.uint8]
"""Messages of one length, (n, bytes)."""

_MESSAGE_PATH: Final = (4, 0)  # FileDescriptorProto.message_type[0], where comments hang
_NS_PER_S: Final = 1_000_000_000
# Both varints of a stamp take five bytes, of any time below 1,000 years: messages have one length.
_STAMP: Final = Timestamp(seconds=1 << 30, nanos=1 << 30)
_STAMP_DATA: Final = _STAMP.SerializeToString()
_SECONDS, _NANOS = slice(1, 6), slice(7, 12)  # places of the varints in a stamp


def nanoseconds(time_s: float) -> int:
    """Return a simulated time [s] in whole nanoseconds, the unit of logs and viewers."""
    return round(time_s * 1e9)


def hole(number: int) -> float:
    """Return a double that marks the place of a number in an example."""
    return float(np.frombuffer(b"hole%04d" % number)[0])


class Template:
    """Template of messages that differ in their stamps and doubles only.

    Args:
        example: a message with `_STAMP` for stamps, and with `hole(k)` for its double k.
    """

    def __init__(self, example: Message) -> None:
        data = example.SerializeToString()
        self._data = np.frombuffer(data, np.uint8).reshape(1, -1)
        holes = itertools.takewhile(lambda at: at >= 0, (data.find(b"hole%04d" % k) for k in _ALL))
        places = np.array([*holes], np.intp)
        self._numbers = (places[:, None] + np.arange(8)).ravel()
        self.width = len(places)  # numbers of a message
        stamps = [at for at in range(len(data)) if data.startswith(_STAMP_DATA, at)]
        self._stamps = [slice(at, at + len(_STAMP_DATA)) for at in stamps]

    def fill(self, values: FloatArray, times_ns: NDArray[np.int64] | None = None) -> Encoded:
        """Return n messages with the numbers `values` (n, doubles) at the times (n,) [ns]."""
        filled = np.repeat(self._data, len(values), axis=0)
        if self._stamps and times_ns is not None:
            stamps = np.tile(np.frombuffer(_STAMP_DATA, np.uint8), (len(values), 1))
            stamps[:, _SECONDS] = _varints(times_ns // _NS_PER_S)
            stamps[:, _NANOS] = _varints(times_ns % _NS_PER_S)
            for place in self._stamps:
                filled[:, place] = stamps
        filled[:, self._numbers] = np.ascontiguousarray(values, float).view(np.uint8)
        return filled


_ALL: Final = range(10_000)


def _varints(values: NDArray[np.int64]) -> Encoded:
    """Return integers as varints of five bytes, (n, 5); the last ones may be empty."""
    parts = (values[:, None] >> np.arange(0, 35, 7)) & 0x7F
    parts[:, :4] |= 0x80
    return parts.astype(np.uint8)


def single(values: FloatArray) -> FloatArray:
    """Return the values rounded to single precision, as doubles."""
    return values.astype(np.float32).astype(np.float64)


def _example_pose() -> Pose:
    """Return a pose with holes 0 to 6: x, y, z and the quaternion w, x, y, z."""
    orientation = {name: hole(3 + k) for k, name in enumerate("wxyz")}
    return Pose(
        position=Vector3(x=hole(0), y=hole(1), z=hole(2)), orientation=Quaternion(**orientation)
    )


_POSE: Final = Template(PoseInFrame(timestamp=_STAMP, frame_id=MAP_FRAME, pose=_example_pose()))
_PATH_HEAD: Final = Template(PosesInFrame(timestamp=_STAMP, frame_id=MAP_FRAME))
_PATH_POSE: Final = Template(PosesInFrame(poses=[_example_pose()]))  # joined, they are one message


def transforms_template(body_names: tuple[str, ...]) -> Template:
    """Return the template of a FrameTransforms from the map to every body.

    The numbers of each body are its position x, y, z [m] and its attitude w, x, y, z.
    """
    message = FrameTransforms()
    for body, name in enumerate(body_names):
        transform = message.transforms.add(
            timestamp=_STAMP, parent_frame_id=MAP_FRAME, child_frame_id=name
        )
        for k, part in enumerate("xyz"):
            setattr(transform.translation, part, hole(7 * body + k))
        for k, part in enumerate("wxyz"):
            setattr(transform.rotation, part, hole(7 * body + 3 + k))
    return Template(message)


@cache
def fix_template(frame: str) -> Template:
    """Return the template of a LocationFix; its numbers are latitude and longitude [deg]."""
    return Template(
        LocationFix(timestamp=_STAMP, frame_id=frame, latitude=hole(0), longitude=hole(1))
    )


def encode_fixes(frame: str, times_ns: NDArray[np.int64], points: FloatArray) -> Encoded:
    """Return measured positions (n, 2) [m] as LocationFix without height."""
    degrees = [DATUM.degrees(x, y) for x, y in points.tolist()]
    return fix_template(frame).fill(np.array(degrees), times_ns)


def encode_poses(times_ns: NDArray[np.int64], poses: FloatArray) -> Encoded:
    """Return poses (n, 6), x, y, z [m], yaw, pitch, roll [rad], as PoseInFrame."""
    return _POSE.fill(single(np.column_stack([poses[:, :3], quaternions(poses)])), times_ns)


def encode_paths(times_ns: NDArray[np.int64], lines: Sequence[FloatArray]) -> list[bytes]:
    """Return lines (n, 3) [m] as PosesInFrame; a pose has the heading to the next point."""
    half = 0.5 * np.concatenate([headings(line) for line in lines])  # of all poses in turn
    level = np.zeros_like(half)
    poses = np.column_stack([np.concatenate(lines), np.cos(half), level, level, np.sin(half)])
    ends = np.cumsum([len(line) for line in lines])
    parts = np.split(_PATH_POSE.fill(single(poses)), ends[:-1])
    heads = _PATH_HEAD.fill(np.empty((len(lines), 0)), times_ns)
    return [head.tobytes() + part.tobytes() for head, part in zip(heads, parts, strict=True)]


def encode_event(event: Event) -> bytes:
    """Return the event as a log line.

    Raises:
        LogError: the event's level is none of `LEVELS`.
    """
    if event.level not in LEVELS:
        raise LogError(f"event level: got {event.level!r}, allowed are {', '.join(LEVELS)}")
    line = Log(level=LEVELS[event.level], message=event.text, name="ttempc")
    line.timestamp.FromNanoseconds(nanoseconds(event.time_s))
    return line.SerializeToString()


def quaternions(poses: FloatArray) -> FloatArray:
    """Return the attitudes w, x, y, z, (n, 4), of poses (n, 6), R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(0.5 * poses[:, 3:].T), np.sin(0.5 * poses[:, 3:].T)
    return np.column_stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


def headings(points: FloatArray) -> FloatArray:
    """Return the heading [rad] from each point to the next, (n,); the last keeps the one before."""
    if len(points) < 2:
        return np.zeros(len(points))
    steps = np.diff(points[:, :2], axis=0)
    ahead = np.arctan2(steps[:, 1], steps[:, 0])
    return np.append(ahead, ahead[-1])


def message_name(channel: Channel) -> str:
    """Return the full protobuf name of the channel's message, "/mpc/info" -> "ttempc.MpcInfo"."""
    words = channel.topic.replace("/", " ").replace("_", " ").split()
    return f"{PACKAGE}.{''.join(word.capitalize() for word in words)}"


def row_fields(channel: Channel) -> tuple[str, ...]:
    """Return the names of the message's fields in the order of their numbers, which start at 1."""
    return (TIME_FIELD, *channel.fields)


def descriptor_set(channel: Channel) -> FileDescriptorSet:
    """Return the schema of a channel's rows: `time_s` first, then its numbers, all doubles.

    It is built from the field list, without a compiler, and travels inside the log with the
    channel's `about` as a comment: a reader needs nothing of this project.
    """
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
    return FileDescriptorSet(file=[file])


@cache
def message_class(channel: Channel) -> type[Message]:
    """Return the message class of the channel, in a descriptor pool of its own."""
    pool = DescriptorPool()
    pool.Add(descriptor_set(channel).file[0])
    return GetMessageClass(pool.FindMessageTypeByName(message_name(channel)))


@cache
def row_template(channel: Channel) -> Template:
    """Return the template of the channel's rows, each with its time [s] first."""
    fields = row_fields(channel)
    return Template(message_class(channel)(**{name: hole(k) for k, name in enumerate(fields)}))
