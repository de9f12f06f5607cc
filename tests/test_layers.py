"""The layers of docs/architecture.md: who may import whom."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = {"mjcf", "testbed", "ttempc", "experiments"}
CONTROL_SIDE_MAY = {"numpy", "scipy", "piqp", "numba", "ttempc"}
CASADI_ROOMS = "ttempc/baselines/nmpc*.py"
TESTBED_MAY_OF_TTEMPC = {"ttempc.types", "ttempc.vehicle"}


def imports(file: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            assert node.module is not None
            found.add(node.module)
    return found


def modules(package: str) -> list[Path]:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    return files


@pytest.mark.parametrize("file", modules("ttempc"), ids=lambda file: file.stem)
def test_control_side_knows_nothing_of_plant_files_or_clock(file):
    may = CONTROL_SIDE_MAY | ({"casadi"} if file.match(CASADI_ROOMS) else set())
    for name in imports(file):
        top = name.split(".")[0]
        assert top in may | sys.stdlib_module_names, f"{file} imports {name}"
        assert top not in {"time", "pathlib", "os", "io"}, f"{file} imports {name}"


def test_casadi_loads_only_where_it_is_asked_for():
    """It is an optional extra: the table of controllers must load without it."""
    code = "import sys, ttempc.controllers, experiments.run; sys.exit('casadi' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize("file", modules("testbed"), ids=lambda file: file.stem)
def test_testbed_never_imports_a_controller_or_an_experiment(file):
    for name in imports(file):
        top = name.split(".")[0]
        assert top != "experiments", f"{file} imports {name}"
        assert top != "ttempc" or name in TESTBED_MAY_OF_TTEMPC, f"{file} imports {name}"


@pytest.mark.parametrize("package", sorted(PROJECT))
def test_rooms_stay_rooms(package):
    for file in modules(package):
        assert len(file.read_text().splitlines()) <= 350, f"{file} has grown into a hall"
