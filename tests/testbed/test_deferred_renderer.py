"""No renderer is imported where no picture is drawn."""

import os
import subprocess
import sys

import pytest
from proving_ground.experiments.commands.cli import main

PLANT = "import proving_ground.testbed.simulation.plant"


def python(code, renderer):
    """Return the output of a process with the variable MUJOCO_GL."""
    environment = os.environ | {
        "MUJOCO_GL": renderer,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return process.stdout.strip()


@pytest.mark.parametrize("renderer", ["osmesa", "nonsense", "egl", ""])
def test_the_plant_needs_no_renderer(renderer):
    code = f"{PLANT}; import sys; print([n for n in sys.modules if 'OpenGL' in n or 'glfw' in n])"
    assert python(code, renderer) == "[]"


def test_a_user_finds_the_renderers_of_mujoco_where_they_always_are():
    names = "mujoco.Renderer.__name__, mujoco.GLContext.__module__, hasattr(mujoco, 'Nonsense')"
    expected = "Renderer mujoco.egl False"
    for first in (PLANT, "import mujoco"):
        assert python(f"{first}; import mujoco, {PLANT[7:]}; print(*({names}))", "egl") == expected


def test_a_command_that_draws_nothing_runs_under_any_renderer(monkeypatch, capsys):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    assert main(["list"]) == 0
    assert "kayacan2016" in capsys.readouterr().out
