"""Check layers, docstring titles and readability; `make lint` runs it after ruff and pyright.

`[tool.lint]` of pyproject.toml has what older code is still allowed, by rule and file. The numbers
may only shrink: more than allowed is a fault, and so is less, until `--shrink` lowers the number.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import readable

ROOT = Path(__file__).parents[1]
PROJECT = ("mjcf", "testbed", "ttempc", "experiments")
LIBRARIES = {"numpy", "scipy", "piqp", "numba", "llvmlite", "daqp"}  # llvmlite is numba's own
CONTROL_SIDE_MAY = LIBRARIES | {"ttempc"} | sys.stdlib_module_names
CONTROL_SIDE_MAY_NOT = {"time", "pathlib", "os", "io"}
DISK_CACHE = "ttempc.jit"  # the one place of the control side that touches files and processes
_SHARED = ("errors", "jit", "layout", "sensors", "suggestion", "types", "vehicle")
TESTBED_MAY = {f"ttempc.{name}" for name in _SHARED}
_ALLOWANCES = "# Allowances of `packaging/lint.py`: they may only shrink.\n"
FILES_OF_STRANGERS = ("mjcf", "testbed", "experiments")  # rooms that read them
READS_FREELY = ("testbed/foreign_files.py", "experiments/papers/")  # the bounds; own tables
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


def modules(*folders: str) -> list[readable.Module]:
    """Return the modules below folders of the checkout."""
    return [readable.Module.read(ROOT, file) for folder in folders for file in files(folder)]


def readable_faults() -> dict[str, list[readable.Fault]]:
    """Return the faults of each rule of `readable`, by the name of its allowances."""
    shipped = modules(*PROJECT, "packaging")
    tests = modules("tests")
    examples = modules("docs")
    foreign = [m for m in modules(*FILES_OF_STRANGERS) if not m.path.startswith(READS_FREELY)]
    public = {
        name: length
        for module in shipped
        for name, length in readable.sequences(module).items()
        if not name.startswith("_")
    }
    names = readable.known_names([*shipped, *tests, *examples]) | _names_of_tables()
    stale = readable.stale_references(ROOT, names)

    rules: dict[str, tuple[readable.Rule, list[readable.Module]]] = {
        "packed": (readable.packed_assignments, shipped),
        "unnamed": (readable.unnamed_members(public), shipped),
        "long": (readable.long_functions, shipped),
        "wide": (readable.wide_functions, shipped),
        "columns": (readable.literal_columns, shipped),
        "bare": (readable.bare_reads, foreign),
        "stale": (stale, [*shipped, *examples]),
    }
    faults = {
        name: [fault for module in where for fault in rule(module)]
        for name, (rule, where) in rules.items()
    }
    for page in _texts():
        place = page.relative_to(ROOT).as_posix()
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1):
            for message in readable.stale(line, ROOT, names):
                faults["stale"].append(readable.Fault(place, number, message))
    return faults


def _texts() -> list[Path]:
    """Return the pages, and the data files whose comments a user reads."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    data = [file for folder in PROJECT for file in sorted((ROOT / folder).rglob("*.toml"))]
    return pages + data


def _names_of_tables() -> set[str]:
    """Return the words of the tree's TOML files, and names that belong to other programs."""
    tables = [
        *ROOT.glob("*.toml"),
        *(ROOT / "ttempc").glob("*.toml"),
        *(ROOT / "mjcf").rglob("*.toml"),
    ]
    tables += [*(ROOT / "testbed").rglob("*.toml"), *(ROOT / "experiments").rglob("*.toml")]
    words = {word for table in tables for word in re.findall(r"\w+", table.read_text())}
    return words | set(_settings()["foreign"])


def _settings() -> dict:
    """Return `[tool.lint]` of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["lint"]


def amounts(faults: list[readable.Fault]) -> dict[str, int]:
    """Return the sum of each key's faults."""
    sums: dict[str, int] = {}
    for fault in faults:
        sums[fault.key] = sums.get(fault.key, 0) + fault.amount
    return sums


def beyond_allowance(faults: list[readable.Fault], allowed: dict[str, int]) -> Iterator[str]:
    """Yield the faults of keys above their allowance, and allowances larger than needed."""
    found = amounts(faults)
    for fault in faults:
        if found[fault.key] > allowed.get(fault.key, 0):
            yield str(fault)
    for key, number in allowed.items():
        if found.get(key, 0) < number:
            yield (
                f"pyproject.toml: {key} is allowed {number} and has {found.get(key, 0)}: "
                "`python packaging/lint.py --shrink`"
            )


def shrink() -> None:
    """Write the allowances of pyproject.toml anew, where they are larger than needed."""
    settings = _settings()
    tables = []
    for rule, faults in readable_faults().items():
        allowed = settings.get(rule, {})
        found = amounts(faults)
        kept = {key: min(number, found.get(key, 0)) for key, number in allowed.items()}
        lines = [f'"{key}" = {number}' for key, number in sorted(kept.items()) if number]
        if lines:
            tables.append("\n".join([f"[tool.lint.{rule}]", *lines, ""]))
    project = ROOT / "pyproject.toml"
    before, marker, _ = project.read_text().partition(_ALLOWANCES)
    project.write_text(before + marker + "\n".join(["", *tables]))


def main() -> int:
    """Print all faults; return 1 if there are any."""
    if "--shrink" in sys.argv:
        shrink()
    settings = _settings()
    faults = [*layer_faults(), *title_faults()]
    for rule, found in readable_faults().items():
        faults += [f"{fault} [{rule}]" for fault in beyond_allowance(found, settings.get(rule, {}))]
    print(*faults, sep="\n")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
