"""Pages of the documentation site that are made from other files, and links to files outside docs.

MkDocs calls the functions by their names (`hooks` in mkdocs.yml).
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[2]

COPIES: Final = {
    "README.md": "overview.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
"""Pages of the site by the file in the project's root that they copy."""

_LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)#])")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the copies, the scenario reference and the pages of the public names."""
    from mkdocs.structure.files import File

    pages = {copy: (ROOT / source).read_text() for source, copy in COPIES.items()}
    from proving_ground.experiments.scenario.schema import scenario_reference

    pages["scenario-reference.md"] = scenario_reference()
    pages |= _api_pages()
    shim = Path(__file__).with_name("iframe-worker.js")
    pages[f"assets/{shim.name}"] = shim.read_text()
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links between docs and the project's root into links inside the site.

    A link to a file that the site does not hold, such as a source file, becomes its path as text.
    """
    path = page.file.src_uri
    source = next((file for file, copy in COPIES.items() if copy == path), f"docs/{path}")
    folder, own = posixpath.dirname(source), posixpath.dirname(path)

    def target(found: re.Match[str]) -> str:
        link = found[1]
        if re.match(r"[a-z]+:", link):
            return link
        place = posixpath.normpath(posixpath.join(folder, link))  # from the project's root
        in_site = COPIES.get(place, place.removeprefix("docs/"))
        if files.get_file_from_path(in_site):
            return posixpath.relpath(in_site, own or ".")
        return link

    linked = _LINK.sub(target, markdown)
    return re.sub(r"\[([^\]\[]+)\]\(([^)\s]+)\)", lambda found: _text(found, own, files), linked)


def _text(found: re.Match[str], folder: str, files: Files) -> str:
    """Return a link as it stands, or its text where its file is not in the site."""
    file = found[2].partition("#")[0]
    if not file or re.match(r"[a-z]+:", file):
        return found[0]
    known = files.get_file_from_path(posixpath.normpath(posixpath.join(folder, file)))
    return found[0] if known else found[1]


def _api_pages() -> dict[str, str]:
    """Return a page for the public names of each package."""
    import proving_ground
    import ttempc
    import ttempc.tube

    packages = {
        "api/ttempc.md": (ttempc, "The control library: reference, estimation, control."),
        "api/tube.md": (ttempc.tube, "Tubes of linear systems given as arrays."),
        "api/proving-ground.md": (proving_ground, "Scenarios and runs from Python."),
    }
    return {
        path: "\n\n".join(
            [
                f"# `{package.__name__}`",
                about,
                *(f"::: {package.__name__}.{name}" for name in package.__all__),
            ]
        )
        + "\n"
        for path, (package, about) in packages.items()
    }
