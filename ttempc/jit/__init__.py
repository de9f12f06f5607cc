"""Compiled kernels: everything of the project that depends on the inside of numba.

With `NUMBA_DISABLE_JIT=1` every kernel is the Python function that one reads: a debugger stops in
it, coverage and profilers count its lines. That is the plain mode.

What a release of numba may break, how one sees it, and how to switch it off:

- `compiler`: numba's list of passes, how it links and finishes machine code. The first kernel
  raises, or `tests/ttempc/jit/test_compiler.py` fails. Delete `pipeline_class`: numba then uses
  its own passes and libraries.
- `cache`: the interface of numba's cache and the content of a compile result. A line of the logger
  `ttempc` in every process says that kernels are compiled. Delete `kernel._cache = ...`.
- `records`, `rows`: the memory layout of arrays, LLVM's vector instructions. The tests in
  `tests/ttempc/jit` fail. Set `NUMBA_DISABLE_JIT=1`.
"""

from . import target
from .cache import COMPILATION, Compilation, fingerprint
from .compiler import FAST, cached_njit
from .mode import IS_PLAIN
from .records import local, record

target.choose()

__all__ = [
    "COMPILATION",
    "FAST",
    "IS_PLAIN",
    "Compilation",
    "cached_njit",
    "fingerprint",
    "local",
    "record",
]
