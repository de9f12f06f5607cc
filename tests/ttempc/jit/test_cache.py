"""Disk cache of compiled kernels: valid for exactly the code that they depend on."""

from __future__ import annotations

import gc
import os
import pickle
import platform
import resource
import subprocess
import sys

import pytest

from ttempc.jit import Compilation

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
@cached_njit()
def callee(x):
    return SCALE * x[Entry.FIRST]
"""
CALLER = """
import numpy as np
from callee import callee
from ttempc.jit import cached_njit
@cached_njit()
def caller(x):
    return callee(x) + 100.0
if __name__ == "__main__":
    print(caller(np.array([1.0, 2.0])), caller.loaded)
"""

CALLER_OF_PACKAGE = """
import numpy as np
from field.callee import callee
if __name__ == "__main__":
    print(callee(np.array([1.0, 2.0])), callee.loaded)
"""


def run_caller(folder, *, full=False, **variables):
    """Return result, number of loaded kernels and lines on stderr of a process that calls one."""

    def fill_disk():
        if full:
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))

    environment = {**os.environ, **{name: str(value) for name, value in variables.items()}}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, "-B", str(folder / "caller.py")]
    process = subprocess.run(
        command, env=environment, check=True, capture_output=True, text=True, preexec_fn=fill_disk
    )
    result, hits = process.stdout.split()
    return float(result), int(hits), process.stderr.splitlines()


@pytest.fixture
def sources(tmp_path):
    for name, source in {"constants": CONSTANTS, "callee": CALLEE, "caller": CALLER}.items():
        (tmp_path / f"{name}.py").write_text(source)
    return tmp_path


def test_a_change_in_another_module_reaches_compiled_code(sources):
    """Result and cache hits of a kernel whose callee, constant or enumeration changes."""

    def run():
        return run_caller(sources, NUMBA_CACHE_DIR=sources / "cache")[:2]

    assert run() == (101.0, 0)
    assert run() == (101.0, 1)
    (sources / "callee.py").write_text(CALLEE.replace("return SCALE", "return 2.0 * SCALE"))
    assert run() == (102.0, 0)
    (sources / "constants.py").write_text(CONSTANTS.replace("SCALE = 1.0", "SCALE = 4.0"))
    assert run() == (108.0, 0)
    swapped = CONSTANTS.replace("SCALE = 1.0", "SCALE = 4.0")
    swapped = swapped.replace("FIRST = 0", "FIRST = 1").replace("SECOND = 1", "SECOND = 0")
    (sources / "constants.py").write_text(swapped)
    assert run() == (116.0, 0)


def test_touched_sources_and_a_new_docstring_compile_nothing(sources):
    cache = sources / "cache"
    run_caller(sources, NUMBA_CACHE_DIR=cache)
    os.utime(sources / "callee.py", (1.0, 1.0))
    documented = CALLEE.replace("(x):", '(x):\n    """Scale the first entry."""')
    (sources / "callee.py").write_text(documented)

    assert run_caller(sources, NUMBA_CACHE_DIR=cache) == (101.0, 1, [])


def test_machine_code_is_made_only_of_what_python_calls(sources):
    """Its callee is kept as code that other kernels link, and not compiled again for them."""
    cache = sources / "cache"
    run_caller(sources, NUMBA_CACHE_DIR=cache)
    assert [file.name.partition("-")[0] for file in cache.glob("*.code")] == ["__main__.caller"]

    (sources / "caller.py").write_text(CALLER.replace("100.0", "200.0"))
    before = {file.name for file in cache.iterdir()}
    assert run_caller(sources, NUMBA_CACHE_DIR=cache)[:2] == (201.0, 0)
    new = {file.name for file in cache.iterdir()} - before
    assert sorted(name.partition("-")[0] for name in new) == ["__main__.caller"] * 2


def test_code_does_not_depend_on_what_was_compiled_before(sources):
    """A caller that links a callee from the disk gets the code of one that compiles both."""
    cache = sources / "cache"

    def code_of_caller():
        run_caller(sources, NUMBA_CACHE_DIR=cache)
        (file,) = cache.glob("__main__.caller-*.code")
        _, code, *_ = pickle.loads(file.read_bytes())
        return code

    both = code_of_caller()
    for file in cache.glob("__main__.caller-*"):
        file.unlink()
    assert [file.suffix for file in cache.iterdir()] == [".part"]
    assert code_of_caller() == both


def test_a_broken_file_is_compiled_anew(sources):
    """A file can be empty, hold another pickle than a kernel, or be torn."""
    cache = sources / "cache"
    run_caller(sources, NUMBA_CACHE_DIR=cache)
    for content in (b"", b"\x80\x05K\x01.", b"torn"):
        for file in cache.iterdir():
            file.write_bytes(content)
        assert run_caller(sources, NUMBA_CACHE_DIR=cache)[:2] == (101.0, 0)
    assert run_caller(sources, NUMBA_CACHE_DIR=cache)[:2] == (101.0, 1)


@pytest.fixture
def package(sources):
    """A package whose kernel a script calls; its machine code lies in the user's folder."""
    package = sources / "field"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "constants.py").write_text(CONSTANTS)
    (package / "callee.py").write_text(CALLEE.replace("from constants", "from .constants"))
    (sources / "caller.py").write_text(CALLER_OF_PACKAGE)
    run_caller(sources, NUMBA_CACHE_DIR=sources / "cache")
    return package


