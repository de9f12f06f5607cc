"""Export of a log as a rosbag2 file: MCAP with CDR messages of standard ROS 2 types.

`base_link` is the tractor point (centre of the rear axle), `trailer_link` the trailer point.
"""

from __future__ import annotations

import importlib.util
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from mcap.well_known import SchemaEncoding
from mcap.writer import Writer

from ttempc.types import FloatArray, Sensor

from ...testbed.configuration.config_io import parse_toml
from ...testbed.errors import LogError
from ...testbed.log.reader import Content, record_of
from ...testbed.log.scene import attachment, lines_of, motion_of
from ...testbed.messages.encoding import quaternion
from ...testbed.messages.publisher import nanoseconds
from ...testbed.recording import topics
from ...testbed.recording.channels import (
    CONTROL,
    ESTIMATE,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    REFERENCE,
    STATE,
)
from ...testbed.recording.record import Table
from ...testbed.truth import Pose
from ..errors import MissingExtra
from ..output import refuse_existing, write_file
from .ros2_messages import Ros2Messages, Typed

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_FRAMES: Final = {"tractor": "base_link", "trailer": "trailer_link"}
_SUFFIXES: Final = {"tractor": "t", "trailer": "i"}  # of the columns of a channel
_JOINTS: Final = {
    Sensor.STEERING_TRACTOR: "front_steering",
    Sensor.STEERING_TRAILER: "trailer_steering",
    Sensor.HITCH: "hitch",
}
_TRUE_JOINTS: Final = ("delta_t_rad", "delta_i_rad", "beta_rad")  # in the order of `_JOINTS`
_COMMANDED: Final = {
    "front_steering": "delta_t_rad_command",
    "trailer_steering": "delta_i_rad_command",
    "hydrostat": "hp_command",
}
_PATHS: Final = (
    topics.REFERENCE_PATH_TOPIC,
    topics.PREDICTED_PATH_TOPIC,
    topics.PREDICTED_TRAILER_PATH_TOPIC,
)
_X, _Y, _YAW = 0, 7, 35  # diagonal places of a covariance (6, 6) of x, y, z, roll, pitch, yaw

Stamped = tuple[str, float, Typed]
"""Topic, time of the log [s] and message."""


def export_ros2(content: Content, file: Path) -> None:
    """Write rows, events, transforms and paths of a log as a rosbag2 file.

    Raises:
        OutputExists: the file exists already or cannot be written.
        MissingExtra: rosbags is not installed.
        LogError: the log is of another version or holds no rows.
    """
    refuse_existing(file)
    if importlib.util.find_spec("rosbags") is None:
        raise MissingExtra("log ros2: needs rosbags, pip install 'ttempc-proving-ground[ros2]'")
    # Imported here because it is installed only with the extra `ros2`.
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    encoded = [
        (nanoseconds(time_s), topic, kind, bytes(store.serialize_cdr(message, kind)))
        for topic, time_s, (kind, message) in _messages(content, Ros2Messages(store))
    ]
    encoded.sort(key=lambda item: item[0])
    write_file(file, _bag(encoded, store))


