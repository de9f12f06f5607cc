"""Convert a log to a rosbag2 folder: MCAP with CDR messages of standard ROS 2 types.

python docs/examples/ros2_bag.py LOG.mcap BAG [--epoch TIME]     needs rosbags, the extra `ros2`

Simulated time begins at 0, and recorders of ROS drop messages of stamp 0. `--epoch`, seconds since
1970 or a date and time as 2026-05-01T08:00:00+00:00, is the stamp of simulated time 0.

Frames after REP 103 and 105: `map` is x east, y north, z up; `base_link` is the tractor point
(centre of the rear axle), `trailer_link` the trailer point, x forward, y left. A covariance of
zeros, or one that starts with -1, is unknown.
"""

import argparse
import math
import tomllib
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from proving_ground.testbed.geodesy import MapFrame
from proving_ground.testbed.log.reader import read_content, record_of
from proving_ground.testbed.log.scene import attachment, lines_of, motion_of
from proving_ground.testbed.messages.encoding import headings, nanoseconds, quaternions
from proving_ground.testbed.recording.channels import (
    MEASUREMENT_COLUMNS,
    PREDICTED_PATH_TOPIC,
    PREDICTED_TRAILER_PATH_TOPIC,
    REFERENCE_PATH_TOPIC,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ttempc.layout import FLOAT

STORE = get_typestore(Stores.ROS2_HUMBLE)
FRAMES = {"tractor": ("base_link", "t"), "trailer": ("trailer_link", "i")}  # frame, suffix
POSE = ("x_{}_m", "y_{}_m", "z_{}_m", "psi_{}_rad", "pitch_{}_rad", "roll_{}_rad")
JOINTS = {
    "steering_tractor": "front_steering",
    "steering_trailer": "trailer_steering",
    "hitch": "hitch",
}
TRUE_JOINTS = ("delta_t_rad", "delta_i_rad", "beta_rad")  # in the order of `JOINTS`
COMMANDS = {
    "front_steering": "delta_t_rad_command",
    "trailer_steering": "delta_i_rad_command",
    "hydrostat": "hp_command",
}
PATHS = (REFERENCE_PATH_TOPIC, PREDICTED_PATH_TOPIC, PREDICTED_TRAILER_PATH_TOPIC)
LEVELS = {"info": 20, "warning": 30, "error": 40}  # rcl_interfaces/msg/Log
NO_HEIGHT_M2 = 1e6  # variance of a height that is not measured [m^2]
UNKNOWN_YAW = math.pi**2 / 3.0  # variance of an angle that may be any [rad^2]
X, Y, YAW = 0, 7, 35  # diagonal places of a covariance (6, 6) of x, y, z, roll, pitch, yaw
ZEROS = np.zeros(36)


def make(kind, **values):
    """Return a message of a type such as "nav_msgs/Path"."""
    package, name = kind.split("/")
    return STORE.types[f"{package}/msg/{name}"](**values)


@dataclass
class Epoch:
    """Stamp of simulated time 0, in whole nanoseconds: doubles of today's seconds have 200 ns."""

    ns: int = 0


EPOCH = Epoch()


def stamp_ns(time_s):
    return EPOCH.ns + int(nanoseconds(time_s))


def stamp(time_s):
    sec, nanosec = divmod(stamp_ns(time_s), 10**9)
    return make("builtin_interfaces/Time", sec=sec, nanosec=nanosec)


def header(time_s, frame="map"):
    return make("std_msgs/Header", stamp=stamp(time_s), frame_id=frame)


def vector(x, y, z=0.0, kind="Vector3"):
    return make(f"geometry_msgs/{kind}", x=x, y=y, z=z)


def turn(quat):
    w, x, y, z = quat
    return make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)


def attitude(yaw, pitch, roll):
    return quaternions(np.array([[0.0, 0.0, 0.0, yaw, pitch, roll]]))[0].tolist()


def pose(place):
    """Return a pose from x, y, z [m], yaw, pitch, roll [rad]."""
    x, y, z, *angles = place
    position = vector(x, y, z, "Point")
    return make("geometry_msgs/Pose", position=position, orientation=turn(attitude(*angles)))


def pose_stamped(time_s, place):
    return make("geometry_msgs/PoseStamped", header=header(time_s), pose=pose(place))


def odometry(time_s, frame, place, twist, of_pose=ZEROS, of_twist=ZEROS):
    """Return a pose in `map`, and forward and left speed and yaw rate in the frame."""
    forward, left, yaw_rate = twist
    linear, angular = vector(forward, left), vector(0.0, 0.0, yaw_rate)
    speeds = make("geometry_msgs/Twist", linear=linear, angular=angular)
    return make(
        "nav_msgs/Odometry",
        header=header(time_s),
        child_frame_id=frame,
        pose=make("geometry_msgs/PoseWithCovariance", pose=pose(place), covariance=of_pose),
        twist=make("geometry_msgs/TwistWithCovariance", twist=speeds, covariance=of_twist),
    )


