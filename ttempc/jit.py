"""Compilation by numba, with a disk cache that notices every change of the code."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from enum import EnumType
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

P = ParamSpec("P")
R = TypeVar("R")


def cached_njit(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` in nopython mode and keep the result on disk.

    The cache of `numba.njit(cache=True)` looks at the file and the byte code of the function alone:
    it still loads the old machine code when a kernel or a constant that the function imports from
    another module has changed. The key of this cache includes the `fingerprint` of the function.
    """
    compiled: Any = numba.njit(function)
    if compiled is not function:  # it is under NUMBA_DISABLE_JIT
        compiled._cache = _FingerprintCache(function)  # as numba's Dispatcher.enable_caching
    return compiled


class _FingerprintCache(FunctionCache):
    """numba's disk cache of a function, its key extended by the function's fingerprint."""

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:  # noqa: ANN401 - of numba
        return (*super()._index_key(sig, codegen), fingerprint(self._py_func))


def fingerprint(function: FunctionType) -> str:
    """Return a digest of all that the machine code of `function` depends on.

    That is its byte code, its constants and the globals that it reads, the kernels that it calls
    included with their own fingerprints.

    Raises:
        TypeError: a global is neither a module, a kernel, an enumeration, a number nor a tuple.
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
            return fingerprint(value.py_func)
        case EnumType():
            return repr(list(value))
        case ModuleType():
            return value.__name__
        case bool() | int() | float() | tuple():
            return repr(value)
        case _:
            raise TypeError(f"{name}: a kernel cannot depend on a global {type(value).__name__}")
