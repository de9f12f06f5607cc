"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from ..results.published import PUBLISHED_M

ERRORS: Final = tuple(f"tracking.{where}.{body}.mean_euclidean_m" for where, body in PUBLISHED_M)
"""Columns of the four mean errors of the paper's table, in the order of `COLUMNS`."""


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table with one row of cells per line."""
    rule = "|---" * len(heads) + "|"
    return "\n".join([_row(heads), rule, *map(_row, lines)])


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