def test_a_package_carries_its_kernels(sources, package):
    """Nothing is compiled or written where the package has the machine code."""
    (sources / "cache").rename(package / "kernels")
    assert run_caller(sources, NUMBA_CACHE_DIR=sources / "cache") == (1.0, 1, [])
    assert not (sources / "cache").exists()


def test_a_broken_kernel_of_a_package_is_compiled_and_left_alone(sources, package):
    (sources / "cache").rename(package / "kernels")
    (carried,) = (package / "kernels").glob("*.code")
    carried.write_bytes(b"torn")
    assert run_caller(sources, NUMBA_CACHE_DIR=sources / "cache")[:2] == (1.0, 0)
    assert carried.read_bytes() == b"torn"
    assert [file.name for file in (sources / "cache").glob("*.code")] == [carried.name]


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the common level is one of x86-64")
def test_kernels_are_compiled_for_the_common_level(sources, package):
    """Another processor's machine code has another name."""
    common = run_caller(sources, NUMBA_CACHE_DIR=sources / "cache")[1]
    own = run_caller(sources, NUMBA_CACHE_DIR=sources / "cache", NUMBA_CPU_NAME="x86-64")[1]
    assert (common, own) == (1, 0)


@pytest.mark.parametrize("given", ["/dev/null/x", ""], ids=["NUMBA_CACHE_DIR", "user's folder"])
def test_without_a_writable_folder_kernels_run_uncached(sources, given):
    """A path below a file can be made by no user, root included."""
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), "/dev/null/x")
    result, hits, (line,) = run_caller(sources, NUMBA_CACHE_DIR=given, **homes)
    assert (result, hits) == (101.0, 0)
    assert "NUMBA_CACHE_DIR" in line


def test_a_folder_that_others_may_write_is_not_used(sources):
    """A kernel is code: what another user can write is never loaded."""
    cache = sources / "cache"
    cache.mkdir()
    cache.chmod(0o777)
    result, hits, (line,) = run_caller(sources, NUMBA_CACHE_DIR=cache)

    assert (result, hits) == (101.0, 0)
    assert "written by other users" in line
    assert list(cache.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_not_used(sources):
    cache = sources / "cache"
    cache.mkdir()
    os.chown(cache, 12345, -1)
    result, hits, (line,) = run_caller(sources, NUMBA_CACHE_DIR=cache)

    assert (result, hits) == (101.0, 0)
    assert "another user" in line


def test_without_a_writable_folder_nothing_is_said_where_nothing_compiles(sources):
    """The process imports the kernel and calls none."""
    (sources / "caller.py").write_text(CALLER.split("if __name__")[0] + "print(101.0, 0)\n")
    homes = dict.fromkeys(("HOME", "XDG_CACHE_HOME"), "/dev/null/x")
    assert run_caller(sources, NUMBA_CACHE_DIR="", **homes) == (101.0, 0, [])


def test_kernels_are_announced_while_a_thread_compiles_the_first_one(caplog):
    compilation = Compilation()
    compilation.on_start(None)
    compilation.announce()
    compilation.on_end(None)
    compilation.announce()
    assert [line.message[:18] for line in caplog.records if line.args] == ["compiled kernels i"]


@pytest.mark.parametrize("enabled", [True, False])
def test_garbage_is_collected_after_the_outermost_kernel_as_before_it(enabled):
    """A kernel that is compiled within another one does not end the pause."""
    compilation = Compilation()
    before = gc.isenabled()
    try:
        (gc.enable if enabled else gc.disable)()
        compilation.on_start(None)
        compilation.on_start(None)
        compilation.on_end(None)
        assert not gc.isenabled()
        compilation.on_end(None)
        assert gc.isenabled() is enabled
    finally:
        (gc.enable if before else gc.disable)()
