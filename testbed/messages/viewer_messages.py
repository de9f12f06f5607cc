"""Foxglove messages for viewers: poses, paths, fixes, log lines."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from ttempc.types import FloatArray

from ..errors import LogError
from ..geodesy import DATUM
from ..recording.record import Event
from ..truth import Pose
from .protobuf_wire import in_frame, poses, sized, stamp

MAP_FRAME: Final = "map"
_MAP: Final = MAP_FRAME.encode()
_FIX: Final = struct.Struct("<cdcd")  # latitude and longitude, each with its tag
LEVELS: Final = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

_NS_PER_S: Final = 1_000_000_000


def encode_poses(times_ns: Sequence[int], places: Sequence[Pose]) -> list[bytes]:
    """Return each pose as a PoseInFrame."""
    turns = np.array([quaternion(place) for place in places])  # (n, 4) w, x, y, z
    points = np.array([(place.x, place.y, place.z) for place in places])
    wire = poses(np.column_stack([points, turns[:, 1:], turns[:, 0]]))
    return [
        in_frame(time_ns, _MAP, each.tobytes())
        for time_ns, each in zip(times_ns, wire, strict=True)
    ]


def encode_paths(times_ns: Sequence[int], lines: Sequence[FloatArray]) -> list[bytes]:
    """Return each line (n, 3) [m] as a PosesInFrame; a pose has the heading to the next point."""
    half = 0.5 * np.concatenate([headings(line) for line in lines])  # of all poses in turn
    level = np.zeros_like(half)
    wire = poses(np.column_stack([np.concatenate(lines), level, level, np.sin(half), np.cos(half)]))
    ends = np.cumsum([len(line) for line in lines]).tolist()
    return [
        in_frame(time_ns, _MAP, wire[first:end].tobytes())
        for time_ns, first, end in zip(times_ns, [0, *ends[:-1]], ends, strict=True)
    ]


def encode_fix(time_ns: int, frame: str, x: float, y: float) -> bytes:
    """Return a measured position (x, y) [m] as a LocationFix without height."""
    latitude, longitude = DATUM.degrees(x, y)
    place = _FIX.pack(b"\x09", latitude, b"\x11", longitude)
    return place + sized(b"\x32", stamp(time_ns)) + sized(b"\x3a", frame.encode())


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
