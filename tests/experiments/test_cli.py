"""Command line: files of a run, exit codes, refusals in one line, what a process loads."""

import json
import os
import platform
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from proving_ground.experiments.commands import drive
from proving_ground.experiments.commands.cli import _COMMANDS, main
from proving_ground.experiments.numerics import COMMON_CODE, ONE_THREAD
from proving_ground.experiments.scenario.scenario import shipped
from proving_ground.testbed.log.reader import read_log
from proving_ground.testbed.recording.channels import STATE

from ttempc.guidance.controllers import CONTROLLERS

SHORT = ("--set", "path={kind='straight', length_m=12}")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return tmp_path


def refusal(capsys, *arguments):
    """Return the one line with which a command is refused."""
    try:
        code = main(list(map(str, arguments)))
    except SystemExit as stopped:  # argparse's way out
        code = stopped.code
    printed = capsys.readouterr()
    assert code == 2
    assert printed.err.count("\n") == 1, printed.err
    assert not printed.out
    return printed.err


def states(folder):
    return read_log(folder / "log.mcap")[STATE].values


COMMAND = (sys.executable, "-m", "proving_ground.experiments.commands.cli", "run", "grass")


def unsettled(**variables):
    """Return the environment of a user, who has settled nothing but these variables."""
    settled = {**ONE_THREAD, **COMMON_CODE}
    own = {name: value for name, value in os.environ.items() if name not in settled}
    return own | variables


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder of a short run, driven by a process of its own, with what it printed."""
    folder = tmp_path_factory.mktemp("run") / "short"
    done = subprocess.run(
        [*COMMAND, *SHORT, "--seed", "3", "-o", str(folder)],
        env=unsettled(),
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return folder, done.stdout


def test_a_run_writes_its_files_and_its_last_line_says_what_to_open(finished):
    folder, printed = finished
    names = {file.name for file in folder.iterdir()}
    assert {"log.mcap", "summary.json", "scenario.toml", "report.html", "path.png"} <= names
    assert all(name in printed for name in names)
    assert printed.splitlines()[-1] == f"open {folder / 'report.html'}"


def test_the_same_seed_has_the_same_bits_in_another_process_and_from_the_resolved_scenario(
    finished, here, capsys
):
    folder, _ = finished
    resolved = str(folder / "scenario.toml")
    assert main(["run", resolved, "--seed", "3", "--json", "-o", "again"]) == 0
    printed, written = capsys.readouterr().out, json.loads((folder / "summary.json").read_text())
    assert json.loads(printed)["tracking"] == written["tracking"]
    assert np.array_equal(states(here / "again"), states(folder))
    assert main(["run", *SHORT, "--seed", "4", "-o", "other", "-q"]) == 0
    assert capsys.readouterr().out == ""
    assert not np.array_equal(states(here / "other"), states(folder))


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the common level is one of x86-64")
def test_a_run_has_the_same_bits_with_another_processors_blas_kernels(finished, tmp_path):
    """OpenBLAS has kernels for each make; a user's own choice is left alone."""
    folder, _ = finished
    other = tmp_path / "zen"
    subprocess.run(
        [*COMMAND, *SHORT, "--seed", "3", "--quiet", "-o", str(other)],
        env=unsettled(OPENBLAS_CORETYPE="Zen"),
        timeout=300,
        check=True,
    )
    np.testing.assert_array_equal(states(folder), states(other))


def test_early_termination_is_exit_code_3_with_log_and_summary(here, capsys):
    line = ["run", "--controller", "feedforward", "--set", "path.laps=1", "--set"]
    assert main([*line, "terrain.slope_rad=0.2", "-o", "ended"]) == 3
    summary = json.loads((here / "ended" / "summary.json").read_text())
    assert summary["status"] in ("lost", "stopped")
    assert summary["failure"] in capsys.readouterr().out.replace("\n", " ")
    *_, failure, end = read_log(here / "ended" / "log.mcap").events
    assert failure.text == summary["failure"]
    assert end.text.startswith(f"run ends: {summary['status']} after ")


