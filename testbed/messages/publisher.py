"""Publisher: protobuf messages of a run on topics, for a log or a live view."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_protobuf.schema import build_file_descriptor_set

from ttempc.types import FloatArray, Sensor

from ..recording import channels as topics
from ..recording.channels import CHANNELS, ERROR, MEASUREMENT, REFERENCE, STATE, Channel
from ..recording.record import Event, Sink, wrong_shape
from ..truth import TruthBlock
from .encoding import (
    Encoded,
    TimesNs,
    descriptor_set,
    encode_event,
    encode_paths,
    encode_poses,
    fix_template,
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
_DRIVEN_STEP_M: Final = 1.0  # between points of the driven path
_GNSS: Final = (  # topic, frame, columns of x, y and sample time in `MEASUREMENT`
    (topics.GNSS_TOPIC, "tractor", topics.MEASUREMENT_COLUMNS[Sensor.GNSS_TRACTOR]),
    (topics.GNSS_TRAILER_TOPIC, "trailer", topics.MEASUREMENT_COLUMNS[Sensor.GNSS_TRAILER]),
)
# Pose of an axle point; columns of both poses in `STATE`.
_POSE: Final = ("x_{}_m", "y_{}_m", "z_{}_m", "psi_{}_rad", "pitch_{}_rad", "roll_{}_rad")
_POSES: Final = [STATE.fields.index(name.format(body)) for body in "ti" for name in _POSE]
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
    found = []
    for each in _with_error(channels):
        schema = descriptor_set(each)
        names = row_fields(each)
        about = {"description": each.about, **{name: topics.unit_of(name) for name in names}}
        found.append(Topic(each.topic, message_name(each), schema.SerializeToString(), about))
    for name, kind, text in _DRAWN:
        schema = build_file_descriptor_set(kind)
        full_name = kind.DESCRIPTOR.full_name
        found.append(Topic(name, full_name, schema.SerializeToString(), {"description": text}))
    return found


def _with_error(channels: Sequence[Channel]) -> Sequence[Channel]:
    """Return the channels, with that of the true error where its sources are among them."""
    return (*channels, ERROR) if {STATE, REFERENCE} <= set(channels) else channels


@dataclass(frozen=True, slots=True)
class Batch:
    """Data of a run that wait to be encoded, as they came."""

    # By topic: rows one after the other, each with its time first; those of /tf have all poses
    rows: dict[str, array[float]]
    pairs: list[tuple[FloatArray, FloatArray, FloatArray]]  # times, rows of state and of reference
    paths: list[tuple[str, float, FloatArray]]  # topic, time, points (n, 2)
    events: list[tuple[float, bytes]]  # time, message


class Publisher(Sink, ABC):
    """Base class of a sink that encodes messages; a subclass sends them.

    Data are collected, and encoded together when the subclass calls `_publish`, which another
    thread may do: in a batch a message costs a hundredth of a single one. A subclass must be ready
    to `_send` before it calls this constructor.
    """

    draws = True

    def __init__(self, scenery: Scenery, channels: Sequence[Channel]) -> None:
        self._templates = {each.topic: row_template(each) for each in _with_error(channels)}
        self._templates[topics.TRANSFORMS_TOPIC] = transforms_template(scenery.body_names)
        self._state: tuple[FloatArray, FloatArray] | None = None  # state of the latest block
        self._batch = self._empty()
        self._scenery = scenery
        self._driven: list[tuple[float, ...]] = []  # x, y of both axle points
        self._next_pose_s = 0.0
        self._next_driven_s = _DRIVEN_PERIOD_S
        if scenery.shapes:
            self._send(topics.SCENE_TOPIC, *_single(0.0, scenery.shapes))

    @abstractmethod
    def _send(self, topic: str, times_ns: TimesNs, messages: Encoded) -> None:
        """Send messages of a topic in `topics_of`."""

    @abstractmethod
    def _collected(self, time_s: float) -> None:
        """React to new data of a time [s]: `_take` and `_publish` where it is due."""

    def rows(self, channel: Channel, times: FloatArray, values: FloatArray) -> None:
        """Publish rows, and with a reference the errors of the states of its times."""
        if values.shape != (len(times), len(channel.fields)):
            raise wrong_shape(channel, times, values)
        if not len(times):
            return
        self._add(channel.topic, times, values)
        if channel is STATE:
            self._state = times, values
        elif channel is REFERENCE and self._state and np.array_equal(times, self._state[0]):
            self._batch.pairs.append((*self._state, values))
        self._collected(times[-1])

    def row(self, channel: Channel, time_s: float, values: Sequence[float] | FloatArray) -> None:
        """Publish one row."""
        if len(values) != len(channel.fields) or channel in (STATE, REFERENCE):
            return super().row(channel, time_s, values)  # is refused, or has an error
        rows = self._batch.rows[channel.topic]
        rows.append(time_s)
        rows.frombytes(np.array(values, dtype=float).tobytes())
        return self._collected(time_s)

    def event(self, event: Event) -> None:
        """Publish one event as a log line."""
        self._batch.events.append((event.time_s, encode_event(event)))
        self._collected(event.time_s)

    def scenes(self, moments: TruthBlock) -> None:
        """Publish the transforms of every body."""
        times = moments.rows[:, 0]
        self._add(topics.TRANSFORMS_TOPIC, times, moments.poses.reshape(len(times), -1))
        self._collected(times[-1])

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Publish a line of points (n, 2) [m], map frame, laid on the ground."""
        self._batch.paths.append((topic, time_s, points))
        self._collected(time_s)

    def _add(self, topic: str, times: FloatArray, values: FloatArray) -> None:
        """Copy rows while they are in the caches: later each block would be fetched anew."""
        rows = np.empty((len(times), 1 + values.shape[1]))
        rows[:, 0] = times
        rows[:, 1:] = values
        self._batch.rows[topic].frombytes(rows.tobytes())

    def _empty(self) -> Batch:
        return Batch({topic: array("d") for topic in self._templates}, [], [], [])

    def _take(self) -> Batch:
        """Return the collected data and begin anew."""
        batch, self._batch = self._batch, self._empty()
        return batch

    def _publish(self, batch: Batch) -> None:
        """Encode and send data, topic by topic; of the batches each after the one before."""
        for topic, numbers in batch.rows.items():
            if numbers:
                width = self._templates[topic].width + (topic == topics.TRANSFORMS_TOPIC)
                times_ns = self._send_rows(topic, rows := np.reshape(numbers, (-1, width)))
                if topic == MEASUREMENT.topic:
                    self._publish_fixes(times_ns, rows[:, 1:])
                elif topic == STATE.topic:
                    batch.paths.extend(self._publish_poses(rows[:, 0], rows[:, 1:]))
        if batch.pairs:
            times, states, references = map(np.concatenate, zip(*batch.pairs, strict=True))
            errors = topics.error_rows(states, references)
            self._send_rows(ERROR.topic, np.column_stack([times, errors]))
        if batch.paths:  # those of one length are encoded together
            paths = sorted(batch.paths, key=lambda path: (len(path[2]), path[0]))
            drawn = self._scenery.on_ground(np.concatenate([each for *_, each in paths]))
            begin = 0
            for count, group in groupby(paths, lambda path: len(path[2])):
                names, times_s, _ = zip(*group, strict=True)
                times_ns = nanoseconds(np.array(times_s))
                end = begin + count * len(names)
                messages = encode_paths(times_ns, drawn[begin:end].reshape(-1, count, 3))
                for topic in dict.fromkeys(names):
                    own = [name == topic for name in names]
                    self._send(topic, times_ns[own], messages[own])
                begin = end
        for event in batch.events:
            self._send(topics.EVENT_TOPIC, *_single(*event))

    def _send_rows(self, topic: str, rows: FloatArray) -> TimesNs:
        times_ns = nanoseconds(rows[:, 0])
        template = self._templates[topic]
        numbers = single(rows[:, 1:]) if topic == topics.TRANSFORMS_TOPIC else rows
        self._send(topic, times_ns, template.fill(numbers, times_ns))
        return times_ns

    def _publish_fixes(self, times_ns: TimesNs, measured: FloatArray) -> None:
        """Send the GNSS samples of measurement rows as fixes, stamped with their own time."""
        for topic, frame, columns in _GNSS:
            samples = measured[:, columns]  # x, y, status, time
            taken = ~np.isnan(samples[:, 0])
            if taken.any():
                stamps = nanoseconds(samples[taken, 3])
                places = self._scenery.frame.degrees(samples[taken, :2])
                fixes = fix_template(frame).fill(places, stamps)
                self._send(topic, times_ns[taken], fixes)

    def _publish_poses(
        self, times_s: FloatArray, states: FloatArray
    ) -> Iterator[tuple[str, float, FloatArray]]:
        """Send poses of both axle points; yield the driven paths that are due."""
        poses = states[:, _POSES]
        due = []
        placed = set(np.flatnonzero(np.isfinite(poses).all(axis=1)).tolist())
        for k, time_s in enumerate(times_s.tolist()):
            if time_s >= self._next_pose_s and k in placed:
                self._next_pose_s = time_s + _POSE_PERIOD_S
                due.append(k)
        if not due:
            return
        poses = poses[due]
        times_s = times_s[due]
        times_ns = nanoseconds(times_s)
        both = encode_poses(np.tile(times_ns, 2), np.vstack([poses[:, :6], poses[:, 6:]]))
        self._send(topics.TRACTOR_TOPIC, times_ns, both[: len(due)])
        self._send(topics.TRAILER_TOPIC, times_ns, both[len(due) :])
        points = poses[:, [0, 1, 6, 7]].tolist()
        for time_s, (x, y, *trailer) in zip(times_s.tolist(), points, strict=True):
            if not self._driven or math.dist((x, y), self._driven[-1][:2]) > _DRIVEN_STEP_M:
                self._driven.append((x, y, *trailer))
            if time_s >= self._next_driven_s:
                self._next_driven_s = time_s + max(_DRIVEN_PERIOD_S, _DRIVEN_SHARE * time_s)
                driven = np.array(self._driven)
                yield topics.DRIVEN_TOPIC, time_s, driven[:, :2]
                yield topics.DRIVEN_TRAILER_TOPIC, time_s, driven[:, 2:]


def _single(time_s: float, data: bytes) -> tuple[TimesNs, Encoded]:
    """Return the arrays of one message."""
    return nanoseconds(np.array([time_s])), np.frombuffer(data, np.uint8)[None]
