"""Settings of the documentation site, which `make docs` builds with Sphinx into dist/site."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import TYPE_CHECKING

from docutils.nodes import SkipNode, entry
from latex2mathml.converter import convert

if TYPE_CHECKING:
    from docutils.nodes import Element
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator

DOCS = Path(__file__).parent
LECTURES = ("tracking", "estimation", "tubes")
LONGEST_FIGURE = 32  # characters of a cell: a figure with its interval; longer ones are sentences
project = "ttempc"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
# index.rst includes the first one; programs that are no pages
exclude_patterns = ["start.md", "conf.py", "examples/**", "pictures/**", "lectures/grade.py"]
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}  # lectures are notebooks
nb_execution_timeout = 300  # of a cell [s]
nb_execution_raise_on_error = True
nb_execution_excludepatterns = ["*.md"]
html_theme = "furo"
html_title = "ttempc"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": False}
suppress_warnings = ["myst.header"]


def help_texts() -> str:
    """Return a page of what `--help` prints of every command."""
    from proving_ground.experiments.commands.cli import _COMMANDS, main

    blocks = ["# Commands"]
    for name in _COMMANDS:
        output = io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
            main([name, "--help"])
        blocks.append(f"## {name}\n\n```text\n{output.getvalue()}```")
    return "\n\n".join(blocks) + "\n"


def write_pages(app: Sphinx) -> None:
    """Write the pages of commands, keys and public names, which follow from the code."""
    from proving_ground.experiments.scenario.schema import scenario_reference

    folder = DOCS / "generated"
    folder.mkdir(exist_ok=True)
    (folder / "commands.md").write_text(help_texts())
    (folder / "keys.md").write_text(scenario_reference())
    for name in ("ttempc", "ttempc.tube", "proving_ground"):
        text = f"{name}\n{'=' * len(name)}\n\n.. automodule:: {name}\n   :members:\n"
        (folder / f"{name}.rst").write_text(text)


def link_to_text(app: Sphinx, docname: str, source: list[str]) -> None:
    """Turn links to files that the site does not hold into their text."""
    page = (DOCS / docname).parent

    def known(found: re.Match[str]) -> str:
        target = found[2].partition("#")[0]
        if not target or re.match(r"[a-z]+:", target):
            return found[0]
        file = (page / target).resolve()
        is_page = file.suffix != ".py" or file.stem in LECTURES
        return found[0] if file.is_relative_to(DOCS) and is_page else found[1]

    source[0] = re.sub(r"(?<!!)\[([^\]\[]+)\]\(([^)\s]+)\)", known, source[0])


def read_include(app: Sphinx, path: Path, docname: str, content: list[str]) -> None:
    """Do the same for an included page."""
    link_to_text(app, docname, content)


def mark_figures(app: Sphinx, doctree: Element, docname: str) -> None:
    """Mark the cells of tables that begin with a number, which `site.css` keeps on one line."""
    for cell in doctree.findall(entry):
        if re.match(r"[-−–+<]? ?\d", cell.astext()) and len(cell.astext()) < LONGEST_FIGURE:
            cell["classes"].append("figure")


def plain_docstring(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    """Turn code spans of Markdown, in which the docstrings are written, into those of RST."""
    lines[:] = [re.sub(r"`([^`]+)`", r"``\1``", line).replace("|", r"\|") for line in lines]


def visit_inline(self: HTML5Translator, node: Element) -> None:
    """Write MathML, which browsers draw without a script."""
    self.body.append(convert(node.astext()))
    raise SkipNode


def visit_block(self: HTML5Translator, node: Element) -> None:
    """Write MathML as a block."""
    self.body.append(convert(node.astext(), display="block"))
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Register what Sphinx calls."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("builder-inited", write_pages)
    app.connect("source-read", link_to_text)
    app.connect("doctree-resolved", mark_figures)
    app.connect("autodoc-process-docstring", plain_docstring, priority=900)  # after napoleon
    app.connect("include-read", read_include)
