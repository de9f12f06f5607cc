"""Every example of the README, run as it stands there, in an empty folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from proving_ground.experiments.scenario.scenario import load

ROOT = Path(__file__).parents[1]
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)


def blocks(language):
    found = [text for name, text in BLOCKS if name == language]
    assert found
    return found


def numbers(text):
    return [float(found) for found in re.findall(r"-?\d+(?:\.\d+)?", text)]


def test_commands_run(tmp_path):
    controller, _ = blocks("python")
    (tmp_path / "hurried.py").write_text(controller)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euc", "\n".join(blocks("bash"))],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "wet" / "report.html").exists()
    assert (tmp_path / "mine" / "report.html").exists()


def test_the_python_example_prints_what_stands_below_it(tmp_path):
    (controller, example), (output,) = blocks("python"), blocks("text")
    (tmp_path / "hurried.py").write_text(controller)
    done = subprocess.run(
        [sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.sub(r"[-\d.]+", "", done.stdout) == re.sub(r"[-\d.]+", "", output)
    # Another processor may round otherwise; on 20 m of pavement that stays far below a millimetre.
    assert numbers(done.stdout) == pytest.approx(numbers(output), abs=0.1)


def test_the_scenario_example_is_accepted(tmp_path):
    file = tmp_path / "stubble.toml"
    file.write_text(blocks("toml")[0])
    assert load(str(file))[1].soil.patches[0].cone_index_kpa == 250.0


def test_the_path_example_is_accepted(tmp_path):
    (tmp_path / "field.csv").write_text("x,y,speed\n-20,0,0.8\n0,0,1.0\n20,0,0.8\n")
    (tmp_path / "mine.toml").write_text(blocks("toml")[1])
    mission = load(str(tmp_path / "mine.toml"))[1].mission()
    assert mission.path.length_m == pytest.approx(40.0)


def test_the_implement_example_is_accepted(tmp_path):
    file = tmp_path / "tilled.toml"
    file.write_text(blocks("toml")[2])
    assert load(str(file))[1].implement.work_m == ((3.0, 130.0),)


@pytest.mark.parametrize("target", ["run", "test", "lint", "docs"])
def test_the_make_targets_exist(target):
    done = subprocess.run(
        ["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
