"""Protobuf messages of a run: rows of channels and Foxglove's messages for viewers, in batches.

To fill message objects fifty times a second would cost more than the rest of logging. Here protobuf
writes one example of a message, and numpy copies it and writes the numbers and stamps of many
messages over those of the example. Rows of channels have all their bits; poses and shapes are
rounded to single precision (2 um at 30 m), which halves the size of a log.
"""

import itertools
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
from ..recording.channels import Channel
from ..recording.record import Event

PACKAGE: Final = "ttempc"
TIME_FIELD: Final = "time_s"
MAP_FRAME: Final = "map"
LEVELS: Final = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

Encoded = NDArray[np.uint8]
"""Messages of one length, (n, bytes)."""
TimesNs = NDArray[np.int64]
"""Times of messages, (n,) [ns]."""

_MESSAGE_PATH: Final = (4, 0)  # FileDescriptorProto.message_type[0], where comments hang
_NS_PER_S: Final = 1_000_000_000
# Both varints of a stamp take five bytes, of any time below 1,000 years: messages have one length.
_STAMP: Final = Timestamp(seconds=1 << 30, nanos=1 << 30)
_STAMP_DATA: Final = _STAMP.SerializeToString()
# places of the varints in a stamp
_SECONDS: Final = slice(1, 6)
_NANOS: Final = slice(7, 12)


def nanoseconds(times_s: FloatArray | float) -> TimesNs:
    """Return simulated times [s] in whole nanoseconds, the unit of logs and viewers."""
    return np.rint(np.asarray(times_s) * 1e9).astype(np.int64)


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
        self._data = np.frombuffer(data, np.uint8)
        holes = itertools.takewhile(lambda at: at >= 0, (data.find(b"hole%04d" % k) for k in _ALL))
        runs: list[list[int]] = []  # places of numbers in turn, at equal distances
        for place in holes:
            if runs and (len(run := runs[-1]) == 1 or place - run[-1] == run[1] - run[0]):
                run.append(place)
            else:
                runs.append([place])
        self.width = sum(map(len, runs))  # numbers of a message
        ends = itertools.accumulate(map(len, runs))
        self._runs = [
            (slice(end - len(run), end), run[0], run[min(1, len(run) - 1)] - run[0])
            for end, run in zip(ends, runs, strict=True)
        ]
        stamps = [at for at in range(len(data)) if data.startswith(_STAMP_DATA, at)]
        self._stamps = [slice(at, at + len(_STAMP_DATA)) for at in stamps]

    def fill(self, values: FloatArray, times_ns: TimesNs | None = None) -> Encoded:
        """Return n messages with the numbers `values` (n, doubles) at the times (n,) [ns]."""
        count = len(values)
        length = len(self._data)
        filled = np.empty((count, length), np.uint8)
        filled[:] = self._data
        if self._stamps and times_ns is not None:
            stamps = np.tile(np.frombuffer(_STAMP_DATA, np.uint8), (count, 1))
            stamps[:, _SECONDS] = _varints(times_ns // _NS_PER_S)
            stamps[:, _NANOS] = _varints(times_ns % _NS_PER_S)
            for place in self._stamps:
                filled[:, place] = stamps
        for numbers, place, stride in self._runs:
            part = values[:, numbers]
            np.ndarray(part.shape, "<f8", filled.data, place, (length, stride))[:] = part
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
    """Return the template of a LocationFix, latitude and longitude [deg], without height."""
    fix = LocationFix(timestamp=_STAMP, frame_id=frame, latitude=hole(0), longitude=hole(1))
    return Template(fix)


def encode_poses(times_ns: TimesNs, poses: FloatArray) -> Encoded:
    """Return poses (n, 6), x, y, z [m], yaw, pitch, roll [rad], as PoseInFrame."""
    return _POSE.fill(single(np.column_stack([poses[:, :3], quaternions(poses)])), times_ns)


def encode_paths(times_ns: TimesNs, lines: FloatArray) -> Encoded:
    """Return lines (n, points, 3) [m] as PosesInFrame; a pose has the heading to the next point."""
    poses = np.zeros((*lines.shape[:2], 7))
    half = 0.5 * headings(lines)
    poses[..., :3] = lines
    poses[..., 3] = np.cos(half)
    poses[..., 6] = np.sin(half)
    parts = _PATH_POSE.fill(single(poses.reshape(-1, 7)))
    heads = _PATH_HEAD.fill(np.empty((len(lines), 0)), times_ns)
    return np.hstack([heads, parts.reshape(len(lines), -1)])


def encode_event(event: Event) -> bytes:
    """Return the event as a log line.

    Raises:
        LogError: the event's level is none of `LEVELS`.
    """
    if event.level not in LEVELS:
        raise LogError(f"event level: got {event.level!r}, allowed are {', '.join(LEVELS)}")
    line = Log(level=LEVELS[event.level], message=event.text, name="ttempc")
    line.timestamp.FromNanoseconds(int(nanoseconds(event.time_s)))
    return line.SerializeToString()


def quaternions(poses: FloatArray) -> FloatArray:
    """Return the attitudes w, x, y, z, (n, 4), of poses (n, 6), R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cy, cp, cr) = np.cos(0.5 * poses[:, 3:].T)
    (sy, sp, sr) = np.sin(0.5 * poses[:, 3:].T)
    w = cy * cp * cr + sy * sp * sr
    x = cy * cp * sr - sy * sp * cr
    y = cy * sp * cr + sy * cp * sr
    z = sy * cp * cr - cy * sp * sr
    return np.column_stack([w, x, y, z])


def headings(points: FloatArray) -> FloatArray:
    """Return the heading [rad] from each point (..., n, 2 or 3) to the next, (..., n).

    The last point keeps the heading of the one before; that of a single point is 0.
    """
    steps = np.diff(points[..., :2], axis=-2)
    ahead = np.zeros(points.shape[:-1])
    ahead[..., :-1] = np.arctan2(steps[..., 1], steps[..., 0])
    if points.shape[-2] > 1:
        ahead[..., -1] = ahead[..., -2]
    return ahead


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
    kind = FieldDescriptorProto.TYPE_DOUBLE
    label = FieldDescriptorProto.LABEL_OPTIONAL
    for number, name in enumerate(row_fields(channel), start=1):
        message.field.add(name=name, number=number, type=kind, label=label)
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
