"""Tables in Markdown from frames of runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ..results.published import COLUMNS, PUBLISHED_M

Cell = Callable[[pd.DataFrame], str]
"""Text of a cell from the rows of its line."""

ERRORS: Final = tuple(f"tracking.{where}.{body}.mean_euclidean_m" for where, body in PUBLISHED_M)
"""Columns of the four mean errors of the paper's table, in the order of `COLUMNS`."""


def table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    rule = "|---" * len(heads) + "|"
    return "\n".join([_line(heads), rule, *map(_line, lines)])


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def groups(frame: pd.DataFrame, by: Sequence[str]) -> Iterator[pd.DataFrame]:
    """Yield the rows of each combination of labels, in the order of first appearance."""
    for _, group in frame.groupby([*by], sort=False, dropna=False):
        yield group


def grouped(frame: pd.DataFrame, by: Sequence[str], cells: Mapping[str, Cell]) -> str:
    """Return a table with one line per combination of labels.

    Args:
        frame: of all runs.
        by: columns whose values a line has in common.
        cells: of a line, by the head of their column.
    """
    return table(
        [*cells], [[cell(group) for cell in cells.values()] for group in groups(frame, by)]
    )


def numbers(frame: pd.DataFrame, column: str) -> FloatArray:
    """Return a column as an array, (n,); NaN where there is no number."""
    return frame[column].to_numpy(dtype=float, na_value=math.nan)


def label(column: str, spec: str = "{}") -> Cell:
    """Return the cell of a label that all rows of a line share."""
    return lambda group: spec.format(group[column].iloc[0])


def mean(column: str, spec: str = ".1f", factor: float = 1.0) -> Cell:
    """Return the cell of a mean over the rows of a line; nan where a row has no number."""
    return lambda group: format(factor * float(np.mean(numbers(group, column))), spec)


def mean_errors(spec: str = ".2f") -> dict[str, Cell]:
    """Return the four columns of the paper's table: mean Euclidean errors [cm]."""
    pairs = zip(COLUMNS, ERRORS, strict=True)
    return {head: mean(column, spec, 100.0) for head, column in pairs}


def lost(group: pd.DataFrame) -> str:
    """Return the cell of the number of runs that did not complete, of all."""
    return f"{(group['status'] != 'completed').sum()}/{len(group)}"


def code(text: Any) -> str:  # noqa: ANN401
    """Return a name in code type."""
    return f"`{text}`"
