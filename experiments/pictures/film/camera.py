"""Cameras that follow the smoothed motion of the vehicle."""

import math
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ttempc.types import FloatArray

from .playback import Playback

FIELD_OF_VIEW: Final = math.radians(42.0)  # vertical angle [rad]
_MIN_CLEARANCE_M: Final = 0.6  # of the camera above the ground
_UNIT_LENGTH_M: Final = 3.8  # of a vehicle from front to trailer axle for which `unit` is 1
_Place = tuple[str, tuple[float, float, float]]
# Eye and target: from the tractor point or the middle of both axle points, how far ahead, to the
# left and above, in units.
_VIEWS: Final[dict[str, tuple[_Place, _Place]]] = {
    "chase": (("tractor", (-7.2, 2.9, 2.5)), ("middle", (0.0, 0.0, 0.5))),
    "top": (("middle", (0.0, 0.0, 15.0)), ("middle", (0.0, 0.0, 0.0))),
    "side": (("tractor", (-0.6, -7.0, 1.5)), ("middle", (0.0, 0.0, 0.55))),
    "hitch": (("tractor", (0.9, 2.6, 2.3)), ("tractor", (-1.1, 0.0, 0.1))),
}


class FollowCamera:
    """Upright cameras that follow the vehicle, smoothed by a Gaussian window in time.

    A view depends on its time only; the window grows with the speed [s of the run per s of film].
    """

    def __init__(self, playback: Playback, speed: float) -> None:
        motion = playback.motion
        self._time_s = motion.time_s
        self._terrain = playback.ground.terrain
        step_s = float(np.median(np.diff(motion.time_s)))
        w, x, y, z = motion.quat[:, playback.body("tractor")].T
        yaw = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        self._yaw = gaussian_filter1d(yaw, max(0.8, 0.4 * speed) / step_s, mode="nearest")
        window = max(0.3, 0.1 * speed) / step_s
        self._tractor, self._trailer, front = (
            gaussian_filter1d(motion.xyz[:, playback.body(name)], window, axis=0, mode="nearest")
            for name in ("tractor", "trailer", "front_axle")
        )
        axles = front[0], self._tractor[0], self._trailer[0]
        length = np.linalg.norm(axles[0] - axles[1]) + np.linalg.norm(axles[1] - axles[2])
        self.unit = float(length) / _UNIT_LENGTH_M
        """Length of the vehicle over the length of the paper's vehicle."""

    def middle(self, time_s: float) -> FloatArray:
        """Return the smoothed midpoint of both axle points, (3,) [m]."""
        return 0.5 * (self._at(self._tractor, time_s) + self._at(self._trailer, time_s))

    def view(self, camera: str, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return eye and target, (3,) [m] each, of a camera; the eye is kept above the ground.

        The view straight down ("top") has north up.
        """
        yaw = float(np.interp(time_s, self._time_s, self._yaw))
        ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        axes = np.array([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])
        tractor = self._at(self._tractor, time_s)
        middle = self.middle(time_s)
        (eye_from, eye), (target_from, target) = _VIEWS[camera]
        origins = {"tractor": tractor, "middle": middle}
        x, y, z = origins[eye_from] + self.unit * np.array(eye) @ axes
        lowest = float(self._terrain.height(x, y)) + _MIN_CLEARANCE_M
        aim = origins[target_from] + self.unit * np.array(target) @ axes
        return np.array([x, y, max(z, lowest)]), aim

    def _at(self, positions: FloatArray, time_s: float) -> FloatArray:
        return np.array([np.interp(time_s, self._time_s, column) for column in positions.T])
