"""Examples of README and the pages, run as they stand there.

A block whose first line is a comment with a file name is that file. Of the others, each line of a
bash block is a command of `ttempc`, a python block is run, and a text block is what the python
block above it prints. A page has one folder and one namespace.
"""

import contextlib
import io
import re
import shlex
import socket
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from proving_ground.experiments.commands import drive
from proving_ground.experiments.commands.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"# ([\w-]+\.\w+)\n")
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))
    if BLOCK.search(page.read_text())
]
EXPECTED_CODE = re.compile(r"(.*?)(?: \|\| test \$\? = (\d))?")


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    """Stand in an empty folder, from which modules are imported, and leave no module of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    plt.switch_backend("agg")
    yield
    plt.close("all")
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(tmp_path):
            del sys.modules[name]


def run_commands(code):
    for line in code.replace("\\\n", " ").splitlines():
        command, expected = EXPECTED_CODE.fullmatch(line).groups()
        program, *words = shlex.split(command)
        assert program == "ttempc"
        assert main(words) == int(expected or 0), line


def run_python(code, names):
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(compile(code, "<example>", "exec"), names)
    return output.getvalue()


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", text)]


def assert_same_text(output, expected):
    """Assert equal words and nearly equal numbers: another processor may round otherwise."""
    assert re.sub(r"[-\d.]+", "", output) == re.sub(r"[-\d.]+", "", expected)
    assert numbers(output) == pytest.approx(numbers(expected), abs=0.1)


@pytest.fixture
def free_port(monkeypatch):
    """A free UDP port in the place of the default one of `serve`, which may be taken."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        port = link.getsockname()[1]
    monkeypatch.setitem(drive._PORTS, "json", port)
    return str(port)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page, tmp_path, free_port):
    text = page.read_text().replace("8890", free_port)
    names = {"__name__": "__main__"}
    output = ""
    for language, code in BLOCK.findall(text):
        file = FILE.match(code)
        if file:
            (tmp_path / file[1]).write_text(code)
        elif language == "bash":
            run_commands(code)
        elif language == "python":
            output = run_python(code, names)
        else:
            assert language == "text", f"a block of {language} names no file"
            assert_same_text(output, code)
