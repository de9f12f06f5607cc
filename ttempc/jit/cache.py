"""Disk cache of compiled kernels that is valid for exactly the code that they depend on.

The cache of `numba.njit(cache=True)` looks at the file and the byte code of a function alone: it
still loads the old machine code when a kernel or a constant that the function imports from another
module has changed, and compiles anew when a file was only touched. Here a file is named after a
digest of all that its machine code depends on, see `fingerprint`; where sources lie and when they
were written does not count.

A kernel is looked for in two folders: in the one that a wheel carries beside its code, which is
never written, then in the user's own.
"""

import functools
import gc
import hashlib
import inspect
import logging
import os
import pickle
import re
import stat
import sys
import uuid
from collections.abc import Callable
from enum import EnumType
from types import FunctionType, ModuleType
from typing import Any, Final, Generic, TypeVar

import numba
import numpy as np
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.serialize import dumps
from numba.core.types import ExternalFunction

_LOG: Final = logging.getLogger("ttempc")

T = TypeVar("T")


class Compilation(event.TimingListener):
    """Kernels that this process compiled, and the time that it took.

    `done` is whether there was one, `duration` the time [s]. `on_first` is called before the first
    one, if the result is kept on disk.
    """

    def __init__(self) -> None:
        super().__init__()
        self._began = False
        self._announced_s = 0.0
        self._collects = False  # whether garbage was collected before the outermost compilation
        self.on_first: Callable[[], object] = lambda: None

    def on_start(self, event: event.Event) -> None:
        """Announce the first kernel, unless a line said already that none is kept."""
        if not (self._began or _warn_of_no_cache.cache_info().currsize):
            _LOG.warning("compiling kernels, once: later processes load them")
            self.on_first()
        self._began = True
        if self._depth == 0:
            # The compiler makes millions of objects that live until it is done: looking for those
            # that do not takes an eighth of its time.
            self._collects = gc.isenabled()
            gc.disable()
        super().on_start(event)

    def on_end(self, event: event.Event) -> None:
        """Count the time; collect garbage again after the outermost kernel."""
        super().on_end(event)
        if self._depth == 0 and self._collects:
            gc.enable()

    def announce(self) -> None:
        """Log how long it took to compile kernels since the last such line, if it did."""
        if not self.done:  # a thread may compile the first one
            return
        since_s = self.duration - self._announced_s
        if since_s > 0.0:
            self._announced_s = self.duration
            _LOG.warning("compiled kernels in %.1f s", since_s)


COMPILATION: Final = Compilation()
event.register("numba:compile", COMPILATION)


@functools.cache
def _warn_of_no_cache(reason: str) -> None:
    _LOG.warning(
        "compiled kernels are not kept: %s; this process compiles its own, in about 25 s on an "
        "idle core; set NUMBA_CACHE_DIR to a folder of your own",
        reason,
    )


def _chosen_folder() -> str:
    """Return `NUMBA_CACHE_DIR`, else the user's own folder of kernels."""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.environ.get("NUMBA_CACHE_DIR") or os.path.join(caches, "ttempc", "kernels")


class UnsafeFolder(OSError):
    """Another user could have written the kernels of a folder: they are code, and never loaded."""


@functools.cache
def _kernel_folder() -> str:
    """Return the folder of kernels, made if it was missing.

    Raises:
        OSError: it cannot be made, belongs to another user or may be written by others.
    """
    folder = _chosen_folder()
    os.makedirs(folder, mode=0o700, exist_ok=True)
    if hasattr(os, "geteuid"):  # elsewhere a user's folders are the user's own
        found = os.stat(folder)
        if found.st_uid != os.geteuid():
            raise UnsafeFolder(f"{folder} belongs to another user")
        if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise UnsafeFolder(f"{folder} may be written by other users")
    return folder


_COMPILER_VERSION: Final = "4"
"""To be raised where `compiler` makes other machine code of the same kernel than before."""

SHIPPED: Final = "kernels"
"""Folder in a package with the machine code that its wheel carries, for some processors."""


def _shipped_folder(module: str) -> str | None:
    """Return the folder of kernels that the package of a module carries, None if it has none."""
    package = sys.modules.get(module.partition(".")[0])
    folders = getattr(package, "__path__", None)
    return os.path.join(folders[0], SHIPPED) if folders else None


