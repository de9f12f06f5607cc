"""MuJoCo without a renderer until one is asked for.

`import mujoco` also imports the OpenGL library that the variable MUJOCO_GL names, and fails where
there is none or the name is not one of its own. It takes a renderer that cannot be imported for a
build without renderers, which is a complete MuJoCo otherwise. `defer_renderer` makes use of that:
during the import of MuJoCo its renderers cannot be found, later they can.
"""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Final

_RENDERERS: Final = "mujoco.rendering"
_MODULE_OF: Final = {
    "Renderer": "mujoco.rendering.classic.renderer",
    "GLContext": "mujoco.rendering.classic.gl_context",
}


def defer_renderer() -> None:
    """Let MuJoCo, where it is not yet imported, import its renderers at their first use."""
    if not any(isinstance(finder, _Deferral) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Deferral())


class _Deferral(MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Refuse the renderers of a MuJoCo that is being imported; leave all else to others."""
        del path, target
        mujoco = sys.modules.get("mujoco")
        # MuJoCo sets its version after it has tried to import a renderer.
        if fullname == _RENDERERS and mujoco and not hasattr(mujoco, "__version__"):
            mujoco.__getattr__ = _renderer  # pyright: ignore[reportAttributeAccessIssue]
            raise ModuleNotFoundError(f"{fullname} is imported at its first use", name=fullname)
        return None


def _renderer(name: str) -> object:
    """Return an attribute of MuJoCo that was deferred, as its `__getattr__`."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'mujoco' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)
