"""Picture of a plant, off-screen."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import mujoco
import numpy as np
from numpy.typing import NDArray

from ....testbed.simulation.plant import Plant
from ....testbed.viewers.off_screen import graphics_context, off_screen_renderer, rendered

_SIZE = 640, 480  # pixels: MuJoCo's default of an off-screen buffer
_VIEW = "chase"  # camera of the MJCF
_SHAPES = 1000  # in a picture, at most


class Camera:
    """Camera behind a vehicle; the model with visual shapes is compiled once a plant.

    Raises:
        NoGraphics: off-screen OpenGL is unavailable.
    """

    def __init__(self) -> None:
        self._gl = graphics_context()
        self._plant: Plant | None = None

    def picture(self, plant: Plant) -> NDArray[np.uint8]:
        """Return the picture of a plant at its present state, (height, width, 3)."""
        self._gl.make_current()
        if plant is not self._plant:
            self._plant = plant
            self._model = plant.drawn_model()
            self._data = mujoco.MjData(self._model)
            self._renderer = off_screen_renderer(self._model)
            self._scene = mujoco.MjvScene(self._model, _SHAPES)
        model = self._model
        data = self._data
        data.qpos[:] = plant.data.qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)  # which the camera follows
        mujoco.mj_camlight(model, data)
        view = mujoco.MjvCamera()
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = model.camera(_VIEW).id
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, everything, self._scene)
        return rendered(self._scene, self._renderer, _SIZE)
