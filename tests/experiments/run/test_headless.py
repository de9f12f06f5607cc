"""What a run without log and pictures loads."""

import ast
import subprocess
import sys
from pathlib import Path

DRIVE = """
import sys
from proving_ground import load, simulate

name, scenario = load("grass", ["path={kind='straight', length_m=2}"])
simulate(name, scenario, seed=1)
for name, found in [*sys.modules.items()]:
    print("MODULE", name, getattr(found, "__file__", None) or "")
"""
MOST_MODULES = 90  # of plant and experiments; the library has a file for each detector
FOREIGN = {"matplotlib", "PIL", "jinja2", "pandas", "mcap", "google.protobuf", "tqdm"}
ROOMS = {
    "testbed.log", "testbed.messages", "testbed.viewers", "experiments.pictures",
    "experiments.logs", "experiments.studies", "experiments.interfaces", "experiments.commands",
}  # fmt: skip


def loaded():
    """Return the modules of a process that drives a run in memory, and their files."""
    command = [sys.executable, "-c", DRIVE]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    lines = [line.split(maxsplit=2) for line in said.splitlines() if line.startswith("MODULE ")]
    return {name: (file or [""])[0] for _, name, *file in lines}


def has_code(file):
    """Return whether a module has more than a docstring."""
    return len(ast.parse(Path(file).read_text(encoding="utf-8")).body) > 1


def test_a_headless_run_knows_neither_log_nor_pictures():
    modules = loaded()
    ours = {
        name.removeprefix("proving_ground."): file
        for name, file in modules.items()
        if name.split(".")[0] in ("proving_ground", "ttempc")
    }
    assert not FOREIGN & modules.keys()
    assert not ROOMS & ours.keys()
    own = [file for name, file in ours.items() if not name.startswith("ttempc")]
    assert sum(map(has_code, own)) <= MOST_MODULES


def test_an_environment_does_not_know_the_film():
    code = (
        "import sys, proving_ground.experiments.interfaces.gym_env.environment; print(*sys.modules)"
    )
    command = [sys.executable, "-c", code]
    names = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    assert not [name for name in names if ".experiments.pictures" in name]
