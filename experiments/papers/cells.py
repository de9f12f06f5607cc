"""Tables of frames of runs: one line per combination of labels, one function per column."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ..results.published import COLUMNS, PUBLISHED_M
from .tables import markdown

Cell = Callable[[pd.DataFrame], str]
"""Text of a cell from the rows of its line."""

POINTS: Final = tuple(f"tracking.all.{body}.mean_euclidean_m" for body in ("tractor", "trailer"))
"""Columns of the mean Euclidean errors of both axle points."""


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
    lines = ([cell(group) for cell in cells.values()] for group in groups(frame, by))
    return markdown([*cells], lines)


def numbers(frame: pd.DataFrame, *columns: str) -> FloatArray:
    """Return a column as an array, (n,), or several, (n, columns); NaN where there is no number."""
    values = frame[[*columns]].to_numpy(dtype=float, na_value=math.nan)
    return values[:, 0] if len(columns) == 1 else values


def label(column: str, form: str = "{}") -> Cell:
    """Return the cell of a label that all rows of a line share."""
    return lambda group: form.format(group[column].iloc[0])


def mean(*columns: str, form: str = ".2f", factor: float = 100.0) -> Cell:
    """Return the cell of a mean over the rows of a line; nan where a row has no number."""
    return lambda group: format(factor * float(np.mean(numbers(group, *columns))), form)


def mean_errors(form: str = ".2f") -> dict[str, Cell]:
    """Return the four columns of the paper's table: mean Euclidean errors [cm]."""
    names = (f"tracking.{where}.{body}.mean_euclidean_m" for where, body in PUBLISHED_M)
    return {head: mean(name, form=form) for head, name in zip(COLUMNS, names, strict=True)}


def completed(group: pd.DataFrame) -> bool:
    """Return whether all runs completed."""
    return bool((group["status"] == "completed").all())


def lost(group: pd.DataFrame) -> str:
    """Return the cell of the number of runs that did not complete, of all."""
    return f"{(group['status'] != 'completed').sum()}/{len(group)}"


def slash(values: Iterable[float], form: str = ".1f", factor: float = 100.0) -> str:
    """Return numbers, such as those of tractor and trailer [m], beside each other [cm]."""
    return " / ".join(f"{factor * value:{form}}" for value in values)
