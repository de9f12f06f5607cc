"""Check budgets of lines, layers and docstring titles; `make lint` runs it after ruff and pyright.

The budgets stand in `[tool.budgets]` of pyproject.toml: lines of `*.py` with comments and blanks. A
decision written beside a line raises it, nothing else.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = ("mjcf", "testbed", "ttempc", "experiments")
LIBRARIES = {"numpy", "scipy", "piqp", "numba", "llvmlite", "daqp"}  # llvmlite is numba's own
CONTROL_SIDE_MAY = LIBRARIES | {"ttempc"} | sys.stdlib_module_names
CONTROL_SIDE_MAY_NOT = {"time", "pathlib", "os", "io"}
DISK_CACHE = "ttempc.jit"  # the one place of the control side that touches files and processes
_SHARED = ("errors", "jit", "layout", "suggestion", "types", "vehicle")
TESTBED_MAY = {f"ttempc.{name}" for name in _SHARED}
SHIPPED_MAY_NOT = "experiments.papers"  # the wheel leaves it out


def files(folder: str) -> list[Path]:
    """Return the modules below a folder of the project."""
    return sorted((ROOT / folder).rglob("*.py"))


def imports(file: Path) -> Iterator[tuple[str, bool]]:
    """Yield the modules that a file imports, by their path in the tree, and whether relatively."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = file.relative_to(ROOT).parts[: -node.level] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            folder = ROOT.joinpath(*module.split("."))
            for alias in node.names:
                inside = folder.is_dir() and (
                    (folder / f"{alias.name}.py").exists() or (folder / alias.name).is_dir()
                )
                yield f"{module}.{alias.name}" if inside else module, bool(node.level)


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of one circle of imports, none where there is none."""
    done: set[str] = set()

    def search(node: str, trail: list[str]) -> list[str]:
        if node in trail:
            return trail[trail.index(node) :]
        if node in done:
            return []
        for follower in sorted(graph.get(node, ())):
            if found := search(follower, [*trail, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := search(node, []))), [])


def layer_faults() -> Iterator[str]:
    """Yield imports that run against the layers of docs/architecture.md."""
    graph: dict[str, set[str]] = {}
    for package in PROJECT:
        for file in files(package):
            place = file.relative_to(ROOT)
            name = ".".join(place.with_suffix("").parts).removesuffix(".__init__")
            graph[name] = set()
            for module, relative in imports(file):
                top = module.split(".")[0]
                if top in PROJECT:
                    graph[name].add(module)
                    if not relative and top != "ttempc":
                        yield f"{place}: imports {module} absolutely"
                if package == "ttempc" and (
                    top not in CONTROL_SIDE_MAY
                    or (
                        top in CONTROL_SIDE_MAY_NOT and not name.startswith("ttempc.jit")
                    )  # hooks of a fork, disk cache
                ):
                    yield f"{place}: the control side imports {module}"
                if package == "testbed" and (
                    top == "experiments" or (top == "ttempc" and module not in TESTBED_MAY)
                ):
                    yield f"{place}: the plant side imports {module}"
                if module.startswith(SHIPPED_MAY_NOT) and not name.startswith(SHIPPED_MAY_NOT):
                    yield f"{place}: shipped code imports {module}"
    if found := circle(graph):
        yield f"circle of imports: {' -> '.join(found)}"


def title_faults() -> Iterator[str]:
    """Yield module docstrings that are clauses instead of titles."""
    for package in PROJECT:
        for file in files(package):
            text = ast.get_docstring(ast.parse(file.read_text())) or ""
            if re.match(r"(What|Where|How|That|Which|Whether)\b", text):
                yield f"{file.relative_to(ROOT)}: docstring is no title: {text.splitlines()[0]}"


def budget_faults() -> Iterator[str]:
    """Yield packages over their budget of lines, packages without one, and the sum over its own."""
    budgets = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["budgets"]
    lines = dict.fromkeys(budgets["lines"], 0)
    for package in (*PROJECT, "tests"):
        for file in files(package):
            place = file.relative_to(ROOT).parent.as_posix()
            owner = max((f for f in lines if f"{place}/".startswith(f"{f}/")), key=len, default="")
            if not owner:
                yield f"{place}: no budget in pyproject.toml"
                continue
            lines[owner] += len(file.read_text().splitlines())
    for folder, count in lines.items():
        if count > budgets["lines"][folder]:
            yield f"{folder}: {count} lines, budget {budgets['lines'][folder]}"
    if "-v" in sys.argv:
        print(
            *(f"{count:6} of {budgets['lines'][f]:6}  {f}" for f, count in lines.items()), sep="\n"
        )
    production = sum(lines.values()) - lines["tests"]
    if production > budgets["production"]:
        yield f"all packages: {production} lines, budget {budgets['production']}"
    words = sum(
        len(page.read_text().split())
        for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        if "generated" not in page.parts
    )
    if words > budgets["words"]:
        yield f"README and docs: {words} words, budget {budgets['words']}"


def main() -> int:
    """Print all faults; return 1 if there are any."""
    faults = [*budget_faults(), *layer_faults(), *title_faults()]
    print(*faults, sep="\n")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
