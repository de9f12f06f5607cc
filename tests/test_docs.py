"""Pages against the code: commands with their options, extras, paths, names, and the version."""

import contextlib
import functools
import io
import pkgutil
import re
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from proving_ground.experiments.commands.cli import main

import ttempc
from ttempc.types import Disturbance, Estimate, Input, State

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in page.parts),
]
PACKAGES = ("experiments", "mjcf", "proving_ground", "testbed", "ttempc")
PATH = re.compile(r"(?<![\w./-])[\w.-]+(?:/[\w.-]*\w)+")
COMMAND = re.compile(r"(?<![\w./-])(?<!from )ttempc ([a-z][\w-]*)\b(?![\w.-]*=)([^#|]*)")


def code_lines(page):
    """Return the code of a page: its spans and the lines of its blocks."""
    text = page.read_text()
    fenced = re.findall(r"^```\w*\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    rest = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    indented = re.findall(r"^ {4}(.*)$", rest, re.MULTILINE)
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", rest)]
    return spans + "\n".join(fenced).splitlines() + indented


@functools.cache
def help_of(*command):
    """Return the help text of a command, empty where there is no such command."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        try:
            code = main([*command, "--help"])
        except SystemExit as stop:
            code = stop.code
    return "" if code else output.getvalue()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_names_what_exists(page):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = set(re.findall(r"extras? `(\w+)`", page.read_text()))
    assert extras <= project["optional-dependencies"].keys()
    for line in code_lines(page):
        for path in PATH.findall(line):
            if path.startswith(tuple(f"{f}/" for f in (*PACKAGES, "docs", "tests"))):
                assert "NAME" in path or "Trial-v" in path or (ROOT / path).exists(), path
        for name in re.findall(rf"^(?:{'|'.join(PACKAGES)})(?:\.\w+)+$", line):
            root = "" if name.startswith(("proving_ground", "ttempc")) else "proving_ground."
            pkgutil.resolve_name(root + name)
        for command, rest in COMMAND.findall(line):
            grouped = command in ("log", "fit", "search") and rest.split()
            text = help_of(command, *rest.split()[: bool(grouped)])
            assert text, line
            for option in re.findall(r"(?<!\S)(--?[a-z][\w-]*)", rest):
                assert re.search(rf"{option}\b", text), line


def test_the_entries_that_a_controller_gets_are_listed():
    text = (ROOT / "docs" / "controller.md").read_text()
    for kind in (State, Input, Disturbance):
        assert all(f"`{kind.__name__}.{entry.name}`" in text for entry in kind)
    assert all(f"`{item.name}`" in text for item in fields(Estimate) if item.name != "slip_factors")


def test_the_citation_names_this_version():
    text = (ROOT / "CITATION.cff").read_text()
    assert re.findall(r"^version: (.+)$", text, re.MULTILINE) == [ttempc.__version__]
