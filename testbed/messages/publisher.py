"""Publisher: protobuf messages of a run on topics, for a log or a live view."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from ttempc.types import FloatArray, Sensor

from ..recording import topics
from ..recording.channels import (
    CHANNELS,
    ERROR,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    REFERENCE,
    STATE,
    Channel,
    unit_of,
)
from ..recording.position_error import error_rows
from ..recording.record import Event
from ..recording.topics import Topic
from ..truth import Pose, Truth
from .protobuf_wire import TransformsEncoder
from .scenery import Scenery
from .schemas import RowEncoder, descriptor_set, message_name, row_fields
from .viewer_messages import MAP_FRAME, encode_event, encode_fix, encode_paths, encode_poses

_POSE_PERIOD_S: Final = 0.1 - 1e-6  # between poses: enough for trails; /tf has all
_DRIVEN_PERIOD_S: Final = 5.0  # between driven paths, at least
# ... and at least this share of the time driven: every message repeats the whole path, and with a
# fixed period their sum would grow with the square of the time.
_DRIVEN_SHARE: Final = 0.01
_DRIVEN_STEP_M: Final = 1.0  # between its points
_GNSS: Final = (  # topic, frame, columns of x, y and sample time in `MEASUREMENT`
    (topics.GNSS_TOPIC, "tractor", MEASUREMENT_COLUMNS[Sensor.GNSS_TRACTOR]),
    (topics.GNSS_TRAILER_TOPIC, "trailer", MEASUREMENT_COLUMNS[Sensor.GNSS_TRAILER]),
)
_DRAWN: Final[tuple[tuple[str, Any, str], ...]] = (
    (topics.TRANSFORMS_TOPIC, FrameTransforms, "true pose of every body in the map frame"),
    (topics.TRACTOR_TOPIC, PoseInFrame, "true pose of the tractor point"),
    (topics.TRAILER_TOPIC, PoseInFrame, "true pose of the trailer point"),
    (topics.DRIVEN_TOPIC, PosesInFrame, "path of the tractor point so far"),
    (topics.DRIVEN_TRAILER_TOPIC, PosesInFrame, "path of the trailer point so far"),
    (topics.REFERENCE_PATH_TOPIC, PosesInFrame, "reference path of both axle points"),
    (topics.PREDICTED_PATH_TOPIC, PosesInFrame, "path of the tractor point over the horizon"),
    (topics.PREDICTED_TRAILER_PATH_TOPIC, PosesInFrame, "the same of the trailer point"),
    (topics.GNSS_TOPIC, LocationFix, "GNSS samples of the tractor, stamped with their own time"),
    (topics.GNSS_TRAILER_TOPIC, LocationFix, "GNSS samples of the trailer, likewise"),
    (topics.SCENE_TOPIC, SceneUpdate, "ground, and vehicle fixed to its frames"),
    (topics.EVENT_TOPIC, Log, "start, settings, events and end of the run"),
)


def topics_of(channels: Sequence[Channel] = CHANNELS) -> list[Topic]:
    """Return every topic of a run: its flat channels, then the topics that viewers draw."""
    flat = [
        Topic(
            each.topic,
            message_name(each),
            descriptor_set(each),
            {"description": each.about, **{name: unit_of(name) for name in row_fields(each)}},
        )
        for each in _with_error(channels)
    ]
    drawn = [
        Topic(
            name,
            kind.DESCRIPTOR.full_name,
            build_file_descriptor_set(kind).SerializeToString(),
            {"description": about},
        )
        for name, kind, about in _DRAWN
    ]
    return [*flat, *drawn]


def _with_error(channels: Sequence[Channel]) -> Sequence[Channel]:
    """Return the channels, with that of the true error where its sources are among them."""
    return (*channels, ERROR) if {STATE, REFERENCE} <= set(channels) else channels


class Publisher(ABC):
    """Base class of a `testbed.recording.sink.Sink` that encodes messages; a subclass sends them.

    Rows, transforms, poses and paths are collected and encoded together when the subclass calls
    `_publish`: in a batch a message costs a tenth of a single one. A subclass must be ready to
    `_send` before it calls this constructor.
    """

    def __init__(self, scenery: Scenery, channels: Sequence[Channel]) -> None:
        self._encoders = {each.topic: RowEncoder(each) for each in _with_error(channels)}
        self._state = (math.nan, array("d"))  # time and row of the latest state
        self._pairs = array("d")  # time, row of the state, row of the reference at that time
        self._transforms = TransformsEncoder(MAP_FRAME, scenery.body_names)
        self._scenery = scenery
        self._rows = {topic: array("d") for topic in self._encoders}  # each with its time first
        self._scenes: list[tuple[float, FloatArray, FloatArray]] = []  # time, places, turns
        self._poses: list[tuple[str, float, Pose]] = []
        self._paths: list[tuple[str, float, FloatArray]] = []
        self._driven: list[tuple[float, ...]] = []  # x, y of both axle points
        self._next_pose_s = 0.0
        self._next_driven_s = _DRIVEN_PERIOD_S
        if scenery.shapes:
            self._send(topics.SCENE_TOPIC, 0, scenery.shapes)

    @abstractmethod
    def _send(self, topic: str, time_ns: int, data: bytes) -> None:
        """Send one message of a topic in `topics_of`."""

    @abstractmethod
    def _collected(self, time_s: float) -> None:
        """React to new data of a time [s]: `_publish` where it is due."""

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Publish one row, one number per field of the channel.

        Raises:
            ValueError: the number of values is not the channel's.
        """
        if len(values) != len(channel.fields):
            raise ValueError(
                f"{channel.topic}: got {len(values)} values, has {len(channel.fields)} fields"
            )
        rows = self._rows[channel.topic]
        rows.append(time_s)
        rows.extend(values)
        self._pair(channel, time_s, values)
        self._collected(time_s)

    def _pair(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Collect a state and the reference of the same time that follows it."""
        if channel is STATE:
            self._state = (time_s, array("d", values))
        elif channel is REFERENCE and self._state[0] == time_s:
            self._pairs.extend((time_s, *self._state[1], *values))

    def event(self, event: Event) -> None:
        """Publish one event as a log line."""
        time_ns = nanoseconds(event.time_s)
        self._send(topics.EVENT_TOPIC, time_ns, encode_event(time_ns, event))

    def scene(self, truth: Truth) -> None:
        """Publish the transform of every body, the poses of both axle points and their path."""
        self._scenes.append((truth.time_s, truth.body_xyz, truth.body_quat))
        if truth.time_s >= self._next_pose_s:
            self._pose(truth)
        self._collected(truth.time_s)

    def _pose(self, truth: Truth) -> None:
        """Collect the poses of both axle points, and every few seconds their path so far."""
        self._next_pose_s = truth.time_s + _POSE_PERIOD_S
        tractor, trailer = truth.tractor, truth.trailer
        self._poses.append((topics.TRACTOR_TOPIC, truth.time_s, tractor))
        self._poses.append((topics.TRAILER_TOPIC, truth.time_s, trailer))
        x, y = self._driven[-1][:2] if self._driven else (math.inf, math.inf)
        if math.hypot(tractor.x - x, tractor.y - y) > _DRIVEN_STEP_M:
            self._driven.append((tractor.x, tractor.y, trailer.x, trailer.y))
        if truth.time_s >= self._next_driven_s:
            pause = max(_DRIVEN_PERIOD_S, _DRIVEN_SHARE * truth.time_s)
            self._next_driven_s = truth.time_s + pause
            driven = np.array(self._driven)
            self.path(topics.DRIVEN_TOPIC, truth.time_s, driven[:, :2])
            self.path(topics.DRIVEN_TRAILER_TOPIC, truth.time_s, driven[:, 2:])

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Publish a line of points (n, 2) [m], map frame, laid on the ground."""
        self._paths.append(
            (topic, time_s, np.array(points))
        )  # a copy: the caller may reuse its array
        self._collected(time_s)

    def _publish(self) -> None:
        """Encode and send the collected data, topic by topic."""
        if self._pairs:
            pairs, self._pairs = np.array(self._pairs), array("d")
            width = len(STATE.fields)
            times, both = np.split(
                pairs.reshape(-1, 1 + width + len(REFERENCE.fields)), [1], axis=1
            )
            errors = error_rows(both[:, :width], both[:, width:])
            self._rows[ERROR.topic].frombytes(np.column_stack([times, errors]).tobytes())
        for topic, rows in self._rows.items():
            if rows:
                encoder, self._rows[topic] = self._encoders[topic], array("d")
                table = np.array(rows).reshape(-1, encoder.width)
                times_ns = np.rint(table[:, 0] * 1e9).astype(np.int64)  # as `nanoseconds`
                self._send_all(topic, times_ns, encoder.encode(table))
                if topic == MEASUREMENT.topic:
                    self._publish_fixes(times_ns.tolist(), table[:, 1:].tolist())
        if self._scenes:
            scenes, self._scenes = self._scenes, []
            times, places, turns = zip(*scenes, strict=True)
            times_ns = [nanoseconds(time_s) for time_s in times]
            messages = self._transforms.encode(times_ns, np.array(places), np.array(turns))
            self._send_each([topics.TRANSFORMS_TOPIC] * len(times_ns), times_ns, messages)
        if self._poses:
            poses, self._poses = self._poses, []
            names, times, places = zip(*poses, strict=True)
            times_ns = [nanoseconds(time_s) for time_s in times]
            self._send_each(names, times_ns, encode_poses(times_ns, places))
        if self._paths:
            paths, self._paths = self._paths, []
            names, times, lines = zip(*paths, strict=True)
            times_ns = [nanoseconds(time_s) for time_s in times]
            drawn = self._scenery.on_ground(np.concatenate(lines))
            lines = np.split(drawn, np.cumsum([len(line) for line in lines[:-1]]))
            self._send_each(names, times_ns, encode_paths(times_ns, lines))

    def _publish_fixes(self, times_ns: Sequence[int], measured: Sequence[Sequence[float]]) -> None:
        """Send the GNSS samples of measurement rows as fixes, stamped with their own time."""
        for topic, frame, columns in _GNSS:
            for time_ns, values in zip(times_ns, measured, strict=True):
                x, y, sampled_s = values[columns]
                if not math.isnan(x):
                    fix = encode_fix(nanoseconds(sampled_s), frame, x, y)
                    self._send(topic, time_ns, fix)

    def _send_each(
        self, names: Sequence[str], times_ns: Sequence[int], messages: Sequence[bytes]
    ) -> None:
        for topic, time_ns, message in zip(names, times_ns, messages, strict=True):
            self._send(topic, time_ns, message)

    def _send_all(
        self, topic: str, times_ns: NDArray[np.int64], messages: NDArray[np.uint8]
    ) -> None:
        """Send messages of one length on a topic, (n, bytes)."""
        for time_ns, message in zip(times_ns.tolist(), messages, strict=True):
            self._send(topic, time_ns, message.tobytes())


def nanoseconds(time_s: float) -> int:
    """Return a simulated time [s] in whole nanoseconds, the unit of logs and viewers."""
    return round(time_s * 1e9)
