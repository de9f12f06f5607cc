"""Failure of runs: the rule that the sweep report and the envelope share."""

from __future__ import annotations

from typing import Final

from ..results.tracking_errors import START_UP_S
from .row import Row

ERROR: Final = "tracking.all.trailer.cross_p95_m"
"""The column that a limit applies to: the trailer's 95 % cross-track error [m]."""


def has_failed(row: Row, limit_m: float | None = None) -> bool:
    """Return whether a run failed.

    A run that did not complete has failed. A completed run has failed only if its error exceeds
    the limit: without an error figure the limit does not judge it.

    Args:
        row: of the run.
        limit_m: on the error [m]; None: every completed run holds.
    """
    if row["status"] != "completed":
        return True
    error = row[ERROR]
    return limit_m is not None and isinstance(error, int | float) and error > limit_m


def is_unmeasured(row: Row) -> bool:
    """Return whether a run completed without an error figure: it lasted less than `START_UP_S`."""
    return row["status"] == "completed" and row[ERROR] is None


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
