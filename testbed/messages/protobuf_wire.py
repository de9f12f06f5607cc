"""Foxglove's pose and transform messages in protobuf's wire format.

To fill message objects fifty times a second would cost more than the rest of logging. These
messages have a fixed layout: doubles of eight bytes between constant tags. The numbers are rounded
to single precision (2 um at 30 m), which halves the size of a log: trailing zeros compress well.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

_NS_PER_S: Final = 1_000_000_000

_DOUBLE_BYTES: Final = 8
# x, y, z of a Vector3 (27 bytes) and x, y, z, w of a Quaternion (36), each with its tag
_POSE_TAGS: Final = (b"\x0a\x1b\x09", b"\x11", b"\x19", b"\x12\x24\x09", b"\x11", b"\x19", b"\x21")
_TRANSFORM_TAGS: Final = (b"\x22\x1b\x09", *_POSE_TAGS[1:3], b"\x2a\x24\x09", *_POSE_TAGS[4:])
_PLACE_BYTES: Final = 67  # of translation and rotation together


class MessageTemplate:
    """Template of messages of one length that differ only in some of their bytes.

    Args:
        parts: of a message in their order: constant bytes, or the number of bytes to fill in.
    """

    def __init__(self, parts: Sequence[bytes | int]) -> None:
        message, holes = bytearray(), []
        for part in parts:
            if isinstance(part, int):
                holes += range(len(message), len(message) + part)
                part = bytes(part)
            message += part
        self._message = np.frombuffer(bytes(message), np.uint8).reshape(1, -1)
        self._holes = np.array(holes, np.intp)

    @classmethod
    def of_doubles(cls, tags: Sequence[bytes]) -> MessageTemplate:
        """Return the template in which a double follows each of the tags."""
        return cls([part for tag in tags for part in (tag, _DOUBLE_BYTES)])

    def fill(self, content: NDArray[np.generic]) -> NDArray[np.uint8]:
        """Return n messages, (n, bytes), each filled with a row of `content`."""
        filled = np.repeat(self._message, len(content), axis=0)
        filled[:, self._holes] = np.ascontiguousarray(content).view(np.uint8)
        return filled


_POSE: Final = MessageTemplate.of_doubles(
    (b"\x1a\x43" + _POSE_TAGS[0], *_POSE_TAGS[1:])
)  # field 3, 67 bytes


def single(values: FloatArray) -> FloatArray:
    """Return the values rounded to single precision, as doubles."""
    return values.astype(np.float32).astype(np.float64)


@lru_cache(maxsize=1)  # messages of one moment share a stamp
def stamp(time_ns: int) -> bytes:
    """Return a google.protobuf.Timestamp; fields that are zero are left out."""
    seconds, nanos = divmod(time_ns, _NS_PER_S)
    field = b"\x08" + varint(seconds) if seconds else b""
    return field + b"\x10" + varint(nanos) if nanos else field


@lru_cache(maxsize=1024)
def varint(value: int) -> bytes:
    """Return an integer, 0 or above, as a protobuf varint."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def sized(tag: bytes, content: bytes) -> bytes:
    """Return a length-delimited field: text, bytes or a message."""
    return tag + varint(len(content)) + content


def poses(places: FloatArray) -> NDArray[np.uint8]:
    """Return field 3 of a PoseInFrame or PosesInFrame for every pose, (n, bytes).

    `places` (n, 7) holds x, y, z [m] and the quaternion x, y, z, w.
    """
    return _POSE.fill(single(places))


def in_frame(time_ns: int, frame: bytes, poses: bytes) -> bytes:
    """Return a PoseInFrame or PosesInFrame of one or more encoded `poses`."""
    time = stamp(time_ns)
    return b"\x0a%c%b\x12%c%b%b" % (len(time), time, len(frame), frame, poses)


class TransformsEncoder:
    """Encoder of transforms from one frame to every body, as FrameTransforms messages."""

    def __init__(self, parent: str, body_names: Sequence[str]) -> None:
        self._names = [
            sized(b"\x12", parent.encode()) + sized(b"\x1a", name.encode()) for name in body_names
        ]
        self._templates: dict[int, MessageTemplate] = {}  # by the length of a stamp

    def encode(
        self, times_ns: Sequence[int], xyz: FloatArray, quaternions: FloatArray
    ) -> list[bytes]:
        """Return a message for each of n times.

        `xyz` is (n, bodies, 3) [m], `quaternions` (n, bodies, 4) in the order w, x, y, z.
        """
        stamps, bodies = [stamp(time_ns) for time_ns in times_ns], len(self._names)
        places = single(np.concatenate([xyz, quaternions[..., 1:], quaternions[..., :1]], axis=2))
        numbers = places.view(np.uint8)  # (n, bodies, 56)
        messages = [b""] * len(stamps)
        for length in {len(time) for time in stamps}:
            chosen = [i for i, time in enumerate(stamps) if len(time) == length]
            times = np.frombuffer(b"".join(stamps[i] for i in chosen), np.uint8)
            times = np.broadcast_to(
                times.reshape(len(chosen), 1, length), (len(chosen), bodies, length)
            )
            content = np.concatenate([times, numbers[chosen]], axis=2)
            filled = self._template(length).fill(content.reshape(len(chosen), -1))
            for i, message in zip(chosen, filled, strict=True):
                messages[i] = message.tobytes()
        return messages

    def _template(self, stamp_bytes: int) -> MessageTemplate:
        """Return the template of a message whose stamps have a length [bytes]."""
        if stamp_bytes not in self._templates:
            parts: list[bytes | int] = []
            for name in self._names:
                time_head = b"\x0a" + varint(stamp_bytes)
                length = len(time_head) + stamp_bytes + len(name) + _PLACE_BYTES
                parts += [b"\x0a" + varint(length) + time_head, stamp_bytes, name]
                parts += [part for tag in _TRANSFORM_TAGS for part in (tag, _DOUBLE_BYTES)]
            self._templates[stamp_bytes] = MessageTemplate(parts)
        return self._templates[stamp_bytes]
