"""Pages with generated blocks: `<!-- table: NAME -->` to `<!-- end -->`."""

import re
from pathlib import Path
from typing import Final

from ..errors import InvalidPage

ROOT: Final = Path(__file__).resolve().parents[2]  # root of the checkout
_BLOCK: Final = re.compile(r"(?<=<!-- table: )([\w-]+)( -->\n)(.*?)(?=<!-- end -->)", re.DOTALL)


def blocks(text: str) -> dict[str, str]:
    """Return the blocks of a page by the name of their table.

    Raises:
        InvalidPage: a name stands twice, or a marker has no counterpart.
    """
    found = [(match[1], match[3]) for match in _BLOCK.finditer(text)]
    names = [name for name, _ in found]
    if len(set(names)) < len(names):
        raise InvalidPage(f"two blocks have one name: {', '.join(sorted(names))}")
    if not len(names) == text.count("<!-- table: ") == text.count("<!-- end -->"):
        raise InvalidPage("a marker `<!-- table: NAME -->` or `<!-- end -->` has no counterpart")
    return dict(found)


def with_block(text: str, name: str, block: str) -> str:
    """Return a page with the content of one block replaced."""

    def replaced(match: re.Match[str]) -> str:
        return f"{match[1]}{match[2]}\n{block.strip()}\n\n" if match[1] == name else match[0]

    return _BLOCK.sub(replaced, text)


def pages_of_tables(root: Path = ROOT) -> dict[str, str]:
    """Return the page of every table by its name, relative to `root`.

    Raises:
        InvalidPage: markers of a page are invalid, or a table stands on two pages.
    """
    found: dict[str, str] = {}
    for file in (root / "README.md", *sorted((root / "docs").rglob("*.md"))):
        page = file.relative_to(root).as_posix()
        try:
            names = blocks(file.read_text(encoding="utf-8"))
        except InvalidPage as error:
            raise InvalidPage(f"{page}: {error}") from None
        if twice := names.keys() & found.keys():
            raise InvalidPage(f"{page}: {min(twice)} stands in {found[min(twice)]}, too")
        found |= dict.fromkeys(names, page)
    return found


def read_page(page: str, out: Path) -> str:
    """Return the text of a page in `out`, or in the checkout if it is not there yet."""
    file = out / page if (out / page).is_file() else ROOT / page
    return file.read_text(encoding="utf-8")
