"""Compilation by numba, with a disk cache that notices every change of the code."""

import atexit
import functools
import hashlib
import inspect
import logging
import math
import os
from collections.abc import Callable
from enum import EnumType
from types import FunctionType, ModuleType
from typing import Any, Final, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core import cgutils, event, typed_passes, types, untyped_passes
from numba.core.caching import FunctionCache
from numba.core.compiler import CompilerBase
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.core.types import ExternalFunction
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

_LOG: Final = logging.getLogger("ttempc")

# A process that forks or ends while another thread of it compiles waits for that thread: the child
# would inherit a lock that nobody releases, and machine code is not made in an interpreter that is
# being taken down.
atexit.register(global_compiler_lock.acquire)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )

FAST: Final = {"reassoc", "contract", "arcp", "nsz"}
"""`fastmath` of a kernel whose sums may have any order; numbers that are not finite stay so."""

P = ParamSpec("P")
R = TypeVar("R")

_PASSES: Final = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.DeadBranchPrune,  # where an argument is None
    untyped_passes.InlineInlinables,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.IRLegalization,
    typed_passes.AnnotateTypes,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)


class _Compiler(CompilerBase):
    """numba's compiler without passes for what no kernel has: they take a tenth of the time.

    Closures, expressions of whole arrays, `with` and `raise`.
    """

    def define_pipelines(self) -> list[PassManager]:
        """Return the passes."""
        passes = PassManager("kernel")
        for each in _PASSES:
            passes.add_pass(each, each.__name__)
        passes.finalize()
        return [passes]


def cached_njit(
    **options: Any,  # noqa: ANN401 - of numba
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that compiles a function in nopython mode and keeps the result on disk.

    The cache of `numba.njit(cache=True)` looks at the file and the byte code of the function alone:
    it still loads the old machine code when a kernel or a constant that the function imports from
    another module has changed. The key of this cache includes the `fingerprint` of the function.
    A process that compiles says so in a line of the logger `ttempc`. Where numba finds no folder
    that it can write to, kernels are compiled anew in every process, and the line says that.
    A kernel has nothing of what `_Compiler` leaves out: numba's error would not say so.
    """

    def compiled(function: Callable[P, R]) -> Callable[P, R]:
        every: Any = {"no_cfunc_wrapper": True, "pipeline_class": _Compiler} | options
        kernel: Any = numba.njit(**every)(function)
        if kernel is not function:  # it is under NUMBA_DISABLE_JIT
            try:
                # as numba's Dispatcher.enable_caching
                kernel._cache = _FingerprintCache(function)
            except (RuntimeError, OSError):  # no folder can be written to
                _warn_of_no_cache()
        return kernel

    return compiled


_intrinsic: Any = intrinsic  # whose types do not know that numba hands over the first argument


@_intrinsic
def record(_, row, kind):  # noqa: ANN001, ANN201
    """Return the flat array `row` as the record `kind`, as `row.view(kind)[0]` does.

    It is a cast of a pointer: `view` asks at every use whether sizes fit, in code that takes a
    tenth of a second to compile. Nothing is checked.
    """
    of = kind.dtype

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.bitcast(array.data, context.get_value_type(of))

    return of(row, kind), code


@_intrinsic(prefer_literal=True)
def local(_, shape):  # noqa: ANN001, ANN201
    """Return an array of float64 of a constant `shape` in the frame of the call, with any content.

    Nothing is allocated or counted. It must not be returned.
    """
    kind, sizes = types.Array(types.float64, len(shape), "C"), [n.literal_value for n in shape]

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401
        number, array = context.get_data_type(types.float64), context.make_array(kind)
        data = cgutils.alloca_once(builder, number, math.prod(sizes))
        made, item = array(context, builder), context.get_constant(types.intp, 8)
        lengths = [context.get_constant(types.intp, n) for n in sizes]
        strides = [
            context.get_constant(types.intp, 8 * math.prod(sizes[n + 1 :]))
            for n in range(len(sizes))
        ]
        populate_array(made, data, lengths, strides, item, None)
        return made._getvalue()

    return kind(shape), code


class Compilation(event.TimingListener):
    """Kernels that this process compiled, and the time that it took.

    `done` is whether there was one, `duration` the time [s]. `on_first` is called before the first
    one, if the result is kept on disk.
    """

    def __init__(self) -> None:
        super().__init__()
        self.kernels = self._announced = 0
        self.on_first: Callable[[], object] = lambda: None

    def on_start(self, event: event.Event) -> None:
        """Count a kernel; announce the first, unless a line said already that none is kept."""
        if not (self.kernels or _warn_of_no_cache.cache_info().currsize):
            _LOG.warning("compiling kernels, once: later processes load them")
            self.on_first()
        self.kernels += 1
        super().on_start(event)

    def announce(self) -> None:
        """Log how many kernels were compiled and in what time, if there are new ones."""
        if self.done and self.kernels > self._announced:  # a thread may compile the first one
            self._announced = self.kernels
            _LOG.warning("compiled %d kernels in %.1f s", self.kernels, self.duration)


COMPILATION: Final = Compilation()
event.register("numba:compile", COMPILATION)


@functools.cache
def _warn_of_no_cache() -> None:
    _LOG.warning(
        "no folder for compiled kernels can be written to: this process compiles its own, in about "
        "25 s on an idle core; set NUMBA_CACHE_DIR to a folder that can"
    )


class _FingerprintCache(FunctionCache):
    """numba's disk cache of a function, its key extended by the function's fingerprint.

    A file that cannot be read or written, as on a full disk, is as good as none.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:  # noqa: ANN401 - of numba
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            return None

    def save_overload(self, sig: Any, data: Any) -> None:  # noqa: ANN401 - of numba
        try:
            super().save_overload(sig, data)
        except OSError:
            _warn_of_no_cache()

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:  # noqa: ANN401 - of numba
        return (*super()._index_key(sig, codegen), fingerprint(self._py_func))


def fingerprint(function: FunctionType) -> str:
    """Return a digest of all that the machine code of `function` depends on.

    That is its byte code, its constants and the globals that it reads, the kernels that it calls
    included with their own fingerprints.

    Raises:
        TypeError: a global is neither a module, a kernel, a function of a library, an enumeration,
            a named tuple, the type of a record, a number nor a tuple.
    """
    code = function.__code__
    parts = [code.co_code.hex(), repr(code.co_consts), repr(code.co_names)]
    for name in code.co_names:
        if name in function.__globals__:
            parts.append(f"{name} = {_described(name, function.__globals__[name])}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _described(name: str, value: object) -> str:
    match value:
        case Dispatcher():
            allowed = sorted(value.targetoptions.get("fastmath", ()))
            return f"{allowed} {fingerprint(value.py_func)}"
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
