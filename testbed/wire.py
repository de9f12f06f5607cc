"""Foxglove's well-known messages of places, written straight in protobuf's wire format.

Filling message objects fifty times a second costs more than everything else that logging does.
These messages have a fixed layout: doubles of eight bytes between constant tags. Their numbers
are in single precision (2 um at 30 m), which halves the size of a log: the zeros at the end of a
number are compressed away.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

_NS_PER_S: Final = 1_000_000_000

# x, y, z of a Vector3 (27 bytes) and x, y, z, w of a Quaternion (36), each with its tag
_INNER_TAGS: Final = (b"\x0a\x1b\x09", b"\x11", b"\x19", b"\x12\x24\x09", b"\x11", b"\x19", b"\x21")
_NUMBERS: Final = len(_INNER_TAGS)
_POSE_TAGS: Final = (b"\x1a\x43" + _INNER_TAGS[0], *_INNER_TAGS[1:])  # field 3: a pose, 67 bytes
_POSE: Final = struct.Struct("<" + "".join(f"{len(tag)}sd" for tag in _POSE_TAGS))
_SINGLE: Final = struct.Struct("<7f")
_TRANSFORM_TAGS: Final = (b"\x22\x1b\x09", *_INNER_TAGS[1:3], b"\x2a\x24\x09", *_INNER_TAGS[4:])
_DOUBLE_BYTES: Final = 8
_PLACE_BYTES: Final = 67  # of translation and rotation together


def single(values: FloatArray) -> FloatArray:
    """Return the values rounded to single precision, as doubles."""
    return values.astype(np.float32).astype(np.float64)


@lru_cache(maxsize=1)  # all that is said of one moment bears the same stamp
def stamp(time_ns: int) -> bytes:
    """Return a google.protobuf.Timestamp; as all of protobuf, without what is zero."""
    seconds, nanos = divmod(time_ns, _NS_PER_S)
    said = b"\x08" + varint(seconds) if seconds else b""
    return said + b"\x10" + varint(nanos) if nanos else said


@lru_cache(maxsize=1024)
def varint(value: int) -> bytes:
    """Return a whole number, 0 or above, in the wire's variable length."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def sized(tag: bytes, content: bytes) -> bytes:
    """Return a field whose content has a length: text, bytes or a message."""
    return tag + varint(len(content)) + content


def pose(x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float) -> bytes:
    """Return field 3 of a PoseInFrame or PosesInFrame: a place [m] and its quaternion."""
    x, y, z, qx, qy, qz, qw = _SINGLE.unpack(_SINGLE.pack(x, y, z, qx, qy, qz, qw))
    a, b, c, d, e, f, g = _POSE_TAGS
    return _POSE.pack(a, x, b, y, c, z, d, qx, e, qy, f, qz, g, qw)


def in_frame(time_ns: int, frame: bytes, poses: bytes) -> bytes:
    """Return a PoseInFrame or PosesInFrame of one or more of what `pose` returned."""
    time = stamp(time_ns)
    return b"\x0a%c%b\x12%c%b%b" % (len(time), time, len(frame), frame, poses)


class TransformsEncoder:
    """Transforms from one frame to every body, as a FrameTransforms message.

    A message is a copy of the last one of the same length with other bytes in the same places.
    """

    def __init__(self, parent: str, body_names: Sequence[str]) -> None:
        self._names = [
            sized(b"\x12", parent.encode()) + sized(b"\x1a", name.encode()) for name in body_names
        ]
        self._layouts: dict[int, _Layout] = {}  # by the length of a stamp
        self._numbers = np.empty((len(self._names), _NUMBERS), np.float32)

    def encode(self, time_ns: int, xyz: FloatArray, quaternions: FloatArray) -> bytes:
        """Return the message; `xyz` (n, 3) [m], `quaternions` (n, 4) in the order w, x, y, z."""
        time, numbers = stamp(time_ns), self._numbers
        numbers[:, :3], numbers[:, 3:6], numbers[:, 6] = xyz, quaternions[:, 1:], quaternions[:, 0]
        layout = self._layouts.get(len(time))
        if layout is None:
            layout = self._layouts[len(time)] = _layout(self._names, len(time))
        layout.message[layout.stamps] = np.frombuffer(time, np.uint8)
        layout.message[layout.numbers] = numbers.astype(np.float64).view(np.uint8)
        return layout.message.tobytes()


@dataclass(frozen=True, slots=True)
class _Layout:
    """A message and where in it are the bytes that change."""

    message: NDArray[np.uint8]
    stamps: NDArray[np.intp]  # (bodies, bytes of a stamp)
    numbers: NDArray[np.intp]  # (bodies, bytes of the numbers)


def _layout(names: Sequence[bytes], stamp_bytes: int) -> _Layout:
    message, stamps, numbers = bytearray(), [], []
    for name in names:
        time_head = b"\x0a" + varint(stamp_bytes)
        length = len(time_head) + stamp_bytes + len(name) + _PLACE_BYTES
        message += b"\x0a" + varint(length) + time_head
        stamps.append(len(message) + np.arange(stamp_bytes))
        message += bytes(stamp_bytes) + name
        places = []
        for tag in _TRANSFORM_TAGS:
            message += tag
            places.append(len(message) + np.arange(_DOUBLE_BYTES))
            message += bytes(_DOUBLE_BYTES)
        numbers.append(np.concatenate(places))
    return _Layout(
        np.frombuffer(message, np.uint8).copy(),
        np.array(stamps, np.intp).reshape(len(names), stamp_bytes),
        np.array(numbers, np.intp).reshape(len(names), _NUMBERS * _DOUBLE_BYTES),
    )
