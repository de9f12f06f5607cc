"""Tables in Markdown, from frames of runs too: a line per combination of labels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from .published import COLUMNS, PUBLISHED_M

ERRORS: Final = tuple(f"tracking.{where}.{body}.mean_euclidean_m" for where, body in PUBLISHED_M)
"""Columns of the four mean errors of the paper's table, in the order of `COLUMNS`."""

Cell = Callable[[pd.DataFrame], str]
"""Text of a cell from the rows of its line."""


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a table with one row of cells per line."""
    rows = (f"| {' | '.join(cells)} |" for cells in (heads, *lines))
    return "\n".join([next(rows), "|---" * len(heads) + "|", *rows])


def groups(frame: pd.DataFrame, by: Sequence[str]) -> Iterator[pd.DataFrame]:
    """Yield the rows of each combination of labels, in the order of first appearance."""
    for _, group in frame.groupby([*by], sort=False, dropna=False):
        yield group


def grouped(frame: pd.DataFrame, by: Sequence[str], cells: Mapping[str, Cell]) -> str:
    """Return a table with one line per combination of labels, and cells by the heads of columns."""
    lines = ([cell(group) for cell in cells.values()] for group in groups(frame, by))
    return markdown([*cells], lines)


def numbers(frame: pd.DataFrame, *columns: str) -> FloatArray:
    """Return a column as an array, (n,), or several, (n, columns); NaN where there is no number."""
    values = frame[[*columns]].to_numpy(dtype=float, na_value=math.nan)
    return values[:, 0] if len(columns) == 1 else values


def label(column: str, form: str = "{}") -> Cell:
    """Return the cell of a label that all rows of a line share."""
    return lambda group: form.format(group[column].iloc[0])


def mean(column: str, form: str = ".2f", factor: float = 100.0) -> Cell:
    """Return the cell of a mean over the rows of a line; nan where a row has no number."""
    return lambda group: format(factor * float(np.mean(numbers(group, column))), form)


def mean_errors(form: str = ".2f") -> dict[str, Cell]:
    """Return the four columns of the paper's table: mean Euclidean errors [cm]."""
    return {head: mean(name, form=form) for head, name in zip(COLUMNS, ERRORS, strict=True)}


def lost(group: pd.DataFrame) -> str:
    """Return the cell of the number of runs that did not complete, of all."""
    return f"{(group['status'] != 'completed').sum()}/{len(group)}"


def slash(values: Iterable[float]) -> str:
    """Return numbers, such as those of tractor and trailer [m], beside each other [cm]."""
    return " / ".join(f"{100.0 * value:.1f}" for value in values)


def fenced(lines: Iterable[str]) -> str:
    """Return lines as a block of plain text."""
    return "\n".join(["```text", *lines, "```"])
