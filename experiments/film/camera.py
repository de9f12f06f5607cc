"""Cameras that follow the smoothed motion of the vehicle."""

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
_MIN_CLEARANCE_M: Final = 0.6  # of the camera above the ground
_UNIT_LENGTH_M: Final = 3.8  # of a vehicle from front to trailer axle for which `unit` is 1


@dataclass(frozen=True, slots=True)
class View:
    """An upright camera view. Straight down, north is up."""

    eye: FloatArray  # (3,) [m] position of the camera, map frame
    target: FloatArray  # (3,) [m] point in the middle of the picture

    @property
    def forward(self) -> FloatArray:
        """Unit vector along the line of sight, (3,)."""
        along = self.target - self.eye
        return along / np.linalg.norm(along)


@dataclass(frozen=True, slots=True)
class SmoothedPose:
    """Pose of the vehicle, smoothed over time."""

    tractor: FloatArray  # (3,) [m] tractor point
    trailer: FloatArray  # (3,) [m] trailer point
    yaw: float  # [rad] of the tractor
    unit: float  # length of the vehicle over `_UNIT_LENGTH_M`

    def offset(self, ahead: float, left: float, above: float) -> FloatArray:
        """Return the position (3,) [m] at offsets from the tractor point in multiples of `unit`."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        relative = np.array([cos * ahead - sin * left, sin * ahead + cos * left, above])
        return self.tractor + self.unit * relative

    @property
    def middle(self) -> FloatArray:
        """Midpoint of both axle points, (3,) [m]."""
        return 0.5 * (self.tractor + self.trailer)


def _chase(pose: SmoothedPose) -> View:
    target = pose.middle + np.array([0.0, 0.0, 0.5 * pose.unit])
    return View(pose.offset(-7.2, 2.9, 2.5), target)


def _top(pose: SmoothedPose) -> View:
    return View(pose.middle + np.array([0.0, 0.0, 15.0 * pose.unit]), pose.middle)


def _side(pose: SmoothedPose) -> View:
    target = pose.middle + np.array([0.0, 0.0, 0.55 * pose.unit])
    return View(pose.offset(-0.6, -7.0, 1.5), target)


def _hitch(pose: SmoothedPose) -> View:
    return View(pose.offset(0.9, 2.6, 2.3), pose.offset(-1.1, 0.0, 0.1))


VIEWS: Final[dict[str, Callable[[SmoothedPose], View]]] = {
    "chase": _chase,
    "top": _top,
    "side": _side,
    "hitch": _hitch,
}


class FollowCamera:
    """Camera views that follow the vehicle, smoothed by a Gaussian window in time.

    The window is symmetric in time, so that a view depends on its time only and frames can be
    rendered in any order. Its width grows with the speed of the film.

    Args:
        replay: the run.
        speed: seconds of the run per second of film.
    """

    def __init__(self, replay: Replay, speed: float) -> None:
        motion = replay.motion
        self._time_s, self._terrain = motion.time_s, replay.ground.terrain
        step_s = float(np.median(np.diff(motion.time_s)))
        yaw = _unwrapped_yaw(motion.quat[:, replay.body("tractor")])
        self._yaw = gaussian_filter1d(yaw, max(0.8, 0.4 * speed) / step_s, mode="nearest")
        window = max(0.3, 0.1 * speed) / step_s
        tractor, trailer, front = (
            gaussian_filter1d(motion.xyz[:, replay.body(name)], window, axis=0, mode="nearest")
            for name in ("tractor", "trailer", "front_axle")
        )
        self._tractor, self._trailer = tractor, trailer
        length = np.linalg.norm(front[0] - tractor[0]) + np.linalg.norm(tractor[0] - trailer[0])
        self.unit = float(length) / _UNIT_LENGTH_M

    def pose(self, time_s: float) -> SmoothedPose:
        """Return the smoothed pose of the vehicle at a time."""

        def at(positions: FloatArray) -> FloatArray:
            return np.array([np.interp(time_s, self._time_s, column) for column in positions.T])

        yaw = float(np.interp(time_s, self._time_s, self._yaw))
        return SmoothedPose(at(self._tractor), at(self._trailer), yaw, self.unit)

    def view(self, camera: str, time_s: float) -> View:
        """Return the view of a camera of `VIEWS` at a time, kept above the ground."""
        view = VIEWS[camera](self.pose(time_s))
        x, y, z = view.eye
        lowest = float(self._terrain.height(x, y)) + _MIN_CLEARANCE_M
        return View(np.array([x, y, max(z, lowest)]), view.target)


def _unwrapped_yaw(quat: FloatArray) -> FloatArray:
    """Return the yaw [rad] of attitudes (n, 4), w, x, y, z, without jumps, (n,)."""
    w, x, y, z = quat.T
    return np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
