"""The two distributions as they are installed, and their peace with a user's own packages."""

import os
import re
import subprocess
import sys
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

import ttempc

ROOT = Path(__file__).parents[1]
LIBRARY_FOLDER = ROOT / "ttempc"
LIBRARY = ("numpy", "scipy", "piqp", "numba")
STRAIGHT = "path={kind='straight',length_m=10}"

# Only what the library's wheel requires may be imported, and what those require.
ONLY_THE_LIBRARY = """
import importlib.abc, runpy, sys

class Refusal(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        allowed = {"ttempc", "numpy", "scipy", "piqp", "numba", "llvmlite"}
        top = name.partition(".")[0]
        if top not in allowed | sys.stdlib_module_names and path is None and top in FOREIGN:
            raise ModuleNotFoundError(f"{name} is not installed with the library")

FOREIGN = set("mujoco mcap matplotlib pydantic dask daqp jinja2 av PIL proving_ground".split())
sys.meta_path.insert(0, Refusal())
runpy.run_path(sys.argv[1], run_name="__main__")
assert not FOREIGN & set(sys.modules)
"""


def build(project, requirement, folder):
    environment = {**os.environ, "TTEMPC_LIBRARY": requirement}
    options = ["--no-deps", "--no-build-isolation", "--wheel-dir", str(folder)]
    command = [sys.executable, "-m", "pip", "wheel", *options, str(project)]
    subprocess.run(command, env=environment, check=True, capture_output=True)


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Both wheels, as `make wheels` builds them."""
    folder = tmp_path_factory.mktemp("dist")
    build(LIBRARY_FOLDER, "", folder)
    build(ROOT, f"=={ttempc.__version__}", folder)
    (library,) = folder.glob("ttempc-*.whl")
    (testbed,) = folder.glob("ttempc_proving_ground-*.whl")
    return library, testbed


def content(wheel):
    """Return the names in a wheel, and what it requires without extras."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith("/METADATA"))
        lines = archive.read(metadata).decode().splitlines()
    required = [line.partition(": ")[2] for line in lines if line.startswith("Requires-Dist")]
    return names, {re.split(r"[^\w.-]", item)[0] for item in required if "extra ==" not in item}


def installed(folder, *wheels):
    """Unpack wheels and return the environment of a process that imports them."""
    for wheel in wheels:
        zipfile.ZipFile(wheel).extractall(folder)
    return {**os.environ, "PYTHONPATH": str(folder)}


def python(arguments, folder, environment):
    command = [sys.executable, *arguments]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_library_is_one_package_with_four_requirements(wheels):
    names, required = content(wheels[0])
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"ttempc"}
    assert "ttempc/py.typed" in names
    assert {
        f"ttempc/{file.relative_to(LIBRARY_FOLDER)}" for file in LIBRARY_FOLDER.rglob("*.py")
    } <= set(names)
    assert required == set(LIBRARY)


def test_the_library_drives_without_any_other_package(wheels, tmp_path):
    environment = installed(tmp_path / "site", wheels[0])
    example = ROOT / "docs" / "examples" / "guidance_loop.py"
    (tmp_path / "alone.py").write_text(ONLY_THE_LIBRARY)
    output = python(["alone.py", str(example)], tmp_path, environment)
    assert output.startswith("684 ticks")


def test_the_proving_ground_is_one_package_that_requires_the_library(wheels):
    names, required = content(wheels[1])
    tops = {name.partition("/")[0].partition("-")[0] for name in names}
    assert tops == {"proving_ground", "ttempc_proving_ground"}
    assert "proving_ground/experiments/studies/trials/bench.py" in names
    assert not [name for name in names if name.startswith("proving_ground/experiments/papers")]
    assert {"ttempc", "mujoco"} <= required


def test_wheels_carry_model_scenarios_and_templates(wheels, tmp_path):
    environment = installed(tmp_path / "site", *wheels)
    command = ["-m", "proving_ground.experiments.commands.cli", "run", "pavement", "--json"]
    python([*command, "--out", "out", "--set", STRAIGHT], tmp_path, environment)
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


@pytest.fixture
def repository(tmp_path):
    """A user's repository with packages of the project's own names."""
    for name in ("experiments", "testbed", "mjcf"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"MINE = {name!r}\n")
    (tmp_path / "experiments" / "gains.py").write_text("HP = 0.6\n")
    (tmp_path / "mine.py").write_text(
        "import testbed\n"
        "from experiments.gains import HP\n"
        "from ttempc import Command\n"
        "class Mine:\n"
        "    def __init__(self, vehicle, reference, period_s):\n"
        "        assert testbed.MINE == 'testbed'\n"
        "    def step(self, estimate, k):\n"
        "        return Command(0.0, 0.0, HP)\n"
    )
    (tmp_path / "study.toml").write_text(
        'description = "mine"\nscenario = "grass"\nseeds = 2\n'
        'set = { path = { kind = "straight", length_m = 4 } }\n'
        '[[axis]]\nkey = "controller"\nkind = "list"\nvalues = ["mine:Mine", "pid"]\n'
    )
    return tmp_path


def test_commands_run_in_a_repository_with_packages_of_the_same_names(repository):
    command = str(Path(sys.executable).with_name("ttempc"))
    for arguments in (
        ["run", "grass", "--controller", "mine:Mine", "--out", "run", "--set", STRAIGHT],
        ["sweep", "study.toml", "--out", "swept", "--workers", "0", "--trust"],
    ):
        done = subprocess.run(
            [command, *arguments], cwd=repository, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert (repository / "run" / "summary.json").exists()
    rows = (repository / "swept" / "results.jsonl").read_text().splitlines()
    assert len(rows) == 4
    assert all('"completed"' in row for row in rows)


@pytest.mark.parametrize("package", ["ttempc", "proving_ground"])
def test_public_names_load_and_are_documented(package):
    module = import_module(package)
    assert sorted(set(module.__all__)) == sorted(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        assert name.startswith("_") or name.isupper() or value.__doc__, name
    assert set(module.__all__) - {"__version__"} == set(module._MODULE_OF)
    with pytest.raises(AttributeError, match="nothing"):
        _ = module.nothing
