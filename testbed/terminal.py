"""Text of strangers on a terminal."""

import re
from typing import Final

_MOST_WORD: Final = 300
_MOST_LINE: Final = 2000
_LONG: Final = re.compile(rf"(\S{{{_MOST_WORD}}})\S+")


def one_line(text: str) -> str:
    """Return text as one line that a terminal shows and does not obey.

    Control characters, line breaks among them, are escaped, as are direction marks and other
    letters without a shape; words beyond 300 characters and the line beyond 2000 are cut.
    """
    text = _LONG.sub(r"\1…", text[: 4 * _MOST_LINE])
    text = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text)
    return text if len(text) <= _MOST_LINE else f"{text[:_MOST_LINE]}…"
