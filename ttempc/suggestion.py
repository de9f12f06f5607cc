"""Suggestion of a name for a misspelt one."""

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return the end of a message, ` (did you mean NAME?)`; it is empty where no name is close.

    Examples:
        >>> did_you_mean("gras", ["pavement", "grass"])
        ' (did you mean grass?)'
        >>> did_you_mean("moon", ["pavement", "grass"])
        ''
    """
    close = get_close_matches(word, list(names), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