def joints(time_s, names, positions, velocities=()):
    return make(
        "sensor_msgs/JointState",
        header=header(time_s, ""),
        name=list(names),
        position=np.array(positions, float),
        velocity=np.array(velocities, float),
        effort=np.empty(0),
    )


def transform(time_s, frame, xyz, quat):
    moved = make("geometry_msgs/Transform", translation=vector(*xyz), rotation=turn(quat))
    return make(
        "geometry_msgs/TransformStamped",
        header=header(time_s),
        child_frame_id=frame,
        transform=moved,
    )


def imu(time_s, frame, yaw_rate, roll, pitch):
    return make(
        "sensor_msgs/Imu",
        header=header(time_s, frame),
        orientation=turn(attitude(0.0, pitch, roll)),
        orientation_covariance=np.diag([0.0, 0.0, UNKNOWN_YAW]).ravel(),
        angular_velocity=vector(0.0, 0.0, yaw_rate),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(0.0, 0.0),
        linear_acceleration_covariance=np.array([-1.0, *[0.0] * 8]),
    )


@dataclass(frozen=True)
class Receiver:
    """Place of the map on the earth, and standard deviations that the estimator assumes."""

    frame: MapFrame
    fixed_sd_m: float
    float_sd_m: float

    @classmethod
    def of(cls, content):
        """Return it from metadata and scenario of a log."""
        noise = tomllib.loads(attachment(content, "scenario.toml").decode())["controller"]["noise"]
        return cls(MapFrame.of(content.metadata), noise["gnss_sd_m"], noise["gnss_float_sd_m"])


def fix(time_s, frame, sample, receiver):
    """Return a sample x, y, status as a fix: with fixed ambiguities STATUS_GBAS_FIX, as of RTK."""
    x, y, status = sample
    latitude, longitude = receiver.frame.degrees(np.array([x, y]))
    sd_m = receiver.float_sd_m if status == FLOAT else receiver.fixed_sd_m
    return make(
        "sensor_msgs/NavSatFix",
        header=header(time_s, frame),
        status=make("sensor_msgs/NavSatStatus", status=0 if status == FLOAT else 2, service=1),
        latitude=latitude,
        longitude=longitude,
        altitude=math.nan,
        position_covariance=np.diag([sd_m**2, sd_m**2, NO_HEIGHT_M2]).ravel(),
        position_covariance_type=1,  # approximated
    )


def places(table, suffix):
    """Return rows of x, y, z, yaw, pitch, roll; 0 where a channel has no such column."""
    names = [name.format(suffix) for name in POSE]
    zeros = np.zeros(len(table))
    columns = [table[name] if name in table.channel.fields else zeros for name in names]
    return np.column_stack(columns).tolist()


def truth(state):
    """Yield true poses, twists and joints; speeds of the trailer are differences of positions."""
    x, y, yaw = state.columns("x_i_m", "y_i_m", "psi_i_rad").T
    east, north = (np.gradient(p, state.time_s) for p in (x, y))
    forward, left = (
        np.cos(yaw) * east + np.sin(yaw) * north,
        np.cos(yaw) * north - np.sin(yaw) * east,
    )
    twists = {
        "tractor": state.columns("v_mps", "v_lateral_mps", "yaw_rate_t_radps"),
        "trailer": np.column_stack([forward, left, state["yaw_rate_i_radps"]]),
    }
    times = state.time_s.tolist()
    for body, (frame, suffix) in FRAMES.items():
        rows = zip(times, places(state, suffix), twists[body].tolist(), strict=True)
        for time_s, place, twist in rows:
            yield f"/{body}/odometry", time_s, odometry(time_s, frame, place, twist)
    for time_s, angles in zip(times, state.columns(*TRUE_JOINTS).tolist(), strict=True):
        yield "/joint_states/true", time_s, joints(time_s, JOINTS.values(), angles)


def estimates(table):
    """Yield estimated poses; the trailer's covariance and speed are unknown."""
    columns = table.columns("v_mps", "sd_x_t_m", "sd_y_t_m", "sd_psi_t_rad", "sd_v_mps").tolist()
    unknown = np.array([-1.0, *[0.0] * 35])
    for body, (frame, suffix) in FRAMES.items():
        topic = f"/{body}/odometry/estimated"
        rows = zip(table.time_s.tolist(), places(table, suffix), columns, strict=True)
        for time_s, place, (v, *sds) in rows:
            of_pose, of_twist, twist = unknown, unknown, (0.0, 0.0, 0.0)
            if body == "tractor":
                of_pose, of_twist, twist = np.zeros(36), np.zeros(36), (v, 0.0, 0.0)
                of_pose[[X, Y, YAW]], of_twist[X] = np.square(sds[:3]), sds[3] ** 2
            yield topic, time_s, odometry(time_s, frame, place, twist, of_pose, of_twist)


