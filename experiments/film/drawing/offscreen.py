"""Off-screen rendering of MuJoCo scenes with EGL, in software without a GPU."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....testbed.errors import first_line
from ...errors import NoGraphics

_PACKAGES: Final = "libegl1 libgl1 (Debian, Ubuntu)"
_OFF: Final = ("disable", "disabled", "off", "false", "0")  # values of MUJOCO_GL


def _context() -> Any:  # noqa: ANN401 - mujoco has no types
    """Return an OpenGL context that needs no screen.

    Raises:
        NoGraphics: no context can be created.
    """
    if os.environ.get("MUJOCO_GL", "").lower() in _OFF:
        raise NoGraphics(
            f"MUJOCO_GL={os.environ['MUJOCO_GL']}: rendering is switched off; unset it, "
            "or take --camera plan, which needs no OpenGL"
        )
    try:
        from mujoco.egl import GLContext

        context = GLContext(1, 1)  # the size is that of MuJoCo's own frame buffer
        context.make_current()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise NoGraphics(
            f"off-screen OpenGL is unavailable ({first_line(error)}): install {_PACKAGES}, "
            "or take --camera plan, which needs none"
        ) from None
    return context


def check_graphics() -> None:
    """Raise if rendering is unavailable.

    Raises:
        NoGraphics: the message names the packages to install.
    """
    _context().free()


class OffscreenRenderer:
    """Off-screen frame buffer for the scenes of one model."""

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int]) -> None:
        self._gl = _context()
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        self._mujoco = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mujoco)
        self._model, self._size = model, size
        self._rect = mujoco.MjrRect(0, 0, *size)

    def upload_mesh(self, mesh: int) -> None:
        """Copy a changed mesh of the model to the graphics memory."""
        self._gl.make_current()
        mujoco.mjr_uploadMesh(self._model, self._mujoco, mesh)

    def picture(self, scene: mujoco.MjvScene) -> NDArray[np.uint8]:
        """Return the rendered scene, (height, width, 3)."""
        width, height = self._size
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._mujoco)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._mujoco)
        return pixels[::-1]  # OpenGL's first row is the bottom row

    def close(self) -> None:
        """Free the context. Nothing can be rendered afterwards."""
        self._gl.make_current()
        self._mujoco.free()
        self._gl.free()
