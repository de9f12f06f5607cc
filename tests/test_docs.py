"""Pages against the code: commands with their options, extras, paths, names, and the version."""

import contextlib
import functools
import io
import pkgutil
import re
import tomllib
from dataclasses import fields
from itertools import dropwhile, takewhile
from pathlib import Path

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.testbed.ground.soil import NAMED_SOILS
from proving_ground.testbed.implement.implement import IMPLEMENTS
from proving_ground.testbed.sensing.receivers import PLACES, receiver

import ttempc
from ttempc.guidance.controllers import CONTROLLERS
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


REFERENCE = ("architecture", "benchmark", "catalogue", "faults", "interfaces", "mjcf")
"""Pages to look something up in; those of the appendix are such, too."""


def test_pages_can_be_read_in_an_hour_and_each_in_six_minutes():
    """At 250 words a minute; code counts, generated tables do not."""
    words = {}
    for page in (ROOT / "docs").glob("*.md"):
        text = re.sub(r"<!-- table: .*?<!-- end -->", "", page.read_text(), flags=re.DOTALL)
        if page.stem not in REFERENCE:
            words[page.stem] = len(text.split())
    assert max(words.values()) <= 1500, max(words, key=words.__getitem__)
    assert sum(words.values()) <= 15_000


def table(section):
    """Return the rows of the first table of a section of the catalogue by their first cell."""
    text = (ROOT / "docs" / "catalogue.md").read_text().split(f"## {section}\n")[1]
    below = dropwhile(lambda line: not line.startswith("|"), text.split("\n"))
    lines = takewhile(lambda line: line.startswith("|"), below)
    rows = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines]
    return rows[0], {row[0]: row[1:] for row in rows[2:]}


def test_the_catalogue_has_the_soils_of_the_code():
    _, rows = table("Soils")
    assert {name: float(cells[0]) for name, cells in rows.items()} == NAMED_SOILS


def test_the_catalogue_has_the_receivers_of_the_code():
    head, rows = table("Receivers")
    assert head[1:] == [place.replace("-", " ") for place in PLACES]
    deviations = rows["deviation of an axis, white part [mm]"]
    for place, cell in zip(PLACES, deviations, strict=True):
        found = receiver(place)
        assert [float(part) for part in cell.split(",")] == [
            round(1000.0 * found.sd),
            round(1000.0 * found.white_sd),
        ]


def test_the_catalogue_has_the_implements_of_the_code():
    _, rows = table("Implements")
    assert rows.keys() == IMPLEMENTS.keys()
    for name, (a, b, c, factors, spacing, vertical) in rows.items():
        draft = IMPLEMENTS[name]
        assert [float(a), float(b), float(c)] == [draft.a, draft.b, draft.c]
        assert [float(part) for part in factors.split(",")] == [draft.medium, draft.coarse]
        assert spacing == ("by width" if draft.spacing_m is None else f"{draft.spacing_m:.2f}")
        assert float(vertical) == draft.vertical


def test_the_catalogue_has_every_controller():
    _, rows = table("Controllers")
    listed = {name.strip(" `") for names in rows for name in names.split(",")}
    assert listed == CONTROLLERS.keys()
