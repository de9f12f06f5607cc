"""Foxglove's well-known messages for what viewers draw: transforms, poses, paths, log lines.

Each encoder keeps one message and fills in its numbers: building the nested objects anew costs
ten times as much as the numbers themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

from testbed.errors import LogError
from testbed.record import Event
from testbed.truth import Pose
from ttempc.types import FloatArray

MAP_FRAME: Final = "map"
LEVELS: Final = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

_NS_PER_S: Final = 1_000_000_000


class TransformsEncoder:
    """Transforms from the map to every body."""

    def __init__(self, body_names: Sequence[str]) -> None:
        self._message = FrameTransforms()
        for name in body_names:
            self._message.transforms.add(parent_frame_id=MAP_FRAME, child_frame_id=name)
        transforms = self._message.transforms
        self._stamps = [transform.timestamp for transform in transforms]
        self._places = [(transform.translation, transform.rotation) for transform in transforms]

    def encode(self, time_ns: int, xyz: FloatArray, quaternions: FloatArray) -> bytes:
        """Return the message; `xyz` (n, 3) [m], `quaternions` (n, 4) in the order w, x, y, z."""
        seconds, nanos = divmod(time_ns, _NS_PER_S)
        for stamp in self._stamps:
            stamp.seconds, stamp.nanos = seconds, nanos
        for (position, rotation), (x, y, z), (qw, qx, qy, qz) in zip(
            self._places, xyz.tolist(), quaternions.tolist(), strict=True
        ):
            position.x, position.y, position.z = x, y, z
            rotation.w, rotation.x, rotation.y, rotation.z = qw, qx, qy, qz
        return self._message.SerializeToString()


class PoseEncoder:
    """The pose of one point of the vehicle."""

    def __init__(self) -> None:
        self._message = PoseInFrame(frame_id=MAP_FRAME)

    def encode(self, time_ns: int, pose: Pose) -> bytes:
        """Return the message."""
        stamp, place = self._message.timestamp, self._message.pose
        stamp.seconds, stamp.nanos = divmod(time_ns, _NS_PER_S)
        position, rotation = place.position, place.orientation
        position.x, position.y, position.z = pose.x, pose.y, pose.z
        rotation.w, rotation.x, rotation.y, rotation.z = quaternion(pose)
        return self._message.SerializeToString()


class PathEncoder:
    """A line of poses, each heading for the next."""

    def __init__(self) -> None:
        self._message = PosesInFrame(frame_id=MAP_FRAME)

    def encode(self, time_ns: int, points: FloatArray) -> bytes:
        """Return the message; `points` (n, 2) [m]."""
        stamp, poses = self._message.timestamp, self._message.poses
        stamp.seconds, stamp.nanos = divmod(time_ns, _NS_PER_S)
        if len(poses) > len(points):
            del poses[len(points) :]
        while len(poses) < len(points):
            poses.add()
        for pose, (x, y), heading in zip(poses, points.tolist(), headings(points), strict=True):
            pose.position.x, pose.position.y = x, y
            pose.orientation.w = math.cos(0.5 * heading)
            pose.orientation.z = math.sin(0.5 * heading)
        return self._message.SerializeToString()


def encode_event(time_ns: int, event: Event) -> bytes:
    """Return the event as a log line.

    Raises:
        LogError: the event's level is none of `LEVELS`.
    """
    if event.level not in LEVELS:
        raise LogError(f"event level: got {event.level!r}, allowed are {', '.join(LEVELS)}")
    line = Log(level=LEVELS[event.level], message=event.text, name="ttempc")
    line.timestamp.seconds, line.timestamp.nanos = divmod(time_ns, _NS_PER_S)
    return line.SerializeToString()


def quaternion(pose: Pose) -> tuple[float, float, float, float]:
    """Return w, x, y, z of the pose's attitude, R = Rz(yaw) Ry(pitch) Rx(roll)."""
    cy, sy = math.cos(0.5 * pose.yaw), math.sin(0.5 * pose.yaw)
    cp, sp = math.cos(0.5 * pose.pitch), math.sin(0.5 * pose.pitch)
    cr, sr = math.cos(0.5 * pose.roll), math.sin(0.5 * pose.roll)
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def headings(points: FloatArray) -> list[float]:
    """Return the heading [rad] from every point to the next; the last keeps the one before."""
    if len(points) < 2:
        return [0.0] * len(points)
    steps = np.diff(points, axis=0)  # (n - 1, 2)
    ahead = np.arctan2(steps[:, 1], steps[:, 0]).tolist()
    return [*ahead, ahead[-1]]
