"""Rows of a sweep: one flat JSON object per run, with the same columns in every row.

The columns follow from `Summary`: a number added there becomes a column here. Text is "" where
there is none, never null; numbers are null where there are none.
"""

import json
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Final, Literal

from ...results.summary import Status, Summary

Value = str | float | int | bool | None
Row = dict[str, Value]
RowStatus = Status | Literal["failed", "crashed"]

_IDENTITY: Final = ("run_id", "scenario", "controller", "seed", "status", "failure", "log")
_LEADING: Final = ("run", "point", "run_id", "scenario", "controller", "seed")
_TRAILING: Final = ("wall_s", "attempts", "log", "code")


def _figures(table: type, prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of all numbers in a dataclass of dataclasses, in order."""
    hints = typing.get_type_hints(table)
    for field in fields(table):
        hint = hints[field.name]
        name = f"{prefix}{field.name}"
        parts = (hint, *typing.get_args(hint))
        below = [part for part in parts if is_dataclass(part)]
        if below:
            yield from _figures(typing.cast(type, below[0]), f"{name}.")
        elif any(part in (float, int) for part in parts) and name not in _IDENTITY:
            yield name


FIGURES: Final = tuple(_figures(Summary))
"""The columns of the numbers of a summary, from `duration_s` on."""


def columns(axes: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all columns of a study that varies these keys, in order."""
    own = [key for key in axes if key not in _LEADING]
    return (*_LEADING, *own, "status", "failure", *FIGURES, *_TRAILING)


def figures(summary: Summary) -> dict[str, float | None]:
    """Return the numbers of a summary by their dotted names."""
    result: dict[str, float | None] = {}
    for name in FIGURES:
        value: Any = summary
        for part in name.split("."):
            value = getattr(value, part) if value is not None else None
        result[name] = None if value is None else float(value)
    return result


def no_figures() -> dict[str, float | None]:
    """Return the columns of a run without a summary: every number is None."""
    return dict.fromkeys(FIGURES)


def line(row: Row) -> str:
    """Return a row as a line of `results.jsonl`.

    Raises:
        ValueError: a number is not finite.
    """
    return json.dumps(row, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"


def working_error(row: Mapping[str, Value], figure: str = "cross_p95_m") -> float | None:
    """Return an error of the working point [m]; None: the row has none.

    The working point is the tool point where there is an implement, else the trailer's axle point.

    Args:
        row: of the run.
        figure: name in `ErrorStatistics`; default: 95th percentile of the cross-track error.
    """
    tool, trailer = (row.get(f"tracking.all.{point}.{figure}") for point in ("tool", "trailer"))
    error = trailer if tool is None else tool
    return error if isinstance(error, int | float) else None


def has_failed(row: Mapping[str, Value], limit_m: float | None = None) -> bool:
    """Return whether a run failed: it did not complete, or its error exceeds the limit.

    Args:
        row: of the run.
        limit_m: on `working_error` [m], which judges no run without that figure; None: no limit.
    """
    error = working_error(row)
    beyond = limit_m is not None and error is not None and error > limit_m
    return row["status"] != "completed" or beyond


def mostly_fails(failed: int, runs: int) -> bool:
    """Return whether at least half of the runs fail, which counts as failing at a value."""
    return 2 * failed >= runs
