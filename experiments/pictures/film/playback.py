"""Playback of a log: state, reference and scene of a run at any time."""

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ttempc.types import FloatArray

from ....testbed.ground.ground import Ground
from ....testbed.log.reader import read_content, record_of
from ....testbed.log.scene import Line, Motion, ground_of, lines_of, model_of, motion_of
from ....testbed.recording.channels import (
    CONTROL,
    EVENT_TOPIC,
    PREDICTED_PATH_TOPIC,
    PREDICTED_TRAILER_PATH_TOPIC,
    REFERENCE,
    REFERENCE_PATH_TOPIC,
    STATE,
    TOOL,
    TRANSFORMS_TOPIC,
    TYRES,
    Channel,
)
from ....testbed.recording.record import Record
from ....testbed.terminal import one_line
from ....testbed.truth import WHEELS
from ...errors import InvalidFilm
from ...results.tracking_errors import BODIES, TrackingErrors, position_fields, tracking_errors
from .drawing import Rgb

_CHANNELS: Final = (STATE, REFERENCE, CONTROL, TYRES)  # needed; `TOOL` is read besides
_PREDICTED_PATHS: Final = (PREDICTED_PATH_TOPIC, PREDICTED_TRAILER_PATH_TOPIC)
_POSITIONS: Final = tuple(field for body in BODIES for field in position_fields(body))
_SAME_TIME_S: Final = 1e-9  # times closer than this are the same
_MOST_LETTERS: Final = 80  # of a name in a picture
_BEHIND_RJ1: Final = ("drawbar", "trailer")  # beginnings of the names of bodies that it turns

Poses = tuple[FloatArray, FloatArray]
"""Positions (bodies, 3) [m] and attitudes (bodies, 4), w, x, y, z, of all bodies."""


def rotation(quat: FloatArray) -> Rotation:
    """Return the rotations of quaternions w, x, y, z as in MuJoCo, (4,) or (n, 4)."""
    return Rotation.from_quat(np.roll(quat, -1, axis=-1))  # SciPy's order is x, y, z, w


