"""Smoke tests: every benchmark runs its smallest job and prints its figures.

Limits on speed are not tested here: a loaded machine would fail them.
"""

import contextlib
import itertools
import math
import re

import numpy as np
import proving_ground.experiments.benchmarks.__main__ as bench
import proving_ground.experiments.benchmarks.figure as benchmark_figure
import pytest
from proving_ground.experiments.benchmarks import (
    closed_loop,
    control_step,
    intervals,
    latency,
    memory,
    nmpc,
    performance,
    physics_loop,
    qp_solvers,
    start_up,
    sweep,
    tube_step,
)
from proving_ground.experiments.benchmarks.figure import (
    BenchmarkFigure,
    Limit,
    markdown,
    released,
)
from proving_ground.experiments.errors import InvalidPage


@pytest.fixture
def few_ticks(monkeypatch):
    monkeypatch.setattr(control_step, "TICKS", 60)


def printed(capsys, main, *arguments):
    """Return the lines of a benchmark; exit code 1 says that a limit was exceeded."""
    with contextlib.suppress(SystemExit):
        main(*arguments)
    return capsys.readouterr().out.splitlines()


def values(figures):
    """Return the values of a benchmark by name; each is finite and above 0."""
    named = {figure.name: figure.value for figure in figures}
    assert len(named) == len(figures)
    assert all(math.isfinite(value) and value > 0.0 for value in named.values()), named
    return named


def test_parts_of_a_control_step_add_up_to_less_than_a_slow_step(few_ticks, monkeypatch):
    monkeypatch.setattr(control_step, "REPEATS", 2)
    named = values(control_step.figures())
    assert any(name.startswith("- ") for name in named)
    assert named["- QP, without active bounds"] < named["- QP, by PIQP"]
    assert named["- QP, by PIQP"] < named["`ttempc` step with PIQP"]


def test_the_time_of_a_part_leaves_out_the_parts_that_it_calls(monkeypatch):
    """On a clock that goes on by 1 s when it is read: two readings a call."""
    monkeypatch.setattr(control_step.time, "perf_counter", itertools.count().__next__)
    clock = control_step._PartClock()
    inner = clock._timed("inner", lambda: None)
    outer = clock._timed("outer", lambda: (inner(), inner()))
    outer()
    assert clock.spent == {"inner": 2.0, "outer": 3.0}


def test_latency(few_ticks, monkeypatch):
    monkeypatch.setattr(latency, "REPEATS", 1)
    monkeypatch.setattr(latency, "PAUSE_S", 0.001)
    times = latency.latencies()
    named = values(latency.figures(times))
    for kind in latency.KINDS:
        quantiles = [named[f"{kind}, {name}"] for name in ("median", "p99", "p99.9", "max")]
        assert quantiles == sorted(quantiles)
        assert quantiles[-1] == pytest.approx(times[kind][0].max())
    assert latency.histograms(times).startswith(b"\x89PNG")


def test_intervals(capsys):
    _, *lines = printed(capsys, intervals.main, "20")
    assert [line.split()[0] for line in lines] == ["3", "5", "8", "14", "30"]
    assert all(0.0 <= float(line.split()[1].rstrip("%")) <= 100.0 for line in lines)


def test_closed_loop(monkeypatch):
    monkeypatch.setattr(closed_loop, "OVERRIDES", ("path={kind='straight', length_m=3}",))
    monkeypatch.setattr(closed_loop, "REPEATS", 1)
    monkeypatch.setattr(physics_loop, "STEPS", 20)
    monkeypatch.setattr(physics_loop, "REPEATS", 2)
    named = values(closed_loop.figures())
    assert named["loop without log / bare step"] > 1.0
    assert named["- estimator, a tick"] < named["- physics, a tick"]


def test_nmpc(capsys, few_ticks, monkeypatch):
    for name, value in (("NAMES", (nmpc.LINEAR, "nmpc")), ("REPEATS", 1), ("WITHOUT_QP", ())):
        monkeypatch.setattr(nmpc, name, value)
    share, _, *lines = printed(capsys, nmpc.main)
    assert re.fullmatch(r"\d+ of 55 ticks active", share)  # 60 less those of the warm-up
    labels = [f"{name}, {solver}" for solver in ("piqp", "daqp") for name in (nmpc.LINEAR, "nmpc")]
    assert [line.split("  ")[0] for line in lines] == labels
    linear_piqp, piqp, linear_daqp, daqp = (line.split()[2:] for line in lines)
    assert float(linear_piqp[3]) == float(linear_daqp[3]) == 1.0
    assert float(daqp[-1]) == 0.0
    assert float(piqp[-1]) < 1e-6  # both solvers have the same minimiser


def test_physics_loop(capsys, monkeypatch):
    for name, value in (("STEPS", 20), ("REPEATS", 1), ("LARGEST_RATIO", 99.0)):
        monkeypatch.setattr(physics_loop, name, value)
    monkeypatch.setattr(physics_loop, "shipped_vehicles", lambda: ["kayacan2016"])
    vehicle, loop, bare, ratio = printed(capsys, physics_loop.main)
    assert vehicle == "kayacan2016"
    loop_us, bare_us = float(loop.split()[2]), float(bare.split()[2])
    assert float(ratio.split()[1]) == pytest.approx(loop_us / bare_us, abs=0.05)


