"""Machine code of a kernel: which code its calls reach."""

import platform
import struct
import subprocess
import sys

import numpy as np
import pytest

from ttempc.jit import FAST, cached_njit

_SYMBOLS, _FUNCTION, _WEAK = 2, 2, 2  # of the format ELF: section, kind and binding of symbols
_HEADER = struct.Struct("<IIQQQQIIQQ")  # of a section
_SYMBOL = struct.Struct("<IBBHQQ")


@cached_njit(error_model="numpy", fastmath=FAST)
def callee(x):
    """Too long to be inlined in both of its calls."""
    total = 0.0
    for power in range(1, 4):
        for i in range(x.size):
            total += np.exp(-x[i] * power) * np.sin(x[i]) / (1.0 + x[i] ** power)
        for i in range(x.size - 1):
            total -= np.cos(x[i] - x[i + 1]) * np.sqrt(np.abs(x[i] * power))
    return total


@cached_njit(error_model="numpy", fastmath=FAST)
def caller(x, y):
    return callee(x) - 2.0 * callee(y)


def functions(code):
    """Return the bindings of the functions that an object file in ELF defines, by their names."""
    assert code[:4] == b"\x7fELF"
    (start,) = struct.unpack_from("<Q", code, 40)
    size, count = struct.unpack_from("<HH", code, 58)
    sections = [_HEADER.unpack_from(code, start + k * size) for k in range(count)]
    found = {}
    for _, kind, _, _, offset, length, link, _, _, entry in sections:
        if kind != _SYMBOLS:
            continue
        names = sections[link][4]
        for place in range(offset, offset + length, entry):
            name, info, _, section, _, _ = _SYMBOL.unpack_from(code, place)
            if info % 16 == _FUNCTION and section:
                end = code.index(b"\0", names + name)
                found[code[names + name : end].decode()] = info // 16
    return found


_WORDS = """
import sys
import numpy as np
from numba import from_dtype
import ttempc.jit
for name in sys.argv[1]:
    words = from_dtype(np.dtype([(name, "f8")])).mangling_args
print(words)
"""


def test_names_of_functions_tell_records_apart_whatever_a_process_has_met():
    """numba's own names have the place of a record among the types that the process has met."""

    def words(names):
        command = [sys.executable, "-c", _WORDS, names]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    assert words("x") == words("yx")
    assert words("x") != words("y")


@pytest.mark.skipif(platform.system() != "Linux", reason="object files have another format")
def test_a_call_reaches_the_copy_that_was_compiled_with_its_kernel(monkeypatch):
    """The linker may replace a weak copy by code that was optimised apart, with other last bits."""
    for kernel in (callee, caller):
        for kept in (kernel._kept_parts, kernel._kept_code):
            monkeypatch.setattr(kept, "is_used", False)
    assert np.isfinite(caller(np.ones(4), np.zeros(4)))
    (compiled,) = caller.overloads.values()
    found = functions(compiled.library._get_compiled_object())
    assert any("callee" in name for name in found)
    assert [name for name, binding in found.items() if "callee" in name and binding == _WEAK] == []
