"""ROS bags: rosbag2 folders, MCAP and SQLite files of ROS 2, .bag files of ROS 1."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, cast

from ...testbed.errors import first_line, install_hint
from ..errors import MissingExtra, UnreadableFile
from .mapping import FormatMap
from .table import COLUMNS, ForeignFile, Rows, Table

_MOST_BYTES: Final = 2 * 2**30
_ROLES: Final = {
    "sensor_msgs/msg/NavSatFix": "fix",
    "nav_msgs/msg/Odometry": "odometry",
    "sensor_msgs/msg/Imu": "imu",
    "sensor_msgs/msg/JointState": "joint_states",
    "ackermann_msgs/msg/AckermannDrive": "ackermann",
    "ackermann_msgs/msg/AckermannDriveStamped": "ackermann",
}
_TRAILER: Final = ("trailer", "implement")  # in the name of a topic
_COMMANDS: Final = ("command", "cmd")  # in the name of a topic of joints
_USUAL: Final = ("fix", "odometry", "odom", "imu", "data", "joint_states", "commands")  # last parts
_NO_FIX: Final = -1
_RTK: Final = 2  # STATUS_GBAS_FIX
_FIXED_SD_M: Final = 0.1  # with a larger deviation the ambiguities are not fixed
_WHEEL: Final = "rear_wheel"
_HYDROSTAT: Final = "hydrostat"


def read_bag(path: Path, mapping: FormatMap) -> ForeignFile:
    """Return the record in a bag: positions, poses, IMU, joints and commands.

    Raises:
        UnreadableFile: the bag is damaged or too large, has no position, or a topic of the map.
        MissingExtra: the package rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtra(
            f"{path}: bags of ROS need the package rosbags; {install_hint('ros2')}"
        ) from None
    _check_size(path)
    rows = Rows()
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            chosen, notes = _choose({c.topic: c.msgtype for c in reader.connections}, mapping)
            taken = [c for c in reader.connections if c.topic in chosen]
            for connection, time_ns, raw in reader.messages(taken):
                message = reader.deserialize(raw, connection.msgtype)
                role = chosen[connection.topic]
                trailer = role.startswith("trailer_")
                values = _VALUES[role.removeprefix("trailer_")](cast(Any, message), mapping)
                named = {f"trailer_{k}": v for k, v in values.items()} if trailer else values
                if named:
                    rows.add(_stamp(message, time_ns), named)
    except UnreadableFile:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AttributeError, AssertionError) as error:
        raise UnreadableFile(f"is no bag that can be read: {first_line(error)}") from None
    return _file(rows.columns(), notes)


