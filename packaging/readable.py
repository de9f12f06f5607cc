"""Rules of readability that packing cannot meet; `lint.py` holds the tree to them.

A rule takes one module and yields its faults. None of them counts lines of a file: a longer text
that says one thing at a time breaks no rule.
"""

from __future__ import annotations

import ast
import io
import keyword
import re
import tokenize
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

LONGEST_FUNCTION = 80  # lines, with docstring and comments
MOST_ARGUMENTS = 8
LARGEST_COLUMN = 2  # x, y, z need no name
SHORTEST_NAME = 4  # symbols of equations are shorter

_CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
_PATH = re.compile(r"\b(?:docs|experiments|packaging|tests|testbed|ttempc|mjcf)/[\w./-]*\w")
_PATH_SUFFIXES = (".md", ".py", ".toml", ".json", ".html", ".xml", ".ipynb")
_PLACEHOLDER = re.compile(r"\b[A-Z]+\b")  # in a path, as NAME
_QUOTED = re.compile(r"(?<!`)`([A-Za-z_][\w.]*)(?:\(\))?`(?!`)")


@dataclass(frozen=True)
class Module:
    """Text of one module, by its path in the tree."""

    path: str
    text: str
    tree: ast.Module

    @classmethod
    def read(cls, root: Path, file: Path) -> Module:
        """Return the module that a file below `root` holds."""
        return cls.of(file.relative_to(root).as_posix(), file.read_text(encoding="utf-8"))

    @classmethod
    def of(cls, path: str, text: str) -> Module:
        """Return the module of a text."""
        return cls(path, text, ast.parse(text))


@dataclass(frozen=True)
class Fault:
    """A place that breaks a rule, and how."""

    key: str  # what an allowance is given to: a file, or a function of a file
    line: int
    message: str
    amount: int = 1  # what adds up to the allowance's number: places, lines or arguments

    def __str__(self) -> str:
        return f"{self.key.partition(':')[0]}:{self.line}: {self.message}"


UNBOUNDED = {
    "open",
    "os.open",
    "json.load",
    "json.loads",
    "tomllib.load",
    "tomllib.loads",
    "pickle.load",
    "pickle.loads",
    "np.load",
    "pd.read_csv",
    "pd.read_json",
}
UNBOUNDED_METHODS = {"read_text", "read_bytes"}
"""Calls that read or decode a file of any size and kind."""

Rule = Callable[[Module], Iterator[Fault]]


def packed_assignments(module: Module) -> Iterator[Fault]:
    """Yield assignments of several values to several names in one statement.

    No fault: unpacking of one value, a swap or shift (one value is itself a target), and elements
    of one array (`x, y = point[0], point[1]`).
    """
    for node in ast.walk(module.tree):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple | ast.List):
            continue
        for target in node.targets:
            if not isinstance(target, ast.Tuple | ast.List):
                continue
            targets = {ast.unparse(each) for each in target.elts}
            values = {ast.unparse(each) for each in node.value.elts}
            if targets & values or _same_array(node.value.elts):
                continue
            yield Fault(module.path, node.lineno, f"packed: {ast.unparse(node)[:60]}")


def _same_array(values: list[ast.expr]) -> bool:
    """Return whether all values are elements of one array."""
    bases = {ast.unparse(v.value) if isinstance(v, ast.Subscript) else None for v in values}
    return len(bases) == 1 and None not in bases


def unnamed_members(constants: dict[str, int]) -> Rule:
    """Return the rule that no literal sequence is read by position.

    A read by position is `LIMITS[2]` or `first, second, third = LIMITS`: whoever reads it has to
    look up which member that is. Sequences that are looped over or searched are fine, so is the
    last of a sequence, and so is a pair that is unpacked: it is a range from `low` to `high`.

    Args:
        constants: Lengths of the public sequences of all modules, by name. A module's own private
            ones are added.
    """

    def rule(module: Module) -> Iterator[Fault]:
        lengths = constants | sequences(module)
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Subscript):
                name = _name(node.value)
                member = _integer(node.slice)
                if name in lengths and member is not None and member >= 0:
                    message = f"{name}[{member}]: a member without a name"
                    yield Fault(module.path, node.lineno, message)
            elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
                name = _name(node.value)
                if lengths.get(name, 0) > 2:
                    yield Fault(module.path, node.lineno, f"{name}: unpacked by position")

    return rule


