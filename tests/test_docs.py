"""Documentation against the tree: links, paths, modules, names and commands."""

import contextlib
import functools
import importlib.util
import io
import pkgutil
import re
from pathlib import Path

import pytest
from proving_ground.experiments.commands.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
PACKAGES = ("experiments", "mjcf", "proving_ground", "testbed", "ttempc")
FOLDERS = (*PACKAGES, "docs", "packaging", "tests")
DATA = [  # files whose comments name modules and pages
    *sorted((ROOT / "mjcf").rglob("*.xml")),
    *sorted((ROOT / "mjcf").rglob("*.toml")),
    *sorted((ROOT / "experiments").rglob("*.toml")),
]
COMMAND = re.compile(r"(?<![\w./-])(?<!from )ttempc ([a-z][\w-]*)([^#|]*)")
PATH = re.compile(r"(?<![\w./-])[\w.-]+(?:/[\w.-]*\w)+")
DOTTED = re.compile(rf"(?<![\w./-])(?:{'|'.join(PACKAGES)})(?:\.\w+)+")
PLACEHOLDER = "NAME"  # in a path that a page explains
NO_PATHS = {"ttempc/FieldTrial-v1"}  # names with a slash

every_page = pytest.mark.parametrize(
    "page", PAGES, ids=[page.relative_to(ROOT).as_posix() for page in PAGES]
)


def without_blocks(page: Path) -> str:
    """Return the text of a page without its fenced and indented blocks of code."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"^ {4}.*$", "", text, flags=re.MULTILINE)


def spans(page: Path) -> list[str]:
    """Return the code spans of a page, each on one line."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", without_blocks(page))]


def code_lines(page: Path) -> list[str]:
    """Return the code of a page: its spans and the lines of its blocks."""
    fenced = re.findall(r"^```\w*\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}(.*)$", page.read_text(), re.MULTILINE)
    return spans(page) + "\n".join(fenced).splitlines() + indented


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub gives to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", without_blocks(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@functools.cache
def help_of(*command: str) -> str:
    """Return the help text of a command of the CLI, empty where there is no such command."""
    output = io.StringIO()
    with (
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(io.StringIO()),
        pytest.raises(SystemExit) as stop,
    ):
        main([*command, "--help"])
    return "" if stop.value.code else output.getvalue()


def leads_nowhere(page: Path, link: str) -> bool:
    """Return whether a relative link of a page has no file, or no heading of its anchor."""
    if re.match(r"[a-z]+:", link):
        return False
    target, _, anchor = link.partition("#")
    file = page.parent / target if target else page
    return not file.exists() or bool(anchor and anchor not in anchors(file))


def is_missing(path: str) -> bool:
    """Return whether a path names a file or folder of the project that does not exist."""
    if path in NO_PATHS:
        return False
    of_the_project = path.endswith(".py") or path.startswith(tuple(f"{f}/" for f in FOLDERS))
    return of_the_project and PLACEHOLDER not in path and not (ROOT / path).exists()


def can_run(module: str) -> bool:
    """Return whether `python -m` finds a module, from the root of a checkout."""
    path = ROOT.joinpath(*module.split("."))
    if module.split(".")[0] in PACKAGES:
        return path.with_suffix(".py").exists() or (path / "__main__.py").exists()
    return importlib.util.find_spec(module) is not None


def exists(name: str) -> bool:
    """Return whether a dotted name is a module of the project or an attribute of one."""
    absolute = name.startswith(("ttempc.", "proving_ground."))
    try:
        pkgutil.resolve_name(name if absolute else f"proving_ground.{name}")
    except (ImportError, AttributeError):
        return False
    return True


@every_page
def test_links_lead_to_files_and_headings(page):
    links = re.findall(r"\]\(([^)\s]+)\)", without_blocks(page))
    assert not [link for link in links if leads_nowhere(page, link)]


@every_page
def test_paths_exist(page):
    paths = PATH.findall("\n".join(code_lines(page)))
    assert not [path for path in paths if is_missing(path)]


@every_page
def test_modules_exist(page):
    modules = re.findall(r"python -m ([\w.]+)", "\n".join(code_lines(page)))
    assert not [module for module in modules if not can_run(module)]


@every_page
def test_dotted_names_can_be_imported(page):
    assert not [span for span in spans(page) if DOTTED.fullmatch(span) and not exists(span)]


@every_page
def test_named_tests_exist(page):
    names = {span for span in spans(page) if re.fullmatch(r"test_\w+", span)}
    sources = [file.read_text() for file in (ROOT / "tests").rglob("*.py")] if names else []
    assert not [name for name in names if not any(f"def {name}(" in text for text in sources)]


@every_page
def test_commands_and_their_options_exist(page):
    for line in code_lines(page):
        for command, rest in re.findall(  # not `ttempc learn=false`, an entry of a table
            r"(?<![\w./-])(?<!from )ttempc ([a-z][\w-]*)\b(?![\w.-]*=)([^#|]*)", line
        ):
            words = (command, rest.split()[0]) if command == "log" and rest.split() else (command,)
            text = help_of(*words)
            assert text, line
            options = re.findall(r"(?<!\S)(--?[a-z][\w-]*)", rest)
            assert not [name for name in options if not re.search(rf"{name}\b", text)], line


def test_the_index_lists_every_page():
    links = set(re.findall(r"\]\(([^)\s]+)\)", (DOCS / "README.md").read_text()))
    pages = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")} - {"README.md"}
    assert pages <= links


@pytest.mark.parametrize("file", DATA, ids=[file.relative_to(ROOT).as_posix() for file in DATA])
def test_comments_of_data_files_name_what_exists(file):
    text = file.read_text()
    assert not [path for path in PATH.findall(text) if is_missing(path)]
    assert not [name for name in DOTTED.findall(text) if not exists(name)]
