"""A test that hangs ends, also in compiled code that holds the interpreter's lock."""

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
HANGS = """
import ctypes

def test_hangs():
    ctypes.PyDLL(None).sleep(120)  # as a compiled loop without end: no thread of Python runs

def test_comes_after():
    pass
"""


def test_a_hung_test_ends_with_its_traceback(tmp_path):
    (tmp_path / "test_hung.py").write_text(HANGS)
    settings = [
        "-c",
        str(ROOT / "pyproject.toml"),
        "-o",
        "faulthandler_timeout=1",
        "-p",
        "no:cacheprovider",
    ]
    command = [sys.executable, "-m", "pytest", *settings, f"--rootdir={tmp_path}", str(tmp_path)]
    begun = time.monotonic()
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert time.monotonic() - begun < 60.0
    assert ended.returncode != 0
    assert "in test_hangs" in ended.stderr
    assert "passed" not in ended.stdout
