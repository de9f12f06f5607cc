"""Compiled kernels: everything of the project that depends on the inside of numba.

With `NUMBA_DISABLE_JIT=1` every kernel is the Python function that one reads: a debugger stops in
it, coverage and profilers count its lines. That is the plain mode.

What a release of numba may break, how one sees it, and how to switch it off:

- `compiler`, `parts`: numba's list of passes, how Python or a kernel asks for a compiled function,
  how code is linked and finished. The first kernel raises, or
  `tests/ttempc/jit/test_compiler.py` fails. Let `cached_njit` return `numba.njit(**options)`:
  every process then compiles its own kernels, for minutes.
- `cache`: what can be pickled of a compiled function. A line of the logger `ttempc` in every
  process says that kernels are compiled. Set `is_used = False`.
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