@dataclass(frozen=True)
class Playback:
    """A logged run."""

    file: Path
    record: Record
    motion: Motion
    ground: Ground
    mjcf: str  # the MuJoCo model as XML
    path: FloatArray  # (n, 2) [m] reference path
    predicted: tuple[Sequence[Line], Sequence[Line]]  # paths of tractor and trailer point

    @property
    def begin_s(self) -> float:
        """Time of the first record."""
        return float(self.motion.time_s[0])

    @property
    def end_s(self) -> float:
        """Time of the last record."""
        return float(self.motion.time_s[-1])

    @property
    def title(self) -> str:
        """Scenario, controller and seed."""
        return f"{self._said('scenario')} · {self._said('controller')} · seed {self._said('seed')}"

    @property
    def label(self) -> str:
        """Controller and seed."""
        return f"{self._said('controller')}, seed {self._said('seed')}"

    def _said(self, key: str) -> str:
        """Return what a log says of its run, as much of it as a picture has room for."""
        return one_line(self.record.metadata[key])[:_MOST_LETTERS]

    @cached_property
    def errors(self) -> TrackingErrors:
        """Tracking errors of the whole run."""
        return tracking_errors(self.record)

    def poses(self, time_s: float) -> Poses:
        """Return the poses of all bodies at a time, in the order of the log.

        Positions and quaternions are interpolated linearly between two records, the quaternions
        on the shorter arc and normalised: the wheels turn by less than 0.3 rad between records.
        """
        motion = self.motion
        k = int(np.searchsorted(motion.time_s, time_s, side="right")) - 1
        k = min(max(k, 0), len(motion.time_s) - 2)
        before = motion.time_s[k]
        after = motion.time_s[k + 1]
        part = min(max((time_s - before) / (after - before), 0.0), 1.0)
        xyz = (1.0 - part) * motion.xyz[k] + part * motion.xyz[k + 1]
        start = motion.quat[k]
        end = motion.quat[k + 1]
        nearer = np.where(np.sum(start * end, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        quat = (1.0 - part) * start + part * nearer * end
        return xyz, quat / np.linalg.norm(quat, axis=1, keepdims=True)

    def poses_of(self, bodies: Sequence[str]) -> Callable[[float], Poses]:
        """Return `poses` of some bodies, in their order."""
        rows = [self.body(name) for name in bodies]

        def poses(time_s: float) -> Poses:
            xyz, quat = self.poses(time_s)
            return xyz[rows], quat[rows]

        return poses

    def reference_poses(self, time_s: float) -> Poses:
        """Return the poses of the vehicle moved to its reference.

        Tractor and trailer move on their own: each by the distance and the turn about the vertical
        from its axle point to the reference of that point. They keep the tilt that they have.
        """
        xyz, quat = self.poses(time_s)
        placed = xyz.copy()
        turned = quat.copy()
        terrain = self.ground.terrain
        due = self.positions(REFERENCE, time_s)
        for (point, letter), (x, y) in zip(BODIES.items(), due, strict=True):
            names = enumerate(self.motion.body_names)
            rows = [k for k, n in names if n.startswith(_BEHIND_RJ1) == (point == "trailer")]
            origin = xyz[self.body(point)]
            ahead = rotation(quat[self.body(point)]).apply([1.0, 0.0, 0.0])
            yaw = self.value(REFERENCE, f"psi_{letter}_rad", time_s)
            turn = Rotation.from_euler("z", yaw - math.atan2(ahead[1], ahead[0]))
            lift = float(terrain.height(x, y) - terrain.height(*origin[:2]))
            target = np.array([x, y, origin[2] + lift])
            placed[rows] = target + turn.apply(xyz[rows] - origin)
            turned[rows] = np.roll((turn * rotation(quat[rows])).as_quat(), 1, axis=1)
        return placed, turned

    def body(self, name: str) -> int:
        """Return the row of a body in the result of `poses`."""
        return self.motion.body_names.index(name)

    def value(self, channel: Channel, field: str, time_s: float) -> float:
        """Return a field of the newest row at a time; before the first row, of the first row."""
        table = self.record[channel]
        return float(table[field][newest_row(table.time_s, time_s)])

    def slips(self, time_s: float) -> FloatArray:
        """Return the total slip of each wheel, hypot(slip, tan(slip angle)), (6,), as `WHEELS`."""
        row = newest_row(self.record[TYRES].time_s, time_s)
        along, angle = (
            np.array([self.record[TYRES][f"{wheel}_{part}"][row] for wheel in WHEELS])
            for part in ("slip", "slip_angle_rad")
        )
        return np.hypot(along, np.tan(angle))

    def positions(self, channel: Channel, time_s: float) -> FloatArray:
        """Return both axle points of a channel with poses, (2, 2) [m], linear between rows."""
        table = self.record[channel]
        at = [np.interp(time_s, table.time_s, table[field]) for field in _POSITIONS]
        return np.array(at).reshape(2, 2)

    def driven(self, time_s: float, step_m: float) -> FloatArray:
        """Return the driven paths of both points up to a time, (2, n, 2) [m], `step_m` apart."""
        table = self.record[STATE]
        points = table.columns(*_POSITIONS).reshape(-1, 2, 2)
        steps = np.cumsum(np.hypot(*np.diff(points[:, 0], axis=0).T)) // step_m
        rows = np.flatnonzero(np.diff(steps, prepend=-1.0, append=steps[-1]))
        passed = points[rows[table.time_s[rows] < time_s]]
        return np.concatenate([passed, self.positions(STATE, time_s)[None]]).swapaxes(0, 1)

    def predicted_paths(self, time_s: float) -> tuple[FloatArray, ...]:
        """Return the newest predicted paths at a time, (n, 2) [m] each; empty if there are none."""
        paths = []
        for lines in self.predicted:
            k = bisect_right(lines, time_s + _SAME_TIME_S, key=lambda line: line.time_s) - 1
            if k >= 0:
                paths.append(lines[k].points[:, :2])
        return tuple(paths)


def newest_row(times_s: FloatArray, time_s: float) -> int:
    """Return the index of the last of the sorted times that is not after a time, else 0."""
    return max(int(np.searchsorted(times_s, time_s + _SAME_TIME_S)) - 1, 0)


def read_playback(file: Path) -> Playback:
    """Read the channels and the scene of a log.

    Raises:
        LogError: the file is not a log of this version, or lacks an attachment.
        InvalidFilm: the log is torn, lacks a channel, or is too short to show motion.
    """
    topics = {EVENT_TOPIC, REFERENCE_PATH_TOPIC, TRANSFORMS_TOPIC, *_PREDICTED_PATHS}
    topics |= {channel.topic for channel in (*_CHANNELS, TOOL)}
    content = read_content(file, topics.__contains__)
    if content.salvage:
        raise InvalidFilm(
            f"{file}: is torn ({content.salvage}); first: ttempc log check {file} -o NEW.mcap"
        )
    record = record_of(content, (*_CHANNELS, TOOL))
    motion = motion_of(content)
    path = lines_of(content, REFERENCE_PATH_TOPIC)
    empty = [channel.topic for channel in _CHANNELS if len(record[channel]) < 2]
    if empty or not path or len(motion.time_s) < 2:
        raise InvalidFilm(f"{file}: is too short for a picture: {', '.join(empty)}")
    tractor, trailer = (lines_of(content, topic) for topic in _PREDICTED_PATHS)
    return Playback(
        file=file,
        record=record,
        motion=motion,
        ground=ground_of(content),
        mjcf=model_of(content),
        path=path[0].points[:, :2],
        predicted=(tractor, trailer),
    )


@dataclass(frozen=True)
class Ghost:
    """A vehicle that is drawn translucent: of another run, or on the reference."""

    name: str
    colour: Rgb
    poses: Callable[[float], Poses]  # of the bodies of the vehicle in the picture, at a time