class KernelCache(Generic[T]):
    """Files of what was compiled of one kernel: one for each of its signatures.

    A file that cannot be read or written, as on a full disk, is as good as none. A broken file is
    removed.

    Args:
        kernel: whose files.
        kind: what of the kernel they keep; their suffix.
        kept: makes of it what a file keeps.
        restored: makes it of numba's context and what a file keeps.
    """

    def __init__(
        self,
        kernel: Dispatcher,
        kind: str,
        kept: Callable[[T], tuple[object, ...]],
        restored: Callable[..., T],
    ) -> None:
        self._kernel = kernel
        self._kind = kind
        self._kept = kept
        self._restored = restored
        self.is_used = True

    def load(self, types: tuple[Any, ...]) -> T | None:
        """Return what is kept for these types of arguments, None if nothing is."""
        if not self.is_used:
            return None
        name = self._file_name(types)
        shipped = _shipped_folder(self._kernel.py_func.__module__)
        if shipped is not None:
            found = self._read(os.path.join(shipped, name))
            if found is not None:
                return found
        try:
            path = os.path.join(_kernel_folder(), name)
        except OSError as error:
            _warn_of_no_cache(str(error))
            return None
        found = self._read(path)
        if found is None and os.path.exists(path):  # it is broken
            _remove(path)
        return found

    def save(self, types: tuple[Any, ...], compiled: T) -> None:
        """Write what was compiled for these types of arguments."""
        if not self.is_used:
            return
        try:
            path = os.path.join(_kernel_folder(), self._file_name(types))
            _write(path, dumps(self._kept(compiled)))
        except OSError as error:
            _warn_of_no_cache(str(error))

    @property
    def _context(self) -> Any:  # noqa: ANN401 - of numba
        return self._kernel.targetctx

    def _read(self, path: str) -> T | None:
        """Return what a file keeps, None if there is none or it is broken."""
        try:
            with open(path, "rb") as file:
                content = file.read()
            return self._restored(self._context, *pickle.loads(content))
        except Exception:  # whatever a torn file makes pickle and LLVM raise
            return None

    def _file_name(self, types: tuple[Any, ...]) -> str:
        """Return the name of the file for this processor and these versions."""
        function = self._kernel.py_func
        depends_on = (
            _COMPILER_VERSION,
            repr(types),
            repr(self._context.codegen().magic_tuple()),
            numba.__version__,
            str(sys.implementation.cache_tag),
            _described(function.__name__, self._kernel),
        )
        digest = hashlib.sha256("\n".join(depends_on).encode()).hexdigest()
        name = re.sub(r"[^\w.]", "_", f"{function.__module__}.{function.__qualname__}")
        return f"{name}-{digest[:32]}.{self._kind}"


def _write(path: str, content: bytes) -> None:
    """Write a file whole or not at all, also beside other processes that write the same."""
    part = f"{path}.{uuid.uuid4().hex}.part"
    try:
        with open(part, "xb") as file:
            file.write(content)
        os.replace(part, path)
    except OSError:
        _remove(part)
        raise


def _remove(path: str) -> None:
    try:
        os.unlink(path)
    except OSError:
        return


def fingerprint(function: FunctionType) -> str:
    """Return a digest of all that the machine code of `function` depends on.

    That is its byte code, its constants without the docstring, and the globals that it reads, the
    kernels that it calls included with their own fingerprints and options.

    Raises:
        TypeError: a global is neither a module, a kernel, a function of a library, an enumeration,
            a named tuple, the type of a record, a number nor a tuple.
    """
    code = function.__code__
    constants = [value for value in code.co_consts if value is not function.__doc__]
    parts = [code.co_code.hex(), repr(constants), repr(code.co_names)]
    for name in code.co_names:
        if name in function.__globals__:
            parts.append(f"{name} = {_described(name, function.__globals__[name])}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _described(name: str, value: object) -> str:
    match value:
        case Dispatcher():
            return f"{_options(value)} {fingerprint(value.py_func)}"
        case _Intrinsic():
            return inspect.getsource(inspect.getmodule(value._defn) or value._defn)
        case EnumType():
            return repr(list(value))
        case type() if issubclass(value, tuple):  # a named one
            return repr(getattr(value, "_fields", ()))
        case ModuleType():
            return value.__name__
        case ExternalFunction() | np.dtype():
            return repr(value)
        case bool() | int() | float() | tuple():
            return repr(value)
        case _:
            raise TypeError(f"{name}: a kernel cannot depend on a global {type(value).__name__}")


def _options(kernel: Dispatcher) -> list[str]:
    """Return the options of a kernel in an order that does not change between processes."""
    return sorted(
        f"{name}={sorted(value) if isinstance(value, set) else value}"
        for name, value in kernel.targetoptions.items()
    )
