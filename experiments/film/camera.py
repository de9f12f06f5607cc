"""Where one looks from: cameras that follow the vehicle without its shaking."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ttempc.types import FloatArray

from .replay import Replay

FIELD_OF_VIEW: Final = math.radians(42.0)  # vertical
_LEAST_CLEARANCE_M: Final = 0.6  # of the eye above the ground
_UNIT_LENGTH_M: Final = 3.8  # from front to trailer axle where distances below are as they stand


@dataclass(frozen=True, slots=True)
class View:
    """An eye and what it looks at, upright; straight down, north is up."""

    eye: FloatArray  # (3,) [m] map frame
    target: FloatArray  # (3,)

    @property
    def forward(self) -> FloatArray:
        """Unit vector along the line of sight, (3,)."""
        along = self.target - self.eye
        return along / np.linalg.norm(along)


@dataclass(frozen=True, slots=True)
class Stand:
    """Where the vehicle is, smoothed over time."""

    tractor: FloatArray  # (3,) [m] tractor point
    trailer: FloatArray  # (3,) [m] trailer point
    yaw: float  # [rad] of the tractor
    unit: float  # length of the vehicle over that of the paper's

    def place(self, ahead: float, left: float, above: float) -> FloatArray:
        """Return a place beside the tractor point (3,), offsets in units of the vehicle."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        offset = np.array([cos * ahead - sin * left, sin * ahead + cos * left, above])
        return self.tractor + self.unit * offset

    @property
    def middle(self) -> FloatArray:
        """Between both points, (3,) [m]."""
        return 0.5 * (self.tractor + self.trailer)


def _chase(stand: Stand) -> View:
    target = stand.middle + np.array([0.0, 0.0, 0.75 * stand.unit])
    return View(stand.place(-7.2, 2.9, 2.3), target)


def _top(stand: Stand) -> View:
    return View(stand.middle + np.array([0.0, 0.0, 15.0 * stand.unit]), stand.middle)


def _side(stand: Stand) -> View:
    target = stand.middle + np.array([0.0, 0.0, 0.55 * stand.unit])
    return View(stand.place(-0.6, -7.0, 1.5), target)


def _hitch(stand: Stand) -> View:
    return View(stand.place(0.9, 2.6, 2.3), stand.place(-1.1, 0.0, 0.1))


VIEWS: Final[dict[str, Callable[[Stand], View]]] = {
    "chase": _chase,
    "top": _top,
    "side": _side,
    "hitch": _hitch,
}


class Operator:
    """Points the cameras: places and heading of the vehicle under a Gaussian window in time.

    The window looks both ways, so that a view depends on its time alone, in whatever order
    frames are made; it grows with the speed of the film, in which a turn is soon over.
    """

    def __init__(self, replay: Replay, speed: float) -> None:
        motion = replay.motion
        self._time_s, self._terrain = motion.time_s, replay.ground.terrain
        per_record = float(np.median(np.diff(motion.time_s)))
        turn = _unwrapped_yaw(motion.quat[:, replay.body("tractor")])
        self._yaw = gaussian_filter1d(turn, max(0.8, 0.4 * speed) / per_record, mode="nearest")
        window = max(0.3, 0.1 * speed) / per_record
        tractor, trailer, front = (
            gaussian_filter1d(motion.xyz[:, replay.body(name)], window, axis=0, mode="nearest")
            for name in ("tractor", "trailer", "front_axle")
        )
        self._tractor, self._trailer = tractor, trailer
        length = np.linalg.norm(front[0] - tractor[0]) + np.linalg.norm(tractor[0] - trailer[0])
        self.unit = float(length) / _UNIT_LENGTH_M

    def stand(self, time_s: float) -> Stand:
        """Return where the vehicle is at a moment."""

        def at(places: FloatArray) -> FloatArray:
            return np.array([np.interp(time_s, self._time_s, part) for part in places.T])

        yaw = float(np.interp(time_s, self._time_s, self._yaw))
        return Stand(at(self._tractor), at(self._trailer), yaw, self.unit)

    def view(self, camera: str, time_s: float) -> View:
        """Return the view of a camera of `VIEWS`, its eye kept above the ground."""
        view = VIEWS[camera](self.stand(time_s))
        x, y, z = view.eye
        floor = float(self._terrain.height(x, y)) + _LEAST_CLEARANCE_M
        return View(np.array([x, y, max(z, floor)]), view.target)


def _unwrapped_yaw(quat: FloatArray) -> FloatArray:
    """Return the yaw [rad] of attitudes (n, 4), w, x, y, z, without jumps, (n,)."""
    w, x, y, z = quat.T
    return np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
