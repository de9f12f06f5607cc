"""The layers of docs/architecture.md: who may import whom."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = {"mjcf", "testbed", "ttempc", "experiments"}
CONTROL_SIDE_MAY = {"numpy", "scipy", "piqp", "numba", "ttempc"}
DAQP_MODULE = "ttempc/mpc/qp.py"
TESTBED_MAY_OF_TTEMPC = {
    "ttempc.errors",
    "ttempc.jit",
    "ttempc.suggestion",
    "ttempc.types",
    "ttempc.vehicle",
}


def imports(file: Path) -> set[str]:
    """Return the modules that a file imports, those of the project by their path in the tree."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= set(targets(file, node))
    return {name.removeprefix("proving_ground.") for name in names}


def targets(file: Path, node: ast.ImportFrom) -> list[str]:
    """Return the modules that a `from ... import ...` loads: submodules where they are named."""
    base = list(file.relative_to(ROOT).parts[: -node.level]) if node.level else []
    module = ".".join(base + ([node.module] if node.module else []))
    folder = ROOT.joinpath(*module.removeprefix("proving_ground.").split("."))
    if not folder.is_dir():
        return [module]
    return [
        f"{module}.{alias.name}" if (folder / f"{alias.name}.py").exists() else module
        for alias in node.names
    ]


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Return the nodes of one circle of a graph, none where it has none."""
    done: set[str] = set()

    def search(node: str, way: list[str]) -> list[str]:
        if node in way:
            return way[way.index(node) :]
        if node in done:
            return []
        for follower in sorted(graph.get(node, ())):
            if circle := search(follower, [*way, node]):
                return circle
        done.add(node)
        return []

    return next((circle for node in sorted(graph) if (circle := search(node, []))), [])


def modules(package: str) -> list[Path]:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    return files


@pytest.mark.parametrize("file", modules("ttempc"), ids=lambda file: file.stem)
def test_control_side_knows_nothing_of_plant_files_or_clock(file):
    may = CONTROL_SIDE_MAY | ({"daqp"} if file.match(DAQP_MODULE) else set())
    for name in imports(file):
        top = name.split(".")[0]
        assert top in may | sys.stdlib_module_names, f"{file} imports {name}"
        assert top not in {"time", "pathlib", "os", "io"}, f"{file} imports {name}"


def test_daqp_loads_only_where_it_is_asked_for():
    """It is an optional extra: the table of controllers must load without it."""
    code = """if True:
        import sys
        import ttempc.guidance.controllers
        import proving_ground.experiments.run.simulate
        sys.exit("daqp" in sys.modules)"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize("file", modules("testbed"), ids=lambda file: file.stem)
def test_testbed_never_imports_a_controller_or_an_experiment(file):
    for name in imports(file):
        top = name.split(".")[0]
        assert top != "experiments", f"{file} imports {name}"
        assert top != "ttempc" or name in TESTBED_MAY_OF_TTEMPC, f"{file} imports {name}"


def test_no_circle_of_imports_between_files_or_folders():
    """`__init__.py` of a package hands names on: it is no node between folders."""
    files: dict[str, set[str]] = {}
    folders: dict[str, set[str]] = {}
    for package in PROJECT:
        for file in modules(package):
            name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            ours = {item for item in imports(file) if item.split(".")[0] in PROJECT}
            files[name.removesuffix(".__init__")] = ours
            if len(file.relative_to(ROOT).parts) > 2 or file.name != "__init__.py":
                folder = name.rpartition(".")[0]
                others = {folder_of(item) for item in ours} - {folder}
                folders.setdefault(folder, set()).update(others)
    assert not cycle(files)
    assert not cycle(folders)


def folder_of(module: str) -> str:
    path = ROOT.joinpath(*module.split("."))
    return module if path.is_dir() else module.rpartition(".")[0]


@pytest.mark.parametrize("package", sorted(PROJECT))
def test_modules_of_one_package_import_each_other_relatively(package):
    """Installed, testbed, experiments and mjcf lie in `proving_ground`."""
    for file in modules(package):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and not node.level:
                assert node.module is not None
                inside = node.module.removeprefix("proving_ground.")
                top = inside.split(".")[0]
                assert top != package, f"{file} imports {node.module}"
                if top in PROJECT - {"ttempc"}:
                    assert inside != node.module, f"{file} imports {node.module}"