def test_qp_solvers(capsys, monkeypatch):
    monkeypatch.setattr(qp_solvers, "FIELDS", ("furrows",))
    monkeypatch.setattr(qp_solvers, "LAP", "path={kind='straight', length_m=20}")
    _, _, *lines = printed(capsys, qp_solvers.main)
    assert [line[:14].strip() for line in lines] == ["piqp", "daqp", "daqp, held"]
    columns = np.array([line[14:].split() for line in lines], dtype=float)
    assert not columns[:, 2].any()  # each solves all
    assert columns[0, 4] < 1e-6
    assert not columns[1:, 4].any()  # holding the Hessian changes no bit


def test_sweep(monkeypatch, tmp_path):
    """In this process: what workers add, the tests of the engine cover."""
    monkeypatch.setattr(sweep, "PATH", {"kind": "straight", "length_m": 3.0})
    monkeypatch.setattr(sweep, "ROWS", 20)
    taken, driven, peak = sweep._sweep(sweep._plan(1), 0, tmp_path)
    assert sum(row["wall_s"] for row in driven) < taken
    assert {row["controller"] for row in driven} == {"ttempc-nominal", "paper"}
    assert peak == pytest.approx(memory.peak_mb(), rel=0.2)
    assert sum(figure.unit == "ms" for figure in sweep.row_figures(tmp_path)) == 1


def test_environment(monkeypatch):
    """A period of the plant is a part of one of the run, and that of a step."""
    pytest.importorskip("gymnasium")
    from proving_ground.experiments.benchmarks import environment

    for name, value in (("STEPS", 5), ("REPEATS", 2)):
        monkeypatch.setattr(environment, name, value)
    named = values(environment.figures())
    plant, run = named["the same period of the plant alone"], named["the same period of `simulate`"]
    assert plant < min(run, named["step"])
    assert named["rate beside `simulate`"] == pytest.approx(run / named["step"])


def test_tube_step(few_ticks, monkeypatch):
    monkeypatch.setattr(tube_step, "REPEATS", 1)
    named = values(tube_step.figures())
    assert sum(name.endswith("/ that") for name in named) == 3


def test_the_first_tick_of_a_run_ends_its_process(monkeypatch):
    """With more processor time than help takes."""
    monkeypatch.setattr(start_up, "REPEATS", 1)
    assert start_up._process(*start_up._COMMAND, "--help") < start_up._first_tick()


def test_memory_grows_with_the_laps_and_is_of_the_child_alone(monkeypatch):
    monkeypatch.setattr(memory, "_WITHOUT", "x = b'x' * {laps} * 2**20")
    monkeypatch.setattr(memory, "_WITH", "x = b'x' * {laps} * 2**21")
    few, without, _, with_log = (figure.value for figure in memory.figures())
    assert few < memory.peak_mb() - 50.0  # this process has loaded MuJoCo
    assert without - few == pytest.approx(38.0, abs=3.0)
    assert with_log - without == pytest.approx(40.0, abs=3.0)


def figure(value, *limit):
    return BenchmarkFigure("speed", value, "m/s", Limit(*limit) if limit else None)


@pytest.mark.parametrize(
    ("value", "limit", "cell"),
    [
        (1.0, (2.0,), "<= 2"),
        (3.0, (2.0,), "<= 2 **missed**"),
        (3.0, (2.0, True), ">= 2"),
        (1.0, (2.0, True), ">= 2 **missed**"),
        (math.nan, (2.0,), "<= 2 **missed**"),
        (1.0, (), ""),
    ],
)
def test_a_figure_stands_beside_its_limit_and_the_last_release(value, limit, cell):
    line = markdown({"a": [figure(value, *limit)]}, {("a", "speed"): 4.0}).splitlines()[-1]
    assert [part.strip() for part in line.split("|")][1:3] == ["a", "speed"]
    assert [part.strip() for part in line.split("|")][4:6] == [cell, "4"]


def test_the_record_of_a_release_is_what_was_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(performance, "PARTS", {"a": lambda: [figure(3.0, 2.0)]})
    monkeypatch.setattr(benchmark_figure, "RELEASED", tmp_path / "released.json")
    bench.main(["--out", str(tmp_path / "out" / "b.json"), "--record"])
    assert "**missed**" in capsys.readouterr().out
    values, commit = released(tmp_path / "released.json")
    assert values == {("a", "speed"): 3.0}
    assert commit
    assert (tmp_path / "out" / "b.json").read_text() == (tmp_path / "released.json").read_text()


@pytest.mark.parametrize("text", ["", "[]", '{"parts": {"a": [{}]}}'])
def test_a_record_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "released.json").write_text(text)
    with pytest.raises(InvalidPage, match=r"released\.json: is no record"):
        released(tmp_path / "released.json")


@pytest.mark.parametrize("arguments", [["speed"], ["latency", "--record"]])
def test_unknown_parts_and_partial_releases_are_refused(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        bench.main(arguments)
    assert stop.value.code == 2
    assert arguments[0] in capsys.readouterr().err or "--record" in arguments