def _bag(encoded: Sequence[tuple[int, str, str, bytes]], store: Typestore) -> bytes:
    """Return a rosbag2 file of messages: log time [ns], topic, type, CDR."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(profile="ros2", library="ttempc")
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for time_ns, topic, kind, data in encoded:
        if kind not in schemas:
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schemas[kind] = writer.register_schema(kind, SchemaEncoding.ROS2, text.encode())
        if topic not in channels:
            profiles = {"offered_qos_profiles": ""}  # a reader of rosbag2 asks for the key
            channels[topic] = writer.register_channel(topic, "cdr", schemas[kind], profiles)
        writer.add_message(channels[topic], time_ns, data, time_ns)
    writer.finish()
    return stream.getvalue()


def _messages(content: Content, make: Ros2Messages) -> Iterator[Stamped]:
    """Yield the messages of a log, topic by topic.

    Raises:
        LogError: the log is of another version or holds no rows.
    """
    record = record_of(content)
    if not len(record[STATE]):
        raise LogError(f"{content.path}: holds no rows")
    yield from _transforms(content, record[STATE], make)
    yield from _truth(record[STATE], make)
    yield from _estimate(record[ESTIMATE], make)
    yield from _samples(record[MEASUREMENT], _wheel_radius_m(content), make)
    for place in _FRAMES:
        for time_s, pose in _poses(record[REFERENCE], place):
            yield f"/{place}/reference", time_s, make.pose(time_s, pose)
    control = record[CONTROL]
    commands = control.columns(*_COMMANDED.values()).tolist()
    for time_s, values in zip(control.time_s.tolist(), commands, strict=True):
        yield "/commands", time_s, make.joints(time_s, tuple(_COMMANDED), values)
    for topic in _PATHS:
        for line in lines_of(content, topic):
            yield topic, line.time_s, make.path(line)
    for event in record.events:
        yield "/rosout", event.time_s, make.log(event)


def _transforms(content: Content, state: Table, make: Ros2Messages) -> Iterator[Stamped]:
    """Yield the frames of all bodies, and of both axle points where there is a row of the truth."""
    motion = motion_of(content)
    points: dict[int, list[tuple[str, Sequence[float], Sequence[float]]]] = {}
    for place, frame in _FRAMES.items():
        for time_s, pose in _poses(state, place):
            points.setdefault(nanoseconds(time_s), []).append((frame, pose[:3], quaternion(pose)))
    rows = zip(motion.time_s.tolist(), motion.xyz.tolist(), motion.quat.tolist(), strict=True)
    for time_s, xyz, quat in rows:
        bodies = zip(motion.body_names, xyz, quat, strict=True)
        frames = [*bodies, *points.get(nanoseconds(time_s), [])]
        yield "/tf", time_s, make.transforms(time_s, frames)


def _truth(state: Table, make: Ros2Messages) -> Iterator[Stamped]:
    """Yield true poses, twists and joints.

    The speeds of the trailer point are differences of its positions: a record has none.
    """
    x, y, yaw = state.columns("x_i_m", "y_i_m", "psi_i_rad").T
    pair = len(state) > 1
    east, north = (np.gradient(p, state.time_s) if pair else 0.0 * p for p in (x, y))
    forward = np.cos(yaw) * east + np.sin(yaw) * north
    left = np.cos(yaw) * north - np.sin(yaw) * east
    twists = {
        "tractor": state.columns("v_mps", "v_lateral_mps", "yaw_rate_t_radps"),
        "trailer": np.column_stack([forward, left, state["yaw_rate_i_radps"]]),
    }
    for place, frame in _FRAMES.items():
        for (time_s, pose), twist in zip(_poses(state, place), twists[place].tolist(), strict=True):
            message = make.odometry(time_s, frame, pose, twist, (np.zeros(36), np.zeros(36)))
            yield f"/{place}/odometry", time_s, message
    joints = state.columns(*_TRUE_JOINTS).tolist()
    for time_s, angles in zip(state.time_s.tolist(), joints, strict=True):
        yield "/joint_states/true", time_s, make.joints(time_s, tuple(_JOINTS.values()), angles)


def _estimate(estimate: Table, make: Ros2Messages) -> Iterator[Stamped]:
    """Yield estimated poses; the filter has neither a position covariance of the trailer point
    nor speeds of it.
    """
    columns = estimate.columns("v_mps", "sd_x_t_m", "sd_y_t_m", "sd_psi_t_rad", "sd_v_mps")
    unknown = np.zeros(36)
    unknown[0] = -1.0
    for (time_s, pose), (v, *sds) in zip(
        _poses(estimate, "tractor"), columns.tolist(), strict=True
    ):
        of_pose, of_twist = np.zeros(36), np.zeros(36)
        of_pose[[_X, _Y, _YAW]] = np.square(sds[:3])
        of_twist[_X] = sds[3] ** 2
        message = make.odometry(
            time_s, _FRAMES["tractor"], pose, (v, 0.0, 0.0), (of_pose, of_twist)
        )
        yield "/tractor/odometry/estimated", time_s, message
    for time_s, pose in _poses(estimate, "trailer"):
        message = make.odometry(
            time_s, _FRAMES["trailer"], pose, (0.0, 0.0, 0.0), (unknown, unknown)
        )
        yield "/trailer/odometry/estimated", time_s, message


def _samples(table: Table, radius_m: float, make: Ros2Messages) -> Iterator[Stamped]:
    """Yield samples at the time of their delivery, stamped with the time at which they were taken.

    The encoder's speed is given as the rate of a wheel of `radius_m` [m].
    """
    for time_s, row in zip(table.time_s.tolist(), table.values.tolist(), strict=True):
        joints: dict[float, dict[str, tuple[float, float]]] = {}  # by stamp and name
        for sensor, columns in MEASUREMENT_COLUMNS.items():
            *value, taken_s = row[columns]
            if math.isnan(taken_s):
                continue
            place = "trailer" if sensor.endswith("trailer") else "tractor"
            if sensor in _JOINTS:
                joints.setdefault(taken_s, {})[_JOINTS[sensor]] = (value[0], math.nan)
            elif sensor == Sensor.ENCODER:
                joints.setdefault(taken_s, {})["rear_wheel"] = (math.nan, value[0] / radius_m)
            elif sensor.startswith("imu"):
                yield f"/{place}/imu", time_s, make.imu(taken_s, _FRAMES[place], value)
            else:
                yield f"/{place}/position", time_s, make.point(taken_s, *value)
                yield f"/{place}/fix", time_s, make.fix(taken_s, _FRAMES[place], *value)
        for taken_s, states in joints.items():
            positions, rates = zip(*states.values(), strict=True)
            message = make.joints(taken_s, tuple(states), positions, rates)
            yield "/joint_states", time_s, message


def _poses(table: Table, place: str) -> Iterator[tuple[float, Pose]]:
    """Yield times and poses of a point, level at height 0 in a channel without height and tilt."""
    suffix = _SUFFIXES[place]
    columns: list[FloatArray] = [np.zeros(len(table))] * 6
    names = ("x_{}_m", "y_{}_m", "z_{}_m", "psi_{}_rad", "pitch_{}_rad", "roll_{}_rad")
    for i, name in enumerate(names):
        if name.format(suffix) in table.channel.fields:
            columns[i] = table[name.format(suffix)]
    for time_s, values in zip(
        table.time_s.tolist(), np.column_stack(columns).tolist(), strict=True
    ):
        yield time_s, Pose(*values)


def _wheel_radius_m(content: Content) -> float:
    """Return the radius of the rear wheels [m], from the vehicle file of the log."""
    text = attachment(content, "vehicle.toml").decode(errors="replace")
    vehicle = parse_toml(text, LogError, f"{content.path}: vehicle.toml")
    try:
        return float(vehicle["rear_wheel"]["radius_m"])
    except (KeyError, TypeError, ValueError):
        raise LogError(f"{content.path}: vehicle.toml has no rear_wheel.radius_m") from None
