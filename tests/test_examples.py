"""Examples of docs/examples, run as they stand there, in an empty folder."""

import importlib
import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from proving_ground.experiments.errors import InvalidController
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
COVERED_ELSEWHERE = {"read_a_log.py", "ros2_bag.py"}  # need a log: tests/experiments


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


def test_the_double_integrator_keeps_its_constraints(tmp_path):
    output = run("double_integrator.py", tmp_path, "figure.png")
    assert "K [-0.6609 -1.3261]" in output
    x_2, u, last = map(float, re.findall(r"\d\.\d{3}", output.splitlines()[-1]))
    assert 1.9 < x_2 <= 2.0  # the constraint is active, and holds
    assert 0.9 < u <= 1.0
    assert last <= 1.0
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_fresh_flights_of_the_drone_stay_in_its_tube(tmp_path):
    output = run("planar_drone.py", tmp_path)
    first, searched = (float(x) for x in re.findall(r"gain: x \+-([\d.]+) m", output))
    assert searched < first
    inside, flights = map(int, re.findall(r"(\d+) of (\d+)", output)[0])
    assert flights == 200
    assert inside >= 0.95 * flights


def test_every_example_is_run_by_a_test():
    tests = "".join(file.read_text() for file in (EXAMPLES.parents[1] / "tests").rglob("*.py"))
    assert all(f"{file.stem}" in tests for file in EXAMPLES.glob("*.py"))


@pytest.mark.parametrize("law", ["Stanley", "PurePursuit"])
def test_a_geometric_law_drives_a_curve(law, monkeypatch):
    """A steering the wrong way would leave the path; in reverse it is refused."""
    monkeypatch.syspath_prepend(EXAMPLES)
    make = getattr(importlib.import_module("geometric"), law)
    summary, _ = simulate(*load("grass", ["path.laps=1"]), 11, factory=make)
    assert summary.status == "completed", summary.failure
    assert summary.tracking.all.tractor.cross_p95_m < 0.1
    assert summary.tracking.all.trailer.cross_p95_m < 0.2
    backward = load("grass", ["path={kind='straight', length_m=12.0, reverse=true}"])
    with pytest.raises(InvalidController, match="forward"):
        simulate(*backward, 11, factory=make)


needs_acados = pytest.mark.skipif(not find_spec("acados"), reason="needs comma-deps-acados")


@pytest.mark.filterwarnings("ignore")  # of CasADi and do-mpc, about their own parts
@pytest.mark.parametrize(
    ("example", "factory"),
    [
        ("casadi_mpc.py", "CasadiMpc"),
        ("do_mpc_controller.py", "DoMpc"),
        pytest.param("acados_mpc.py", "AcadosMpc", marks=needs_acados),
    ],
)
@pytest.mark.parametrize("reverse", [False, True])
def test_a_controller_of_an_outsider_drives(example, factory, reverse, monkeypatch):
    """Ten metres; an input the wrong way would end in a jack-knife."""
    monkeypatch.syspath_prepend(EXAMPLES)
    path = f"path={{kind='straight', length_m=12.0, reverse={json.dumps(reverse)}}}"
    name, scenario = load("grass", [path])
    make = getattr(importlib.import_module(Path(example).stem), factory)
    summary, _ = simulate(name, scenario, 11, factory=make, options={"horizon": 8})
    assert summary.status == "completed", summary.failure
    errors = summary.tracking.all
    assert errors.tractor.max_m < 0.15
    assert errors.trailer.max_m < 0.15
