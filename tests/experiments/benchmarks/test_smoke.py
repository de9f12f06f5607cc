"""Smoke tests: every benchmark runs its smallest job and prints its figures.

Limits on speed are not tested here: a loaded machine would fail them.
"""

import contextlib

import pytest

from proving_ground.experiments.benchmarks import (
    control_step,
    intervals,
    logging,
    nmpc,
    physics_loop,
    sweep,
    tube_step,
)


@pytest.fixture
def few_ticks(monkeypatch):
    monkeypatch.setattr(control_step, "TICKS", 12)


def printed(capsys, main, *arguments):
    """Return the lines of a benchmark; exit code 1 says that a limit was exceeded."""
    with contextlib.suppress(SystemExit):
        main(*arguments)
    return capsys.readouterr().out.splitlines()


def test_control_step(capsys, few_ticks, monkeypatch):
    for name, value in (("REPEATS", 1), ("COLD_TICKS", 12), ("PAUSE_S", 0.001)):
        monkeypatch.setattr(control_step, name, value)
    _, *lines = printed(capsys, control_step.main, ["ttempc-nominal"])
    assert [line.split(",")[1].split()[0] for line in lines] == ["warm", "cold", "prepared"]
    assert all(float(line.split()[-1]) > 1.0 for line in lines)  # a step contains its solve


def test_intervals(capsys):
    _, *lines = printed(capsys, intervals.main, "20")
    assert [line.split()[0] for line in lines] == ["3", "5", "8", "14", "30"]
    assert all(0.0 <= float(line.split()[1].rstrip("%")) <= 100.0 for line in lines)


def test_logging(capsys):
    short = ["path={kind='straight', length_m=2}"]
    _, *lines = printed(capsys, logging.main, 50.0, short)
    run, log, share, size = (float(line.split()[1]) for line in lines)
    assert 0.0 < log < run
    assert share == pytest.approx(100.0 * log / run, abs=15.0)  # both are rounded to 10 ms
    assert size > 0.0


def test_nmpc(capsys, few_ticks, monkeypatch):
    pytest.importorskip("casadi")
    monkeypatch.setattr(nmpc, "NAMES", (nmpc.LINEAR, "nmpc"))
    monkeypatch.setattr(nmpc, "SOLVERS", {"sqpmethod": nmpc.SOLVERS["sqpmethod"]})
    bare, _, *lines = printed(capsys, nmpc.main)
    assert bare.startswith("bare QP of ttempc-nominal")
    assert [line.split()[0] for line in lines] == [nmpc.LINEAR, "nmpc", "sqpmethod"]
    differences = [float(line.split()[6]) for line in lines]
    assert differences[1] == 0.0
    assert differences[2] < 0.01  # the solvers agree on the first move


def test_physics_loop(capsys, monkeypatch):
    for name, value in (("STEPS", 20), ("REPEATS", 1), ("LARGEST_RATIO", 99.0)):
        monkeypatch.setattr(physics_loop, name, value)
    monkeypatch.setattr(physics_loop, "shipped_vehicles", lambda: ["kayacan2016"])
    vehicle, loop, bare, ratio = printed(capsys, physics_loop.main)
    assert vehicle == "kayacan2016"
    loop_us, bare_us = float(loop.split()[2]), float(bare.split()[2])
    assert float(ratio.split()[1]) == pytest.approx(loop_us / bare_us, abs=0.05)


def test_sweep_rows(capsys, monkeypatch):
    monkeypatch.setattr(sweep, "FEW_ROWS", 10)
    lines = printed(capsys, sweep.main, "rows", "20")
    assert [line.split(" rows")[0] for line in lines] == ["10", "20"]


def test_tube_step(capsys, few_ticks, monkeypatch):
    monkeypatch.setattr(tube_step, "REPEATS", 1)
    lines = printed(capsys, tube_step.main)
    assert [line.split()[0] for line in lines] == [
        "ttempc-nominal",
        "ttempc",
        "ttempc,",
        "ttempc-tube",
        "tube",
    ]
