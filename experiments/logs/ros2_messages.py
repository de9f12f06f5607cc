"""Messages of standard ROS 2 types, as objects that rosbags encodes.

Frames after REP 103 and 105: `map` is x east, y north, z up; those of the vehicle are x forward, y
left. A covariance of zeros, or one that starts with -1, is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ttempc.types import FloatArray

from ...testbed.geodesy import DATUM
from ...testbed.log.scene import Line
from ...testbed.messages.encoding import MAP_FRAME, headings, quaternion
from ...testbed.messages.publisher import nanoseconds
from ...testbed.recording.record import Event
from ...testbed.truth import Pose

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_LEVELS: Final = {"info": 20, "warning": 30, "error": 40}  # rcl_interfaces/msg/Log
_UNKNOWN_YAW: Final = math.pi**2 / 3.0  # variance of an angle that may be any [rad^2]
_RTK, _GPS = 2, 1  # sensor_msgs/msg/NavSatStatus: STATUS_GBAS_FIX, SERVICE_GPS
_NS_PER_S: Final = 1_000_000_000

Typed = tuple[str, Any]
"""Type of a message, such as "nav_msgs/msg/Path", and the message."""
Placed = tuple[str, Sequence[float], Sequence[float]]
"""Name of a frame, its origin x, y, z [m] and its attitude w, x, y, z, in `map`."""


class Ros2Messages:
    """Maker of messages; times are in seconds, a time of a message is its stamp.

    Args:
        store: with the types of messages.
    """

    def __init__(self, store: Typestore) -> None:
        self._types: Any = store.types

    def odometry(
        self,
        time_s: float,
        frame: str,
        pose: Pose,
        twist: Sequence[float],
        covariances: tuple[FloatArray, FloatArray],
    ) -> Typed:
        """Return a pose in `map`, and speeds forward and left [m/s] and yaw rate in its frame.

        Args:
            time_s: stamp.
            frame: of the body.
            pose: of the body.
            twist: speed forward, speed to the left [m/s], yaw rate [rad/s].
            covariances: of pose and twist, (36,) each.
        """
        forward, left, yaw_rate = twist
        speeds = self._new(
            "geometry_msgs/msg/Twist",
            linear=self._vector(forward, left),
            angular=self._vector(0.0, 0.0, yaw_rate),
        )
        return self._typed(
            "nav_msgs/msg/Odometry",
            header=self._header(time_s),
            child_frame_id=frame,
            pose=self._new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._pose(pose),
                covariance=covariances[0],
            ),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance", twist=speeds, covariance=covariances[1]
            ),
        )

    def pose(self, time_s: float, pose: Pose) -> Typed:
        """Return a pose in `map`."""
        header = self._header(time_s)
        return self._typed("geometry_msgs/msg/PoseStamped", header=header, pose=self._pose(pose))

    def point(self, time_s: float, x: float, y: float) -> Typed:
        """Return a point in `map` [m]."""
        point = self._vector(x, y, kind="Point")
        return self._typed(
            "geometry_msgs/msg/PointStamped", header=self._header(time_s), point=point
        )

    def fix(self, time_s: float, frame: str, x: float, y: float) -> Typed:
        """Return a point in `map` [m] as degrees about the assumed datum."""
        latitude, longitude = DATUM.degrees(x, y)
        return self._typed(
            "sensor_msgs/msg/NavSatFix",
            header=self._header(time_s, frame),
            status=self._new("sensor_msgs/msg/NavSatStatus", status=_RTK, service=_GPS),
            latitude=latitude,
            longitude=longitude,
            altitude=math.nan,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )

    def imu(self, time_s: float, frame: str, sample: Sequence[float]) -> Typed:
        """Return yaw rate [rad/s], roll and pitch [rad]; yaw and accelerations are unknown."""
        yaw_rate, roll, pitch = sample
        attitude = quaternion(Pose(0.0, 0.0, 0.0, 0.0, pitch, roll))
        return self._typed(
            "sensor_msgs/msg/Imu",
            header=self._header(time_s, frame),
            orientation=self._quaternion(attitude),
            orientation_covariance=np.diag([0.0, 0.0, _UNKNOWN_YAW]).ravel(),
            angular_velocity=self._vector(0.0, 0.0, yaw_rate),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self._vector(0.0, 0.0),
            linear_acceleration_covariance=np.array([-1.0, *[0.0] * 8]),
        )

    def joints(
        self,
        time_s: float,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float] = (),
    ) -> Typed:
        """Return joint states: one position and one velocity a name, or no velocities."""
        return self._typed(
            "sensor_msgs/msg/JointState",
            header=self._header(time_s, ""),
            name=list(names),
            position=np.array(positions, dtype=float),
            velocity=np.array(velocities, dtype=float),
            effort=np.empty(0),
        )

    def transforms(self, time_s: float, frames: Iterable[Placed]) -> Typed:
        """Return the transforms of frames, all children of `map`."""
        header = self._header(time_s)
        transforms = [
            self._new(
                "geometry_msgs/msg/TransformStamped",
                header=header,
                child_frame_id=frame,
                transform=self._new(
                    "geometry_msgs/msg/Transform",
                    translation=self._vector(*xyz),
                    rotation=self._quaternion(quat),
                ),
            )
            for frame, xyz, quat in frames
        ]
        return self._typed("tf2_msgs/msg/TFMessage", transforms=transforms)

    def path(self, line: Line) -> Typed:
        """Return a line; each pose has the heading to the next point."""
        places = zip(line.points.tolist(), headings(line.points).tolist(), strict=True)
        poses = [
            self.pose(line.time_s, Pose(x, y, z, yaw, 0.0, 0.0))[1] for (x, y, z), yaw in places
        ]
        return self._typed("nav_msgs/msg/Path", header=self._header(line.time_s), poses=poses)

    def log(self, event: Event) -> Typed:
        """Return an event as a log line."""
        return self._typed(
            "rcl_interfaces/msg/Log",
            stamp=self._time(event.time_s),
            level=_LEVELS[event.level],
            name="ttempc",
            msg=event.text,
            file="",
            function="",
            line=0,
        )

    def _typed(self, kind: str, **values: object) -> Typed:
        return kind, self._new(kind, **values)

    def _new(self, kind: str, **values: object) -> Any:  # noqa: ANN401 - a class of the store
        return self._types[kind](**values)

    def _time(self, time_s: float) -> Any:  # noqa: ANN401
        sec, nanosec = divmod(nanoseconds(time_s), _NS_PER_S)
        return self._new("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def _header(self, time_s: float, frame: str = MAP_FRAME) -> Any:  # noqa: ANN401
        return self._new("std_msgs/msg/Header", stamp=self._time(time_s), frame_id=frame)

    def _vector(self, x: float, y: float, z: float = 0.0, *, kind: str = "Vector3") -> Any:  # noqa: ANN401
        return self._new(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def _quaternion(self, quat: Sequence[float]) -> Any:  # noqa: ANN401
        w, x, y, z = quat
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, pose: Pose) -> Any:  # noqa: ANN401
        return self._new(
            "geometry_msgs/msg/Pose",
            position=self._vector(pose.x, pose.y, pose.z, kind="Point"),
            orientation=self._quaternion(quaternion(pose)),
        )