def sequences(module: Module) -> dict[str, int]:
    """Return the constants of a module that are literal sequences, with their lengths."""
    found: dict[str, int] = {}
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Assign):
            target = node.targets[0]
        elif isinstance(node, ast.AnnAssign):
            target = node.target
        else:
            continue
        if not isinstance(node.value, ast.Tuple | ast.List) or len(node.value.elts) < 2:
            continue
        if _CONSTANT.fullmatch(_name(target)):
            found[_name(target)] = len(node.value.elts)
    return found


def _name(node: ast.expr) -> str:
    """Return the last part of a name, `LIMITS` of `tables.LIMITS`, else nothing."""
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else ""


def _integer(node: ast.expr) -> int | None:
    """Return a literal integer, also a negative one."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        positive = _integer(node.operand)
        return None if positive is None else -positive
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    return None


def _functions(module: Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Yield all functions and methods of a module."""
    for node in ast.walk(module.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def long_functions(module: Module) -> Iterator[Fault]:
    """Yield functions that do not fit a screen."""
    for function in _functions(module):
        lines = (function.end_lineno or function.lineno) - function.lineno + 1
        if lines > LONGEST_FUNCTION:
            message = f"{function.name} has {lines} lines, at most {LONGEST_FUNCTION}"
            yield Fault(f"{module.path}:{function.name}", function.lineno, message, lines)


def wide_functions(module: Module) -> Iterator[Fault]:
    """Yield functions of nine or more arguments; keywords of a constructor are not counted."""
    for function in _functions(module):
        arguments = len(function.args.posonlyargs) + len(function.args.args)
        if function.name != "__init__":
            arguments += len(function.args.kwonlyargs)
        if arguments > MOST_ARGUMENTS:
            message = f"{function.name} takes {arguments} arguments, at most {MOST_ARGUMENTS}"
            yield Fault(f"{module.path}:{function.name}", function.lineno, message, arguments)


def bare_reads(module: Module) -> Iterator[Fault]:
    """Yield what opens or decodes a file without the bounds of `testbed/foreign_files.py`."""
    for node in ast.walk(module.tree):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        last = called.rpartition(".")[2]
        if called in UNBOUNDED or (last != called and last in UNBOUNDED_METHODS):
            message = f"{called}: read foreign files by `testbed/foreign_files.py`"
            yield Fault(module.path, node.lineno, message)


def literal_columns(module: Module) -> Iterator[Fault]:
    """Yield subscripts by a number above 2 in compiled modules: columns without a name."""
    if "njit" not in module.text and "from numba" not in module.text:
        return
    for node in ast.walk(module.tree):
        if not isinstance(node, ast.Subscript):
            continue
        keys = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for key in keys:
            column = _integer(key)
            if column is not None and column > LARGEST_COLUMN:
                yield Fault(module.path, node.lineno, f"{ast.unparse(node)}: a column by number")


def stale_references(root: Path, names: set[str]) -> Rule:
    """Return the rule that files and names exist which comments and strings mention."""

    def rule(module: Module) -> Iterator[Fault]:
        for token in tokenize.generate_tokens(io.StringIO(module.text).readline):
            if token.type in (tokenize.COMMENT, tokenize.STRING):
                for message in stale(token.string, root, names):
                    yield Fault(module.path, token.start[0], message)

    return rule


def stale(text: str, root: Path, names: set[str]) -> Iterator[str]:
    """Yield what a text mentions and what is neither below `root` nor among the names."""
    for path in _PATH.findall(text):
        checked = path.endswith(_PATH_SUFFIXES) and not _PLACEHOLDER.search(path)
        if checked and path not in names and not (root / path).exists():
            yield f"{path} does not exist"
    for name in _QUOTED.findall(text):
        if "NAME" in name:  # a placeholder, as `observe_NAME`
            continue
        for part in name.split("."):
            if len(part) >= SHORTEST_NAME and part not in names:
                yield f"`{name}` does not exist"
                break


def known_names(modules: Iterable[Module]) -> set[str]:
    """Return every name that modules define, use or write as a string, with the parts of paths."""
    names = set(keyword.kwlist)
    for module in modules:
        names.update(Path(module.path).with_suffix("").parts)
        for node in ast.walk(module.tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Name):
                names.add(node.id)
            elif isinstance(node, ast.Attribute):
                names.add(node.attr)
            elif isinstance(node, ast.arg | ast.keyword) and node.arg:
                names.add(node.arg)
            elif isinstance(node, ast.alias):
                names.update(node.name.split("."))
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.update(node.module.split("."))
            elif isinstance(node, ast.Constant) and re.fullmatch(r"[\w.]+", str(node.value)):
                names.update(str(node.value).split("."))  # a key, or the name of a file
    return names