def _check_size(path: Path) -> None:
    """Refuse a bag that is missing, too large, or has a link out of its folder."""
    files = list(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if file.is_symlink() and path.is_dir():
            raise UnreadableFile(f"{file.name} is a link, which is not followed")
        if not file.is_file():
            raise UnreadableFile(f"{file.name}: no such file, or not a regular one")
    if (size := sum(file.stat().st_size for file in files)) > _MOST_BYTES:
        raise UnreadableFile(f"has {size} bytes, at most {_MOST_BYTES} are read")


def _choose(types: Mapping[str, str], mapping: FormatMap) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the role of each topic that is read, and notes on those that are not.

    Of several topics for a role that with a usual name is taken, then that with the shortest one.
    """
    _check_topics(types, mapping)
    chosen = {topic: role for role, topic in mapping.topics.items()}
    left_out = []
    ranks = {topic: (topic.rpartition("/")[2] not in _USUAL, len(topic), topic) for topic in types}
    for topic in sorted(types, key=ranks.__getitem__):
        role = _role(topic, types[topic])
        if role is None or topic in chosen:
            continue
        if role in chosen.values():
            left_out.append(topic)
        else:
            chosen[topic] = role
    if not chosen:
        raise UnreadableFile(
            f"has no topic of {', '.join(sorted({*_ROLES.values()}))}; has {_shown(types)}"
        )
    read = ", ".join(f"{topic} as {role}" for topic, role in chosen.items())
    notes = [f"read: {read}"]
    if left_out:
        notes.append(f"not read: {', '.join(left_out)}; [topics] of a map chooses others")
    return chosen, tuple(notes)


def _check_topics(types: Mapping[str, str], mapping: FormatMap) -> None:
    """Refuse a map that names an unknown role, or a topic that the bag does not have."""
    for role, topic in mapping.topics.items():
        if role.removeprefix("trailer_") not in _VALUES:
            raise UnreadableFile(
                f"map: topics.{role}: must be one of {', '.join(_VALUES)}, or with trailer_ before"
            )
        if topic not in types:
            raise UnreadableFile(f"map: topics.{role}: no topic {topic}; has {_shown(types)}")


def _role(topic: str, kind: str) -> str | None:
    """Return the role of a topic by its type of message and its name, None of other types."""
    role = _ROLES.get(kind)
    if role is None:
        return None
    if role == "joint_states":
        return "commands" if any(word in topic for word in _COMMANDS) else role
    return f"trailer_{role}" if any(word in topic for word in _TRAILER) else role


def _shown(types: Mapping[str, str]) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, kind in types.items())[:400] or "none"


def _file(columns: dict[str, Any], notes: tuple[str, ...]) -> ForeignFile:
    """Return the table; without a fix the poses are the places."""
    coordinates = "degrees"
    if "latitude_deg" not in columns:
        coordinates = "metres"
        for body in ("", "trailer_"):
            for axis in ("x_m", "y_m"):
                if f"{body}pose_{axis}" in columns:
                    columns[f"{body}{axis}"] = columns[f"{body}pose_{axis}"]
        if "x_m" not in columns:
            raise UnreadableFile("has neither fixes nor odometry of the tractor")
    return ForeignFile("a ROS bag", (Table(coordinates, columns),), notes=notes)


def _stamp(message: object, time_ns: int) -> float:
    """Return the time of a message's header [s]; without one, that of its record."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 1e-9 * time_ns if stamp is None else stamp.sec + 1e-9 * stamp.nanosec


def _fix(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401 - made by rosbags
    if message.status.status == _NO_FIX:
        return {}
    values = {"latitude_deg": message.latitude, "longitude_deg": message.longitude}
    values["status"] = 0.0
    if message.position_covariance_type:
        variance = 0.5 * (message.position_covariance[0] + message.position_covariance[4])
        values["sd_m"] = math.sqrt(max(variance, 0.0))
        if message.status.status == _RTK or values["sd_m"] < _FIXED_SD_M:
            values["status"] = 1.0 if values["sd_m"] < _FIXED_SD_M else 2.0
    return values


def _angles(turn: Any) -> tuple[float, float, float]:  # noqa: ANN401 - made by rosbags
    """Return roll, pitch and yaw [rad] of a quaternion."""
    roll = math.atan2(2 * (turn.w * turn.x + turn.y * turn.z), 1 - 2 * (turn.x**2 + turn.y**2))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (turn.w * turn.y - turn.z * turn.x))))
    yaw = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
    return roll, pitch, yaw


def _odometry(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401
    pose = message.pose.pose
    return {
        "pose_x_m": pose.position.x,
        "pose_y_m": pose.position.y,
        "pose_yaw_rad": _angles(pose.orientation)[2],
        "speed_mps": message.twist.twist.linear.x,
    }


def _imu(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401
    values = {"yaw_rate_radps": message.angular_velocity.z}
    if message.orientation_covariance[0] >= 0.0:
        roll, pitch, _ = _angles(message.orientation)
        values |= {"roll_rad": roll, "pitch_rad": pitch}
    return values


def _joints(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401
    values = {}
    for name, angle in zip(message.name, message.position, strict=False):
        column = mapping.joints.get(name, "")
        if column and math.isfinite(angle):
            sign = -1.0 if column.startswith("-") else 1.0
            values[column.removeprefix("-")] = sign * float(angle)
    for name, rate in zip(message.name, message.velocity, strict=False):
        if name == _WHEEL and mapping.wheel_radius_m and math.isfinite(rate):
            values["wheel_speed_mps"] = mapping.wheel_radius_m * float(rate)
    return values


def _commands(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401
    """Return the commands of joints, whose columns have `_command` before their unit."""
    joints = _joints(message, mapping)
    named = {f"{name.removesuffix('_rad')}_command_rad": value for name, value in joints.items()}
    if _HYDROSTAT in message.name:
        place = list(message.name).index(_HYDROSTAT)
        named["hydrostat_command"] = float(message.position[place])
    return {name: value for name, value in named.items() if name in COLUMNS}


def _ackermann(message: Any, mapping: FormatMap) -> dict[str, float]:  # noqa: ANN401
    drive = getattr(message, "drive", message)
    return {
        "steering_command_rad": float(drive.steering_angle),
        "speed_command_mps": float(drive.speed),
    }


_Values = Callable[[Any, FormatMap], dict[str, float]]
_VALUES: Final[dict[str, _Values]] = {
    "fix": _fix,
    "odometry": _odometry,
    "imu": _imu,
    "joint_states": _joints,
    "commands": _commands,
    "ackermann": _ackermann,
}
