"""Publisher: protobuf messages of a run on topics, for a log or a live view."""

import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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

from ..recording import channels as topics
from ..recording.channels import (
    CHANNELS,
    ERROR,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    REFERENCE,
    STATE,
    Channel,
    error_rows,
    unit_of,
)
from ..recording.record import Event, Sink, check_rows
from ..truth import Moments
from .encoding import (
    Encoded,
    descriptor_set,
    encode_event,
    encode_fixes,
    encode_paths,
    encode_poses,
    message_name,
    nanoseconds,
    row_fields,
    row_template,
    single,
    transforms_template,
)
from .scenery import Scenery

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


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with the protobuf schema of its messages."""

    name: str
    schema_name: str  # as "foxglove.Log"
    schema: bytes  # serialised FileDescriptorSet
    metadata: Mapping[str, str]  # "description", and the unit of each number by its name


def topics_of(channels: Sequence[Channel] = CHANNELS) -> list[Topic]:
    """Return every topic of a run: its flat channels, then the topics that viewers draw."""
    flat = [
        Topic(
            each.topic,
            message_name(each),
            descriptor_set(each).SerializeToString(),
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


class Publisher(Sink, ABC):
    """Base class of a sink that encodes messages; a subclass sends them.

    Rows, transforms, poses and paths are collected and encoded together when the subclass calls
    `_publish`: in a batch a message costs a tenth of a single one. A subclass must be ready to
    `_send` before it calls this constructor.
    """

    def __init__(self, scenery: Scenery, channels: Sequence[Channel]) -> None:
        self._templates = {each.topic: row_template(each) for each in _with_error(channels)}
        self._rows = {topic: array("d") for topic in self._templates}  # each with its time first
        self._states = np.empty(0), np.empty((0, 0))  # times and rows of the latest states
        self._pairs = array("d")  # time, row of the state, row of the reference at that time
        self._scenery = scenery
        self._transforms = transforms_template(scenery.body_names)
        self._scenes: list[tuple[FloatArray, FloatArray]] = []  # times and poses of the bodies
        self._poses: list[tuple[float, ...]] = []  # time, poses of both axle points
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

    def _send_all(self, topic: str, times_ns: NDArray[np.int64], messages: Encoded) -> None:
        """Send messages of one length on a topic."""
        for time_ns, message in zip(times_ns.tolist(), messages, strict=True):
            self._send(topic, time_ns, message.tobytes())

    def rows(self, channel: Channel, times: FloatArray, values: FloatArray) -> None:
        """Publish rows, and with references the errors of the states of their times."""
        check_rows(channel, times, values)
        self._rows[channel.topic].frombytes(np.column_stack([times, values]).tobytes())
        if channel is STATE:
            self._states = times.copy(), values.copy()
        elif channel is REFERENCE and np.array_equal(self._states[0], times):
            pairs = np.column_stack([times, self._states[1], values])
            self._pairs.frombytes(pairs.tobytes())
        self._collected(float(times[-1]))

    def event(self, event: Event) -> None:
        """Publish one event as a log line."""
        self._send(topics.EVENT_TOPIC, nanoseconds(event.time_s), encode_event(event))

    def scenes(self, moments: Moments) -> None:
        """Publish the transforms of every body, the poses of both axle points and their path."""
        self._scenes.append((moments.rows[:, 0].copy(), moments.poses.copy()))
        for number in range(len(moments.rows)):
            now = moments.motion(number)
            if now.time_s < self._next_pose_s:
                continue
            self._next_pose_s = now.time_s + _POSE_PERIOD_S
            tractor = now.x_t, now.y_t, now.z_t, now.psi_t, now.pitch_t, now.roll_t
            trailer = now.x_i, now.y_i, now.z_i, now.psi_i, now.pitch_i, now.roll_i
            self._poses.append((now.time_s, *tractor, *trailer))
            x, y = self._driven[-1][:2] if self._driven else (math.inf, math.inf)
            if math.hypot(now.x_t - x, now.y_t - y) > _DRIVEN_STEP_M:
                self._driven.append((now.x_t, now.y_t, now.x_i, now.y_i))
            if now.time_s >= self._next_driven_s:
                self._next_driven_s = now.time_s + max(_DRIVEN_PERIOD_S, _DRIVEN_SHARE * now.time_s)
                driven = np.array(self._driven)
                self.path(topics.DRIVEN_TOPIC, now.time_s, driven[:, :2])
                self.path(topics.DRIVEN_TRAILER_TOPIC, now.time_s, driven[:, 2:])
        self._collected(float(moments.rows[-1, 0]))

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Publish a line of points (n, 2) [m], map frame, laid on the ground."""
        self._paths.append((topic, time_s, np.array(points)))  # a copy: the caller may reuse its
        self._collected(time_s)

    def _publish(self) -> None:
        """Encode and send the collected data, topic by topic."""
        if self._pairs:
            pairs, self._pairs = np.array(self._pairs), array("d")
            ends = [1, 1 + len(STATE.fields)]
            times, states, references = np.split(
                pairs.reshape(-1, ends[1] + len(REFERENCE.fields)), ends, axis=1
            )
            errors = np.column_stack([times, error_rows(states, references)])
            self._rows[ERROR.topic].frombytes(errors.tobytes())
        for topic, rows in self._rows.items():
            if rows:
                template, self._rows[topic] = self._templates[topic], array("d")
                table = np.array(rows).reshape(-1, template.width)
                times_ns = _nanoseconds(table[:, 0])
                self._send_all(topic, times_ns, template.fill(table))
                if topic == MEASUREMENT.topic:
                    self._publish_fixes(times_ns, table[:, 1:])
        if self._scenes:
            scenes, self._scenes = self._scenes, []
            times, poses = (np.concatenate(each) for each in zip(*scenes, strict=True))
            bodies = single(poses.reshape(len(times), -1))
            times_ns = _nanoseconds(times)
            messages = self._transforms.fill(bodies, times_ns)
            self._send_all(topics.TRANSFORMS_TOPIC, times_ns, messages)
        if self._poses:
            poses, self._poses = np.array(self._poses), []
            times_ns = _nanoseconds(poses[:, 0])
            for topic, part in zip(
                (topics.TRACTOR_TOPIC, topics.TRAILER_TOPIC), (1, 7), strict=True
            ):
                messages = encode_poses(times_ns, poses[:, part : part + 6])
                self._send_all(topic, times_ns, messages)
        if self._paths:
            paths, self._paths = self._paths, []
            names, times, lines = zip(*paths, strict=True)
            times_ns = _nanoseconds(np.array(times))
            drawn = self._scenery.on_ground(np.concatenate(lines))
            lines = np.split(drawn, np.cumsum([len(line) for line in lines[:-1]]))
            encoded = encode_paths(times_ns, lines)
            for topic, time_ns, data in zip(names, times_ns.tolist(), encoded, strict=True):
                self._send(topic, time_ns, data)

    def _publish_fixes(self, times_ns: NDArray[np.int64], measured: FloatArray) -> None:
        """Send the GNSS samples of measurement rows as fixes, stamped with their own time."""
        for topic, frame, columns in _GNSS:
            samples = measured[:, columns]  # x, y, time
            taken = ~np.isnan(samples[:, 0])
            if taken.any():
                stamps = _nanoseconds(samples[taken, 2])
                fixes = encode_fixes(frame, stamps, samples[taken, :2])
                self._send_all(topic, times_ns[taken], fixes)


def _nanoseconds(times_s: FloatArray) -> NDArray[np.int64]:
    """Return `nanoseconds` of every time, (n,)."""
    return np.rint(times_s * 1e9).astype(np.int64)
