"""Examples of docs/examples, run as they stand there, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
COVERED_ELSEWHERE = {"read_a_log.py"}  # needs a log: tests/experiments/commands


def run(example, folder, *arguments):
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / example), *arguments],
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_library_alone_drives_a_lap_within_centimetres(tmp_path):
    output = run("guidance_loop.py", tmp_path)
    ticks, tractor, trailer = map(float, re.findall(r"\d+(?:\.\d+)?", output))
    assert ticks == 684  # 136.7 m at 1 m/s, 0.2 s each
    assert max(tractor, trailer) < 3.0
    assert not any(tmp_path.iterdir())


def test_a_controller_from_scratch_stays_on_its_path(tmp_path):
    lines = run("own_controller.py", tmp_path).splitlines()
    assert [line.partition(",")[0] for line in lines] == [
        "ttempc: completed",
        "__main__:Stanley: completed",
    ]
    for line in lines:
        assert max(map(float, re.findall(r"([\d.]+) cm", line))) < 10.0


def test_run_and_plot_writes_its_figure(tmp_path):
    assert "completed" in run("run_and_plot.py", tmp_path, "figure.png")
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("example", sorted(path.name for path in EXAMPLES.glob("*.py")))
def test_every_example_is_run_by_a_test(example):
    tested = (EXAMPLES.parents[1] / "tests" / "test_examples.py").read_text()
    assert example in COVERED_ELSEWHERE or f'"{example}"' in tested
