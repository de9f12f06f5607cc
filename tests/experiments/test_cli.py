"""Command line in a process of its own, in an empty folder."""

import json
import subprocess
import sys

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.testbed.log.reader import read_log
from proving_ground.testbed.recording.channels import STATE

from proving_ground import load, simulate

SHORT = ("--set", "path={kind='straight', length_m=15}")


def ttempc(*arguments, cwd):
    return subprocess.run(
        [sys.executable, "-m", "proving_ground.experiments.commands.cli", *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A short run with its folder."""
    cwd = tmp_path_factory.mktemp("run")
    done = ttempc("run", "grass", "--seed", "3", "--out", "short", *SHORT, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done, cwd / "short"


def test_a_run_writes_its_files_and_prints_their_paths(finished):
    done, folder = finished
    names = {file.name for file in folder.iterdir()}
    assert {"log.mcap", "summary.json", "scenario.toml", "report.html"} <= names
    assert sum(name.endswith(".png") for name in names) >= 5
    for name in ("log.mcap", "summary.json", "report.html"):
        assert name in done.stdout
    assert "Tracking error" in done.stdout


def test_json_goes_to_stdout_alone_and_another_process_has_the_same_bits(finished, tmp_path):
    _, folder = finished
    done = ttempc("run", "--json", "--seed", "3", "--out", "again", *SHORT, cwd=tmp_path)
    assert done.returncode == 0
    printed = json.loads(done.stdout)
    written = json.loads((folder / "summary.json").read_text())
    for part in ("tracking", "estimation", "inputs", "slip", "run_id"):
        assert printed[part] == written[part], "same scenario and seed, another process"
    again = read_log(tmp_path / "again" / "log.mcap")[STATE].values
    assert np.array_equal(again, read_log(folder / "log.mcap")[STATE].values)


def test_another_seed_has_other_bits(finished):
    _, folder = finished
    _, record = simulate(*load("grass", [SHORT[1]]), seed=4)
    assert not np.array_equal(record[STATE].values, read_log(folder / "log.mcap")[STATE].values)


def test_help_loads_no_library_that_takes_time(tmp_path):
    """A process without other tests: only it shows what help loads."""
    for arguments in (["--help"], ["report", "--help"]):
        code = (
            "import contextlib, sys\n"
            "from proving_ground.experiments.commands.cli import main\n"
            f"with contextlib.suppress(SystemExit): main({arguments})\n"
            "print(sorted(SLOW & set(sys.modules)))\n"
        )
        slow = "SLOW = {'mujoco', 'numba', 'scipy', 'matplotlib', 'pydantic', 'dask'}\n"
        done = subprocess.run(
            [sys.executable, "-c", slow + code], capture_output=True, text=True, check=True
        )
        assert "usage: ttempc" in done.stdout
        assert done.stdout.splitlines()[-1] == "[]"


def test_a_run_reaches_its_first_physics_step_without_figures():
    code = (
        "import sys\n"
        "import proving_ground.experiments.commands.run\n"
        "import proving_ground.experiments.results.table\n"
        "from proving_ground import load\n"
        "from proving_ground.experiments.run import simulate\n"
        "simulate.assemble(load('grass', sys.argv[1:])[1], seed=1)\n"
        "print(sorted({'matplotlib', 'scipy.stats', 'casadi', 'dask'} & set(sys.modules)))\n"
    )
    command = [sys.executable, "-c", code, SHORT[1]]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_resolved_scenario_drives_the_same_run(finished, tmp_path):
    _, folder = finished
    done = ttempc(
        "run", str(folder / "scenario.toml"), "--seed", "3", "--out", "again", cwd=tmp_path
    )
    assert done.returncode == 0
    again = read_log(tmp_path / "again" / "log.mcap")[STATE].values
    assert np.array_equal(again, read_log(folder / "log.mcap")[STATE].values)


def test_an_existing_folder_is_refused_and_left_alone(finished):
    _, folder = finished
    before = {file: file.stat().st_mtime_ns for file in folder.rglob("*")}
    done = ttempc("run", "grass", "--out", str(folder), cwd=folder.parent)
    assert done.returncode == 2
    assert "exists already" in done.stderr
    assert before == {file: file.stat().st_mtime_ns for file in folder.rglob("*")}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gras",), "scenario 'gras': no such scenario; shipped are cultivate, farm, furrows"),
        (("nowhere.toml",), "no such file"),
        (("--seed", "-1"), "--seed: must be a whole number"),
        (("--seed", "x"), "--seed: must be a whole number"),
        (("--controller", "pidd"), "pidd"),
        (("--set", "soil.cone_index_kpa=-3"), "soil.cone_index_kpa"),
        (("--set", "soil.cone_index_kpa=nan"), "soil.cone_index_kpa"),
        (("--set", "soil.softnes=3"), "unknown key"),
        (("--set", "path.radius_m=2.0"), "path too tight at s ="),
        (("--set", "path.speed_mps=1.5"), "1.4 m/s"),
        (("--set", "terrain.size_x_m=40.0"), "must stay 4 m inside the field"),
        (("--set", "terrain.height_map='no.npy'"), "no.npy"),
        (("pavement", "--set", "soil.name='concrete'"), "must be one of hard, dry, moist, wet"),
        (("--set", "soil.map={file='no.npy', spacing_m=1.0}"), "soil map file"),
        (("--set", "soil.random={correlation_m=500.0}"), "correlation length 500.0 m"),
        (("--set", "soil.tramlines=[{kind='path', width_m=0.05}]"), "tramlines 0.05 m wide"),
        (
            ("--set", "terrain.features=[{kind='ditch', x_m=90, y_m=0, depth_m=0.1, width_m=1}]"),
            "must be on the field",
        ),
        (
            ("--set", "terrain.features=[{kind='step', x_m=0, y_m=0, height_m=0.1, ramp_m=0.1}]"),
            "step: rises over 0.1 m, must be 0.2 m or more",
        ),
        (("--set", "sensors.gnss_rate_hz=7"), "whole number of physics steps"),
        (("--set", "plant.timestep_s=0.003"), "whole number of physics steps"),
        (("--set", "plant.vehicle.drawbar_m=0.01"), "drawbar"),
        (("--colour", "red"), "unrecognized arguments"),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_2_and_writes_nothing(
    arguments, message, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    try:
        code = main(["run", *arguments, "--out", "new"])
    except SystemExit as stopped:  # argparse's way out
        code = stopped.code
    printed = capsys.readouterr()
    assert code == 2
    assert message in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not printed.out
    assert not any(tmp_path.iterdir())


def test_a_refusal_is_the_exit_code_of_the_process(tmp_path):
    done = ttempc("run", "gras", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("ttempc: error: scenario 'gras'")


def test_early_termination_is_exit_code_3_with_log_and_summary(tmp_path):
    done = ttempc(
        "run",
        "--controller",
        "paper-printed-sign",
        "--out",
        "ended",
        "--set",
        "path.laps=1",
        cwd=tmp_path,
    )
    assert done.returncode == 3, done.stdout
    summary = json.loads((tmp_path / "ended" / "summary.json").read_text())
    assert summary["status"] == "stopped"  # 2 m beside its reference
    assert summary["failure"]
    assert summary["failure"] in done.stdout
    *_, failure, end = read_log(tmp_path / "ended" / "log.mcap").events
    assert failure.text == summary["failure"]
    assert end.text.startswith("run ends: stopped after ")


def test_the_list_names_what_run_takes(tmp_path):
    done = ttempc("list", cwd=tmp_path)
    assert done.returncode == 0
    for name in ("grass", "wet-slope", "pavement", "paper-printed-sign", "feedforward"):
        assert name in done.stdout


def test_help_says_what_is_written_and_what_the_exit_codes_mean(tmp_path):
    done = ttempc("run", "--help", cwd=tmp_path)
    assert done.returncode == 0
    for word in ("summary.json", "log.mcap", "Exit code 0", "--set KEY=VALUE"):
        assert word in done.stdout


@pytest.mark.parametrize(
    "command",
    [
        "run",
        "view",
        "list",
        "sweep",
        "report",
        "envelope",
        "compare",
        "log",
        "video",
        "frame",
        "card",
        "fit-tube",
    ],
)
def test_every_command_is_listed_and_has_a_help_text(command, capsys):
    for arguments in (["--help"], [command, "--help"]):
        with pytest.raises(SystemExit) as stopped:
            main(arguments)
        assert stopped.value.code == 0
        lines = capsys.readouterr().out.splitlines()
        assert any(line.split()[:1] == [command] or f"ttempc {command}" in line for line in lines)
    assert len(lines) >= 7  # usage, description, options


def test_help_loads_no_slow_package(tmp_path):
    code = """if True:
        import sys
        from proving_ground.experiments.commands.cli import main
        try:
            main(sys.argv[1:])
        finally:
            slow = {"mujoco", "matplotlib", "distributed"} & set(sys.modules)
            print("loaded:", *sorted(slow))"""
    for arguments in (["--help"], ["run", "--help"], ["video", "--help"], ["sweep", "--help"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.splitlines()[-1] == "loaded:", done.stdout[-500:]
