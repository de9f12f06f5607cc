"""Decorator that compiles a kernel and keeps its machine code on disk."""

import atexit
import os
from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar

from numba.core import typed_passes, untyped_passes
from numba.core.compiler import CompilerBase, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import AnalysisPass, PassManager, register_pass
from numba.core.event import trigger_event
from numba.core.registry import CPUDispatcher
from numba.core.typing.templates import make_concrete_template

from .cache import KernelCache, fingerprint
from .mode import IS_PLAIN
from .parts import Part, PartLibrary, kept_machine_code, machine_code, restored_machine_code

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


@register_pass(mutates_CFG=False, analysis_only=True)
class _MakePart(AnalysisPass):
    """Give a kernel the library that `NativeLowering` fills; no machine code is made of it yet."""

    _name = "make_part"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> Any:  # noqa: ANN401 - of numba
        """Make the library; False says that the code has not changed.

        The kernel is named after what it does. numba counts functions instead: the code of two
        callers, linked from the disk, would then hold one callee under two names or two under one,
        and depend on what a process compiled before.
        """
        identity = state.func_id
        identity.unique_id = int(fingerprint(identity.func)[:15], 16)
        identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        state.flags.no_cpython_wrapper = True
        state.flags.no_cfunc_wrapper = True
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
    _MakePart,
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


_Dispatcher: Any = CPUDispatcher  # what it has is not typed


class Kernel(_Dispatcher):
    """A compiled function.

    For each signature there is a part, which calling kernels link, and machine code where Python
    calls it.
    """

    def __init__(
        self,
        py_func: Callable[..., object],
        locals: dict[str, Any] | None = None,
        targetoptions: dict[str, Any] | None = None,
        pipeline_class: type[CompilerBase] = _Compiler,
    ) -> None:
        super().__init__(py_func, locals or {}, targetoptions or {}, pipeline_class)
        self._parts: dict[tuple[Any, ...], tuple[Part, object]] = {}
        self._kept_parts = KernelCache(self, "part", Part.kept, Part.restored)
        self._kept_code = KernelCache(self, "code", kept_machine_code, restored_machine_code)
        self.loaded = 0  # signatures whose machine code was on disk

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:  # noqa: ANN401 - of numba
        """Return what Python calls for the types of these arguments."""
        types = tuple(sig)
        if types not in self.overloads:
            self.add_overload(self._machine_code(types))
        return self.overloads[types].entry_point

    def _machine_code(self, types: tuple[Any, ...]) -> CompileResult:
        found = self._kept_code.load(types)
        if found is not None:
            self.loaded += 1
            return found
        with trigger_event("numba:compile", data={"dispatcher": self, "args": types}):
            part, _ = self._part(types)
            release_gil = self.targetoptions.get("nogil", False)
            made = machine_code(part, self.targetctx, release_gil=release_gil)
        self._kept_code.save(types, made)
        return made

    def get_call_template(self, args: Any, kws: Any) -> Any:  # noqa: ANN401 - of numba
        """Return the type of a call by another kernel."""
        signature, types = self._compiler.fold_argument_types(args, kws)
        part, _ = self._part(tuple(types))
        name = self.py_func.__name__
        template = make_concrete_template(name, key=name, signatures=[part.signature])
        return template, signature, types, {}

    def get_overload(self, sig: Any) -> object:  # noqa: ANN401 - of numba
        """Return the key by which numba's context finds what a calling kernel links."""
        _, key = self._part(tuple(sig))
        return key

    def _part(self, types: tuple[Any, ...]) -> tuple[Part, object]:
        """Return the LLVM code for these types of arguments, and its key in numba's context."""
        if types not in self._parts:
            part = self._kept_parts.load(types) or self._compiled_part(types)
            key = object()
            self.targetctx.insert_user_function(key, part.description, [part.library])
            self._parts[types] = part, key
        return self._parts[types]

    def _compiled_part(self, types: tuple[Any, ...]) -> Part:
        with trigger_event("numba:compile", data={"dispatcher": self, "args": types}):
            made = self._compiler.compile(types, None)
            kept = Part(made.library, made.signature, made.fndesc, made.environment).kept()
            # Read back, as a later process does: LLVM optimises code that was written and read in
            # another order of its values.
            part = Part.restored(self.targetctx, *kept)
        self._kept_parts.save(types, part)
        return part


def cached_njit(
    **options: Any,  # noqa: ANN401 - of numba
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that compiles a function in nopython mode and keeps the result on disk.

    `options` are those of `numba.njit`. A kernel has nothing of what `_Compiler` leaves out:
    numba's error would not say so. With `NUMBA_DISABLE_JIT=1` the function stays as it is.
    """

    def compiled(function: Callable[P, R]) -> Callable[P, R]:
        if IS_PLAIN:
            return function
        kernel: Any = Kernel(function, targetoptions={"nopython": True, **options})
        return kernel

    return compiled
