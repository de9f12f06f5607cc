"""A run as it can be seen at any moment: what a picture needs, read from the log alone."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.log.log_content import read_content
from proving_ground.testbed.log.log_reader import record_of
from proving_ground.testbed.log.log_scene import (
    Line,
    Motion,
    attachment,
    ground_of,
    lines_of,
    motion_of,
)
from proving_ground.testbed.recording.channels import CONTROL, REFERENCE, STATE, TYRES, Channel
from proving_ground.testbed.recording.record import Record, Table
from proving_ground.testbed.recording.topics import (
    EVENT_TOPIC,
    PREDICTED_PATH_TOPIC,
    PREDICTED_TRAILER_PATH_TOPIC,
    REFERENCE_PATH_TOPIC,
    TRANSFORMS_TOPIC,
)
from proving_ground.testbed.truth import WHEELS
from ttempc.types import FloatArray

from ..errors import InvalidFilm
from ..results.tracking import Tracking, tracking

MODEL_FILE: Final = "model.xml"
_CHANNELS: Final = (STATE, REFERENCE, CONTROL, TYRES)
_PLANS: Final = (PREDICTED_PATH_TOPIC, PREDICTED_TRAILER_PATH_TOPIC)
_TOPICS: Final = frozenset(
    (
        *(EVENT_TOPIC, REFERENCE_PATH_TOPIC, TRANSFORMS_TOPIC, *_PLANS),
        *(channel.topic for channel in _CHANNELS),
    )
)


@dataclass(frozen=True)
class Replay:
    """A run to look at."""

    file: Path
    record: Record
    motion: Motion
    ground: Ground
    mjcf: str  # the compiled model
    path: FloatArray  # (n, 2) [m] the reference
    plans: tuple[Sequence[Line], Sequence[Line]]  # predicted paths of tractor and trailer point

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
        said = self.record.metadata
        return f"{said['scenario']} · {said['controller']} · seed {said['seed']}"

    @cached_property
    def errors(self) -> Tracking:
        """Tracking errors of the whole run."""
        return tracking(self.record)

    def poses(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return places (bodies, 3) [m] and attitudes (bodies, 4), w, x, y, z, at a moment.

        Between two records places are straight and attitudes on the shorter great circle, by the
        chord: at 0.04 s between records the wheels turn by less than 0.3 rad, where chord and
        circle differ by less than a thousandth.
        """
        motion = self.motion
        k = int(np.searchsorted(motion.time_s, time_s, side="right")) - 1
        k = min(max(k, 0), len(motion.time_s) - 2)
        before, after = motion.time_s[k], motion.time_s[k + 1]
        part = min(max((time_s - before) / (after - before), 0.0), 1.0)
        xyz = (1.0 - part) * motion.xyz[k] + part * motion.xyz[k + 1]
        start, end = motion.quat[k], motion.quat[k + 1]
        nearer = np.where(np.sum(start * end, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
        quat = (1.0 - part) * start + part * nearer * end
        return xyz, quat / np.linalg.norm(quat, axis=1, keepdims=True)

    def body(self, name: str) -> int:
        """Return the row of a body in what `poses` returns."""
        return self.motion.body_names.index(name)

    def value(self, channel: Channel, field: str, time_s: float) -> float:
        """Return a number of the newest row at a moment; the first row's before it."""
        table = self.record[channel]
        return float(table[field][newest(table, time_s)])

    def slips(self, time_s: float) -> FloatArray:
        """Return what slides of the speed of every wheel, along and across, (6,) in `WHEELS`."""
        row = newest(self.record[TYRES], time_s)
        along, angle = (
            np.array([self.record[TYRES][f"{wheel}_{part}"][row] for wheel in WHEELS])
            for part in ("slip", "slip_angle_rad")
        )
        return np.hypot(along, np.tan(angle))

    def places(self, channel: Channel, time_s: float) -> FloatArray:
        """Return both axle points of a channel with poses, (2, 2) [m], straight between rows."""
        table = self.record[channel]
        names = ("x_t_m", "y_t_m", "x_i_m", "y_i_m")
        at = [np.interp(time_s, table.time_s, table[name]) for name in names]
        return np.array(at).reshape(2, 2)

    def driven(self, time_s: float, step_m: float) -> FloatArray:
        """Return the paths of both points up to a moment, (2, n, 2) [m], a point every step."""
        table, rows = self.record[STATE], self._spaced_rows(step_m)
        passed = rows[table.time_s[rows] < time_s]
        names = ("x_t_m", "y_t_m", "x_i_m", "y_i_m")
        corners = table.columns(*names)[passed].reshape(-1, 2, 2)
        return np.concatenate([corners, self.places(STATE, time_s)[None]]).swapaxes(0, 1)

    def _spaced_rows(self, step_m: float) -> NDArray[np.intp]:
        """Return rows of the state at which another step [m] has been driven."""
        driven = np.diff(self.record[STATE].columns("x_t_m", "y_t_m"), axis=0)
        steps = np.cumsum(np.hypot(*driven.T)) // step_m
        return np.flatnonzero(np.diff(steps, prepend=-1.0, append=steps[-1]))

    def plan(self, time_s: float) -> tuple[FloatArray, ...]:
        """Return the predicted paths of both points at a moment, (n, 2) [m] each; none may be."""
        found = []
        for lines in self.plans:
            k = bisect_right(lines, time_s + 1e-9, key=lambda line: line.time_s) - 1
            if k >= 0:
                found.append(lines[k].points[:, :2])
        return tuple(found)


def newest(table: Table, time_s: float) -> int:
    """Return the row of a table that held at a moment."""
    return max(int(np.searchsorted(table.time_s, time_s + 1e-9)) - 1, 0)


def read_replay(file: Path) -> Replay:
    """Read what a picture needs.

    Raises:
        LogError: no log of ours, of another version, or one without what a picture needs.
        InvalidFilm: the log is torn, or too short to show motion.
    """
    content = read_content(file, _TOPICS.__contains__)
    if content.salvage is not None:
        raise InvalidFilm(
            f"{file}: is torn ({content.salvage}); "
            f"first: ttempc log check {file} --recover NEW.mcap"
        )
    record = record_of(content, _CHANNELS)
    for channel in _CHANNELS:
        if not len(record[channel]):
            raise InvalidFilm(f"{file}: holds nothing on {channel.topic}")
    motion = motion_of(content)
    if len(motion.time_s) < 2:
        raise InvalidFilm(f"{file}: holds a single moment, a picture needs two or more")
    path = lines_of(content, REFERENCE_PATH_TOPIC)
    if not path:
        raise InvalidFilm(f"{file}: holds nothing on {REFERENCE_PATH_TOPIC}")
    tractor, trailer = (lines_of(content, topic) for topic in _PLANS)
    return Replay(
        file,
        record,
        motion,
        ground_of(content),
        attachment(content, MODEL_FILE).decode(),
        path[0].points[:, :2],
        (tractor, trailer),
    )
