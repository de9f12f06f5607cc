"""Decorator that compiles a kernel and keeps its machine code on disk."""

import atexit
import os
from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar

import numba
from llvmlite.binding import Linkage
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass

from .cache import KernelCache

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


class _KernelLibrary(JITCodeLibrary):
    """Machine code of a kernel whose calls go to the copies of its callees in the same code.

    numba lets the linker choose between this copy and the callee's own code, if the process has
    that. Both were optimised apart and can differ in the order of their sums (`FAST`): the last
    bits would depend on which kernels a process compiles and which it loads.
    """

    def _finalize_final_module(self) -> None:
        shared: Any = self._final_module
        own = shared.clone()
        for function in own.functions:
            if function.linkage is Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal
        self._final_module = own
        super()._finalize_final_module()
        self._final_module = shared  # callers of this kernel link its callees once


@register_pass(mutates_CFG=False, analysis_only=True)
class _MakeLibrary(AnalysisPass):
    """Give a kernel the library that `NativeLowering` fills."""

    _name = "make_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> Any:  # noqa: ANN401 - of numba
        """Make the library; False says that nothing else changes."""
        state.library = _KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


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
    _MakeLibrary,
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

    `options` are those of `numba.njit`. A kernel has nothing of what `_Compiler` leaves out:
    numba's error would not say so. With `NUMBA_DISABLE_JIT=1` the function stays as it is.
    """

    def compiled(function: Callable[P, R]) -> Callable[P, R]:
        every: Any = {"no_cfunc_wrapper": True, "pipeline_class": _Compiler} | options
        kernel: Any = numba.njit(**every)(function)
        if kernel is not function:
            kernel._cache = KernelCache(kernel)  # as numba's Dispatcher.enable_caching does
        return kernel

    return compiled