def samples(table, radius_m, receiver):
    """Yield samples at their delivery, stamped with the time at which they were taken."""
    for time_s, row in zip(table.time_s.tolist(), table.values.tolist(), strict=True):
        taken = {}  # joint states by stamp and name
        for sensor, columns in MEASUREMENT_COLUMNS.items():
            *value, taken_s = row[columns]
            body = "trailer" if sensor.endswith("trailer") else "tractor"
            frame = FRAMES[body][0]
            if math.isnan(taken_s):
                continue
            if sensor in JOINTS:
                taken.setdefault(taken_s, {})[JOINTS[sensor]] = (value[0], math.nan)
            elif sensor == "encoder":
                taken.setdefault(taken_s, {})["rear_wheel"] = (math.nan, value[0] / radius_m)
            elif sensor.startswith("imu"):
                yield f"/{body}/imu", time_s, imu(taken_s, frame, *value)
            elif sensor.startswith("velocity"):
                moves = vector(*value[:2])
                head = header(taken_s)
                moves = make("geometry_msgs/Vector3Stamped", header=head, vector=moves)
                yield f"/{body}/velocity", time_s, moves
            elif sensor.startswith("receiver"):
                continue  # there is no standard message of a receiver's warnings
            else:
                point = vector(*value[:2], kind="Point")
                head = header(taken_s)
                point = make("geometry_msgs/PointStamped", header=head, point=point)
                yield f"/{body}/position", time_s, point
                yield f"/{body}/fix", time_s, fix(taken_s, frame, value, receiver)
        for taken_s, states in taken.items():
            positions, rates = zip(*states.values(), strict=True)
            yield "/joint_states", time_s, joints(taken_s, states, positions, rates)


def messages(log):
    """Yield topic, time [s] and message of everything in a log."""
    content = read_content(log)
    record, motion = record_of(content), motion_of(content)
    vehicle = tomllib.loads(attachment(content, "vehicle.toml").decode())
    state = record["/state"]
    points = {}  # frames of both axle points by time [ns]
    for frame, suffix in FRAMES.values():
        for time_s, place in zip(state.time_s.tolist(), places(state, suffix), strict=True):
            of_time = points.setdefault(int(nanoseconds(time_s)), [])
            of_time.append(transform(time_s, frame, place[:3], attitude(*place[3:])))
    for time_s, xyz, quat in zip(motion.time_s, motion.xyz, motion.quat, strict=True):
        bodies = zip(motion.body_names, xyz.tolist(), quat.tolist(), strict=True)
        frames = [transform(time_s, *body) for body in bodies]
        frames += points.get(int(nanoseconds(time_s)), [])
        yield "/tf", time_s, make("tf2_msgs/TFMessage", transforms=frames)
    yield from truth(state)
    yield from estimates(record["/estimate"])
    radius_m = vehicle["rear_wheel"]["radius_m"]
    yield from samples(record["/measurement"], radius_m, Receiver.of(content))
    reference, control = record["/reference"], record["/control"]
    for body, (_, suffix) in FRAMES.items():
        for time_s, place in zip(reference.time_s, places(reference, suffix), strict=True):
            yield f"/{body}/reference", time_s, pose_stamped(time_s, place)
    commands = control.columns(*COMMANDS.values()).tolist()
    for time_s, values in zip(control.time_s, commands, strict=True):
        yield "/commands", time_s, joints(time_s, COMMANDS, values)
    for topic in PATHS:
        for line in lines_of(content, topic):
            rows = zip(line.points.tolist(), headings(line.points).tolist(), strict=True)
            poses = [pose_stamped(line.time_s, (*point, yaw, 0.0, 0.0)) for point, yaw in rows]
            path = make("nav_msgs/Path", header=header(line.time_s), poses=poses)
            yield topic, line.time_s, path
    for event in record.events:
        text = {"name": "ttempc", "msg": event.text, "file": "", "function": "", "line": 0}
        time, level = stamp(event.time_s), LEVELS[event.level]
        log_line = make("rcl_interfaces/Log", stamp=time, level=level, **text)
        yield "/rosout", event.time_s, log_line


def convert(log, bag):
    """Write a bag that rosbag2 and its tools open; its folder must not exist."""
    with Writer(Path(bag), version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, time_s, message in sorted(messages(log), key=lambda item: item[1]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind)
            writer.write(connections[topic], stamp_ns(time_s), data)


def seconds_of(text):
    """Return seconds since 1970 from a number or from a date and time."""
    try:
        return float(text)
    except ValueError:
        return datetime.fromisoformat(text).timestamp()


def main():
    parser = argparse.ArgumentParser(description="Convert a log to a rosbag2 folder.")
    parser.add_argument("log")
    parser.add_argument("bag")
    parser.add_argument("--epoch", type=seconds_of, default=0.0, metavar="TIME")
    arguments = parser.parse_args()
    EPOCH.ns = int(nanoseconds(arguments.epoch))
    convert(arguments.log, arguments.bag)


if __name__ == "__main__":
    main()