def test_a_demo_is_20_s_with_a_film_also_without_opengl(here, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    monkeypatch.setattr(drive, "_DEMO_S", 4.0)
    assert main(["demo", "pavement"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "open runs/demo-pavement/report.html"
    folder = here / "runs" / "demo-pavement"
    assert json.loads((folder / "summary.json").read_text())["duration_s"] == pytest.approx(4.0)
    with Image.open(folder / "film.webp") as film:
        assert film.n_frames > 10


def test_bad_input_gets_one_line_and_exit_code_2_and_writes_nothing(here, capsys):
    for arguments, message in (
        (("gras",), "scenario 'gras'"),
        (("nowhere.toml",), "no such file"),
        (("--seed", "-1"), "--seed"),
        (("--speed", "2"), "--speed"),
        (("--port", "2"), "--port"),
        (("--live", "--speed", "0"), "must be from 1e-6"),
        (("--record-rate", "30"), "must be one of 5, 10, 20, 25, 50"),
        (("--controller", "pidd"), "did you mean pid"),
        (("--set", "soil.cone_index_kpa=-3"), "soil.cone_index_kpa"),
        (("--set", "soil.softnes=3"), "unknown key"),
        (("--set", "path.radius_m=2.0"), "too tight"),
        (("--set", "terrain.size_x_m=40.0"), "4 m inside the field"),
        (("--colour", "red"), "unrecognized arguments"),
    ):
        assert message in refusal(capsys, "run", *arguments, "--out", "new")
        assert not any(here.iterdir())


def test_a_window_needs_a_screen_and_writes_nothing(here, monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert "no screen" in refusal(capsys, "run", "--view", *SHORT)
    assert "--out" in refusal(capsys, "run", "--view", "-o", "x")
    assert not any(here.iterdir())


def test_termination_is_an_interrupt(monkeypatch, capsys):
    def terminate(arguments):
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError

    monkeypatch.setattr("argparse.ArgumentParser.parse_args", lambda *_: Parsed())
    monkeypatch.setattr(Parsed, "command", staticmethod(terminate), raising=False)
    before = signal.getsignal(signal.SIGTERM)
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "ttempc: interrupted\n"  # no log was cut
    assert signal.getsignal(signal.SIGTERM) is before


class Parsed:
    """What the parser returns."""


def test_help_names_every_command_loads_nothing_slow_and_leaves_one_thread():
    """A process without other tests: only it shows what is loaded."""
    code = (
        "import contextlib, sys\n"
        "from proving_ground.experiments.commands.cli import _COMMANDS, main\n"
        "for line in ([], *([name] for name in _COMMANDS)):\n"
        "    with contextlib.suppress(SystemExit): main([*line, '--help'])\n"
        "slow = {'mujoco', 'numba', 'scipy', 'matplotlib', 'pydantic', 'dask', 'pandas', 'av'}\n"
        "print(sorted(slow & set(sys.modules)))\n"
        "import numpy as np\n"
        "np.ones((500, 500)) @ np.ones((500, 500))\n"
        "import os\n"
        "print(len(os.listdir('/proc/self/task')) if sys.platform == 'linux' else 1)\n"
    )
    environment = unsettled()
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert lines[-2:] == ["[]", "1"], "slow modules, threads of a product of matrices"
    for name in _COMMANDS:
        assert any(line.split()[:1] == [name] for line in lines)
        assert f"usage: ttempc {name} " in done.stdout


def test_the_list_has_names_and_schema(here, capsys):
    assert main(["list", "--json"]) == 0
    groups = json.loads(capsys.readouterr().out)
    assert list(groups["scenarios"]) == shipped()
    assert list(groups["controllers"]) == list(CONTROLLERS)
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    assert all(name in text and about in text for g in groups.values() for name, about in g.items())
    assert main(["list", "--schema", "-o", "s.json"]) == 0
    assert json.loads((here / "s.json").read_text())["properties"]


def test_a_template_drives_with_the_command_that_is_printed(here, capsys):
    kinds = ("controller", "my_own", SHORT), ("scenario", "my-field", SHORT), ("study", "mine", [])
    for kind, name, short in kinds:
        assert main(["new", kind, name]) == 0
        command = shlex.split(capsys.readouterr().out.splitlines()[-1])
        assert command[0] == "ttempc"
        assert main([*command[1:], *short]) == 0


def test_a_template_needs_a_name_and_overwrites_nothing(here, capsys):
    for name in ("a b", "../a", "class", "my-own", ""):
        assert "name" in refusal(capsys, "new", "controller", name)
    for name in ("os", "numpy", "proving_ground"):  # a file of that name would hide the module
        assert "would hide the module" in refusal(capsys, "new", "controller", name)
    assert not list(here.iterdir())
    (here / "mine.toml").write_text("mine")
    assert "exists already" in refusal(capsys, "new", "scenario", "mine")
    assert (here / "mine.toml").read_text() == "mine"


def test_code_that_a_file_names_runs_only_on_trust(here, capsys):
    (here / "evil.py").write_text("raise SystemExit(0)\n")
    (here / "study.toml").write_text('scenario = "theirs.toml"\n')
    for table in (
        '[controller]\nname = "evil:make"',
        '[controller]\nestimator = "evil:make"',
        '[[stages]]\nmake = "evil:make"\nafter = "sense"',
    ):
        (here / "theirs.toml").write_text(table)
        for command in (
            ["run", "theirs.toml"],
            ["run", "theirs.toml", "--view"],
            ["validate", "theirs.toml"],
            ["search", "limit", "theirs.toml", "speed"],
            ["search", "rays", "theirs.toml", "speed"],
            ["sweep", "study.toml", "--dry-run"],
        ):
            assert "is code that this file asks to run" in refusal(capsys, *command)
        assert "evil" not in sys.modules
        raised = "importing evil raised SystemExit"
        assert raised in refusal(capsys, "run", "theirs.toml", "--trust", "--out", "new")
    (here / "theirs.toml").write_text('[controller]\nname = "evil:make"')
    line = ["run", "theirs.toml", "--controller", "evil:make", "--out", "new"]
    assert raised in refusal(capsys, *line)


def test_code_that_a_study_names_is_refused_with_the_name_of_the_study(here, capsys):
    (here / "mine.py").write_text("raise SystemExit(0)\n")
    axis = '[[axis]]\nkind = "list"\nkey = "controller"\nvalues = ["mine:make"]\n'
    setting = '[set]\ncontroller.name = "mine:make"\n'
    for name, table in (("of-axis", axis), ("of-set", setting)):
        (here / f"{name}.toml").write_text(f'scenario = "grass"\n{table}')
        said = refusal(capsys, "sweep", f"{name}.toml", "--dry-run")
        assert f"{name}.toml: controller.name = 'mine:make'" in said
        assert "grass.toml" not in said
    assert "mine" not in sys.modules


def test_the_example_of_the_docs_draws_the_figures_of_the_paper(finished, tmp_path, monkeypatch):
    folder, _ = finished
    example = Path(__file__).parents[2] / "docs" / "examples" / "read_a_log.py"
    monkeypatch.setattr(sys, "argv", [str(example), str(folder / "log.mcap"), str(tmp_path)])
    exec(compile(example.read_text(), str(example), "exec"), {"__name__": "__main__"})
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"paths.png", "euclidean_errors.png", "control_signals.png"}
