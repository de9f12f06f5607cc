"""Disk cache of compiled kernels: valid for exactly the code that they depend on."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from enum import IntEnum

import pytest

from ttempc.jit import fingerprint

CONSTANTS = """
from enum import IntEnum
class Entry(IntEnum):
    FIRST = 0
    SECOND = 1
SCALE = 1.0
"""
CALLEE = """
from constants import SCALE, Entry
from ttempc.jit import cached_njit
@cached_njit
def callee(x):
    return SCALE * x[Entry.FIRST]
"""
CALLER = """
import numpy as np
from callee import callee
from ttempc.jit import cached_njit
@cached_njit
def caller(x):
    return callee(x) + 100.0
if __name__ == "__main__":
    print(caller(np.array([1.0, 2.0])), sum(caller.stats.cache_hits.values()))
"""


def test_a_change_in_another_module_reaches_compiled_code(tmp_path):
    """Result and cache hits of a kernel whose callee, constant or enumeration changes."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))

    def run():
        command = [sys.executable, str(tmp_path / "caller.py")]
        output = subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True
        ).stdout
        result, hits = output.split()
        return float(result), int(hits)

    sources = {"constants": CONSTANTS, "callee": CALLEE, "caller": CALLER}
    for name, source in sources.items():
        (tmp_path / f"{name}.py").write_text(source)
    assert run() == (101.0, 0)
    assert run() == (101.0, 1)
    (tmp_path / "callee.py").write_text(CALLEE.replace("return SCALE", "return 2.0 * SCALE"))
    assert run() == (102.0, 0)
    (tmp_path / "constants.py").write_text(CONSTANTS.replace("SCALE = 1.0", "SCALE = 4.0"))
    assert run() == (108.0, 0)
    swapped = CONSTANTS.replace("SCALE = 1.0", "SCALE = 4.0")
    swapped = swapped.replace("FIRST = 0", "FIRST = 1").replace("SECOND = 1", "SECOND = 0")
    (tmp_path / "constants.py").write_text(swapped)
    assert run() == (116.0, 0)


class Entry(IntEnum):
    FIRST = 0


LIMIT = 3.0
TABLE = [1.0]


def limited(x):
    return min(x, LIMIT) + math.sin(Entry.FIRST)


def test_fingerprint_depends_on_constants_and_enumerations(monkeypatch):
    first = fingerprint(limited)
    monkeypatch.setattr(sys.modules[__name__], "LIMIT", 4.0)
    second = fingerprint(limited)
    monkeypatch.setattr(sys.modules[__name__], "Entry", IntEnum("Entry", {"FIRST": 1}))
    third = fingerprint(limited)
    assert len({first, second, third}) == 3
    monkeypatch.undo()
    assert fingerprint(limited) == first


def test_a_global_that_cannot_be_described_is_refused():
    with pytest.raises(TypeError, match=r"TABLE: .* list"):
        fingerprint(lambda: TABLE[0])
