"""Failure of runs: the rule that sweep report and search share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ..results.tracking_errors import START_UP_S
from .row import Value

ERROR: Final = "tracking.all.trailer.cross_p95_m"
_TOOL: Final = "tracking.all.tool.cross_p95_m"


def working_error(row: Mapping[str, Value]) -> float | None:
    """Return the 95 % cross-track error of the working point [m]; None: the row has none.

    The working point is the tool point where there is an implement, else the trailer's axle point.
    """
    error = row[ERROR] if row.get(_TOOL) is None else row[_TOOL]
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


def is_unmeasured(row: Mapping[str, Value]) -> bool:
    """Return whether a run completed without an error figure: it lasted less than `START_UP_S`."""
    return row["status"] == "completed" and working_error(row) is None


def unmeasured_text(count: int, limit_m: float | None = None) -> str:
    """Return a sentence on the completed runs without an error figure, "" where there are none."""
    if not count:
        return ""
    verb = "run has" if count == 1 else "runs have"
    scope = "" if limit_m is None else ", and the limit does not apply"
    return f"{count} completed {verb} no error figure (shorter than {START_UP_S:g} s){scope}."


def mostly_fails(failed: int, runs: int) -> bool:
    """Return whether at least half of the runs fail, which counts as failing at a value."""
    return 2 * failed >= runs
