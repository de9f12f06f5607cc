"""Tables in Markdown, from frames of runs too: a line per combination of labels."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

# Mean Euclidean errors of a field experiment by part of the path and body [m]: the time-based
# linear MPC with the robust action of Kayacan, Ramon, Saeys (2016), "Robust Trajectory Tracking
# Error Model-Based Predictive Control for Unmanned Ground Vehicles", section V.
PUBLISHED_M: Final = {
    ("straight", "tractor"): 0.2349,
    ("straight", "trailer"): 0.2121,
    ("curve", "tractor"): 0.3982,
    ("curve", "trailer"): 0.3621,
}
PUBLISHED_NMPC_M: Final = (0.0644, 0.0361, 0.4978, 0.4152)
"""The same of a space-based nonlinear MPC of the same vehicle, quoted there in section V from
Kayacan, Kayacan, Ramon, Saeys (2015), IEEE Transactions on Control Systems Technology 23(1), in the
order of `COLUMNS`."""

COLUMNS: Final = tuple(f"{body} {where}" for where, body in PUBLISHED_M)
"""Labels of these numbers."""

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
    """Return numbers [m], such as errors of tractor and trailer, beside each other [cm]."""
    return " / ".join(f"{100.0 * value:.1f}" for value in values)
