"""Code of a compiled kernel: LLVM code for its callers, machine code for Python.

Most kernels are called by other kernels alone. Those get no machine code of their own, which nobody
would run: of 309 kernels of a default run Python calls 19.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from llvmlite.binding import Linkage, ModuleRef, parse_bitcode
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult, compile_result
from numba.core.runtime.nrt import rtsys
from numba.core.types import Record


def _words_of_record(kind: Any) -> tuple[str, tuple[int]]:  # noqa: ANN401 - of numba
    """Return what stands for a record in the name of a function that takes one.

    numba numbers types as they come: two processes could give one name to functions of different
    records, and a caller would link the wrong one.
    """
    return "Record", (int(hashlib.sha256(kind.name.encode()).hexdigest()[:15], 16),)


_record: Any = Record
_record.mangling_args = property(_words_of_record)


class PartLibrary(JITCodeLibrary):
    """LLVM code of a kernel and of all that it calls; callers link it into theirs.

    Each function is optimised by itself; all of them together are where machine code is made.
    """

    def _optimize_final_module(self) -> None:
        """Leave that to the machine code."""

    def _finalize_final_module(self) -> None:
        """Finish without machine code, which numba would make here."""
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def code(self) -> ModuleRef:
        """The LLVM code."""
        self._ensure_finalized()
        return self._final_module

    @classmethod
    def of(cls, codegen: Any, name: str, bitcode: bytes) -> PartLibrary:  # noqa: ANN401 - of numba
        """Return the library that has this LLVM code."""
        library = cls(codegen, name)
        library._final_module = parse_bitcode(bitcode)
        library._finalize_final_module()
        return library


class _MachineLibrary(JITCodeLibrary):
    """Machine code of a kernel that Python calls: of its part, and of the wrapper of the call.

    Every function in it is bound to its own copy. numba lets the linker choose between this copy
    and another one that the process has. Both were optimised apart and can differ in the order of
    their sums (`FAST`): the last bits would depend on which kernels a process compiles and which
    it loads.
    """

    def _finalize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage is Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal
        super()._finalize_final_module()

    def get_pointer_to_function(self, name: str) -> int:
        """Return the address of a function of this code, 0 if it has none of that name."""
        self._ensure_finalized()
        return self._codegen._engine.get_function_address(name)


@dataclass(frozen=True, slots=True)
class Part:
    """A kernel compiled for one signature, as its callers see it."""

    library: PartLibrary
    signature: Any
    description: Any
    """numba's description of the compiled function: its names, types of arguments and result."""
    environment: Any
    """numba's constants of the function, which are Python objects."""

    def kept(self) -> tuple[Any, ...]:
        """Return what a file keeps."""
        self.description.typemap = self.description.calltypes = None  # some cannot be pickled
        library = self.library
        return (
            library.name,
            library.code.as_bitcode(),
            self.signature,
            self.description,
            self.environment,
        )

    @classmethod
    def restored(
        cls,
        target_context: Any,  # noqa: ANN401 - of numba
        name: str,
        bitcode: bytes,
        *rest: Any,  # noqa: ANN401 - of numba
    ) -> Part:
        """Return the part that a file kept."""
        target_context.refresh()  # with what numba knows of types, which a caller asks for
        return cls(PartLibrary.of(target_context.codegen(), name, bitcode), *rest)


def machine_code(
    part: Part,
    target_context: Any,  # noqa: ANN401 - of numba
    *,
    release_gil: bool,
) -> CompileResult:
    """Make the machine code of a part and of the wrapper that Python calls."""
    library = _MachineLibrary(target_context.codegen(), part.library.name)
    library.enable_object_caching()
    library.add_linking_library(part.library)
    target_context.create_cpython_wrapper(
        library, part.description, part.environment, None, release_gil=release_gil
    )
    library.finalize()
    return _callable(target_context, library, part.signature, part.description, part.environment)


def kept_machine_code(compiled: CompileResult) -> tuple[Any, ...]:
    """Return what a file keeps of machine code."""
    library = compiled.library
    return (
        library.name,
        library._get_compiled_object(),
        compiled.signature,
        compiled.fndesc,
        compiled.environment,
    )


def restored_machine_code(
    target_context: Any,  # noqa: ANN401 - of numba
    name: str,
    code: bytes,
    *rest: Any,  # noqa: ANN401 - of numba
) -> CompileResult:
    """Return the machine code that a file kept.

    Of numba it needs the runtime, which keeps arrays. What numba knows of types is loaded where
    something is compiled: it takes 0.15 s and 10 MB.
    """
    rtsys.initialize(target_context)
    library = _MachineLibrary(target_context.codegen(), name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    return _callable(target_context, library, *rest)


def _callable(
    target_context: Any,  # noqa: ANN401 - of numba
    library: _MachineLibrary,
    signature: Any,  # noqa: ANN401 - of numba
    description: Any,  # noqa: ANN401 - of numba
    environment: Any,  # noqa: ANN401 - of numba
) -> CompileResult:
    """Return machine code as what numba's dispatcher calls."""
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        entry_point=target_context.get_executable(library, description, environment),
        library=library,
        signature=signature,
        fndesc=description,
        environment=environment,
        objectmode=False,
    )
