"""Interactive window: a running simulation in MuJoCo's viewer."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import math
import os
import sys
import time
from types import TracebackType
from typing import Self

import mujoco
import mujoco.viewer

from ..errors import LiveError, WindowClosed
from ..recording.record import Sink
from ..simulation.plant import Plant
from ..truth import TruthBlock


class Window(Sink):
    """Window on a plant; a sink and a context manager.

    Args:
        plant: the plant to draw; it is not changed.
        speed: simulated seconds in a second of the wall clock.

    Raises:
        LiveError: there is no screen, or the speed is out of range.
    """

    def __init__(self, plant: Plant, speed: float = 1.0) -> None:
        if not (math.isfinite(speed) and speed > 0.0):
            raise LiveError(f"view: got speed {speed:g}, must be above 0")
        if sys.platform.startswith("linux") and not (
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        ):
            raise LiveError(
                "view: no screen (neither DISPLAY nor WAYLAND_DISPLAY is set); "
                "`ttempc run --live` serves the run to a viewer elsewhere"
            )
        self._plant = plant
        self._speed = speed
        self._model = plant.drawn_model()
        self._data = mujoco.MjData(self._model)
        try:
            self._viewer = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # on macOS the viewer needs its own interpreter, mjpython
            raise LiveError(f"view: no window could be opened: {error}") from error
        self._start_s = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._viewer.close()

    def scenes(self, moments: TruthBlock) -> None:
        """Draw the bodies at the last moment when its simulated time has come.

        Raises:
            WindowClosed: the user closed the window.
        """
        due_s = self._start_s + float(moments.rows[-1, 0]) / self._speed
        time.sleep(max(0.0, due_s - time.monotonic()))
        if not self._viewer.is_running():
            raise WindowClosed("the window was closed")
        with self._viewer.lock():
            self._data.qpos[:] = self._plant.data.qpos
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_camlight(self._model, self._data)
        self._viewer.sync()
