"""Pictures of a MuJoCo scene without a screen."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import os
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..errors import NoGraphics, first_line

_PACKAGES: Final = "libegl1 libgl1 (Debian, Ubuntu)"
_OFF: Final = ("disable", "disabled", "off", "false", "0")  # values of MUJOCO_GL


def graphics_context() -> Any:  # noqa: ANN401 - mujoco has no types
    """Return an OpenGL context that needs no screen, in software without a GPU; it is current.

    Raises:
        NoGraphics: the message names the packages to install.
    """
    try:
        if os.environ.get("MUJOCO_GL", "").lower() in _OFF:
            raise RuntimeError(f"MUJOCO_GL={os.environ['MUJOCO_GL']}")
        from mujoco.egl import GLContext

        context = GLContext(1, 1)  # the size is that of MuJoCo's own frame buffer
        context.make_current()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise NoGraphics(
            f"off-screen OpenGL is unavailable ({first_line(error)}): install {_PACKAGES}"
        ) from None
    return context


def off_screen_renderer(model: mujoco.MjModel) -> mujoco.MjrContext:
    """Return the renderer of a model into the off-screen buffer of the current context."""
    renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, renderer)
    return renderer


def rendered(
    scene: mujoco.MjvScene, renderer: mujoco.MjrContext, size: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return the picture of a scene of a size (width, height), (height, width, 3)."""
    width, height = size
    rectangle = mujoco.MjrRect(0, 0, width, height)
    mujoco.mjr_render(rectangle, scene, renderer)
    pixels = np.empty((height, width, 3), dtype=np.uint8)
    mujoco.mjr_readPixels(pixels, None, rectangle, renderer)
    return pixels[::-1]  # OpenGL's first row is the bottom row
