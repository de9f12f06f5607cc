"""Foxglove's well-known messages for what viewers draw: poses, paths, fixes, log lines."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log

from testbed.datum import DATUM
from testbed.errors import LogError
from testbed.record import Event
from testbed.truth import Pose
from testbed.wire import in_frame, pose
from ttempc.types import FloatArray

MAP_FRAME: Final = "map"
_MAP: Final = MAP_FRAME.encode()
LEVELS: Final = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

_NS_PER_S: Final = 1_000_000_000


def encode_pose(time_ns: int, place: Pose) -> bytes:
    """Return the pose of one point of the vehicle as a PoseInFrame."""
    w, x, y, z = quaternion(place)
    return in_frame(time_ns, _MAP, pose(place.x, place.y, place.z, x, y, z, w))


def encode_path(time_ns: int, points: FloatArray) -> bytes:
    """Return a line of poses, each heading for the next, as a PosesInFrame; `points` (n, 3) [m]."""
    half = 0.5 * headings(points)  # (n,)
    places = zip(points.tolist(), np.sin(half).tolist(), np.cos(half).tolist(), strict=True)
    line = [pose(x, y, z, 0.0, 0.0, sine, cosine) for (x, y, z), sine, cosine in places]
    return in_frame(time_ns, _MAP, b"".join(line))


def encode_fix(time_ns: int, frame: str, x: float, y: float) -> bytes:
    """Return a measured place (x, y) [m] as a LocationFix; it says nothing of the height."""
    latitude, longitude = DATUM.degrees(x, y)
    fix = LocationFix(frame_id=frame, latitude=latitude, longitude=longitude)
    fix.timestamp.seconds, fix.timestamp.nanos = divmod(time_ns, _NS_PER_S)
    return fix.SerializeToString()


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


def headings(points: FloatArray) -> FloatArray:
    """Return the heading [rad] from each point to the next, (n,); the last keeps the one before."""
    ahead = np.zeros(len(points))
    if len(points) > 1:
        steps = points[1:] - points[:-1]  # (n - 1, ...)
        ahead[:-1] = np.arctan2(steps[:, 1], steps[:, 0])
        ahead[-1] = ahead[-2]
    return ahead
