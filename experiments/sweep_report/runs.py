"""The rows of a sweep as columns: what a report asks of them, and no more."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..errors import InvalidRows
from ..sweep.results import rows
from ..sweep.row import Row, Value
from ..sweep.study import DrawnAxis, ListAxis, Study, load_study

ERROR: Final = "tracking.all.trailer.cross_p95_m"
COST: Final = "timing.control_step_us.median"
_KEPT: Final = ("run", "point", "run_id", "scenario", "controller", "seed", "status", "failure")
_NUMBERS: Final = (ERROR, COST)
_FORMAT: Final = "is no row of this study, as `ttempc sweep` writes them"


@dataclass(frozen=True)
class Runs:
    """The runs of a sweep so far, in the order of their numbers.

    Args:
        name: of the study.
        study: what was to be driven.
        origin: what it was begun with, the content of `versions.json`.
        rows: with the columns that a report asks for.
        limit_m: a run fails above this 95 % cross-track error of the trailer; None: only where it
            did not complete.
    """

    name: str
    study: Study
    origin: dict[str, Any]
    rows: Sequence[Row]
    limit_m: float | None = None

    @property
    def planned(self) -> int:
        """Return the number of runs in the plan."""
        return int(self.origin["runs"])

    @property
    def missing(self) -> int:
        """Return how many runs of the plan have no row yet."""
        return self.planned - len(self.rows)

    @cached_property
    def controllers(self) -> tuple[str, ...]:
        """Return who drove, in the order of the plan."""
        there = dict.fromkeys(str(row["controller"]) for row in self.rows)
        named = [axis for axis in self.study.axis if "controller" in axis.names]
        planned = named[0].values if named and isinstance(named[0], ListAxis) else ()
        return tuple(dict.fromkeys([*(name for name in planned if name in there), *there]))

    @cached_property
    def run(self) -> NDArray[np.intp]:
        """Return the number of each run, (n,)."""
        return np.array([row["run"] for row in self.rows], dtype=np.intp)

    @cached_property
    def driver(self) -> NDArray[np.intp]:
        """Return the place of each run's controller in `controllers`, (n,)."""
        place = {name: number for number, name in enumerate(self.controllers)}
        return np.array([place[str(row["controller"])] for row in self.rows], dtype=np.intp)

    @cached_property
    def pair(self) -> NDArray[np.intp]:
        """Return a number that runs with the same point and seed share, (n,)."""
        keys = [[row["point"], row["seed"]] for row in self.rows]
        return np.unique(np.array(keys, dtype=np.intp), axis=0, return_inverse=True)[1].ravel()

    @property
    def by_point(self) -> bool:
        """Return whether points were drawn at random, so that they are what is drawn anew."""
        return any(isinstance(axis, DrawnAxis) for axis in self.study.axis)

    @cached_property
    def unit(self) -> NDArray[np.intp]:
        """Return what was drawn at random, (n,): the point where any is, else the seed."""
        name = "point" if self.by_point else "seed"
        return np.array([row[name] for row in self.rows], dtype=np.intp)

    @cached_property
    def completed(self) -> NDArray[np.bool_]:
        """Return whether each run drove to its end, (n,)."""
        return np.array([row["status"] == "completed" for row in self.rows], dtype=bool)

    @cached_property
    def error_cm(self) -> FloatArray:
        """Return each run's 95 % cross-track error of the trailer, (n,); NaN if not completed."""
        return np.where(self.completed, 100.0 * self._numbers(ERROR), np.nan)

    @cached_property
    def step_us(self) -> FloatArray:
        """Return each run's median cost of a control step, (n,); NaN where there is none."""
        return self._numbers(COST)

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Return whether each run failed, (n,)."""
        limit_cm = math.inf if self.limit_m is None else 100.0 * self.limit_m
        return ~self.completed | (self.error_cm > limit_cm)

    def _numbers(self, name: str) -> FloatArray:
        return np.array([row[name] for row in self.rows], dtype=float)  # None becomes NaN


def read_runs(folder: Path, limit_m: float | None = None) -> Runs:
    """Return the runs that a sweep has made in a folder, one that is still at work included.

    Raises:
        InvalidRows: the folder holds no sweep, no row yet, or rows of something else.
        InvalidStudy: its study cannot be read.
    """
    file = folder / "results.jsonl"
    for needed in (folder / "study.toml", folder / "versions.json", file):
        if not needed.is_file():
            raise InvalidRows(f"{folder}: is no folder of a sweep, it has no {needed.name}")
    _, study = load_study(str(folder / "study.toml"))
    origin = _origin(folder / "versions.json")
    names = (*_KEPT, *(name for name in study.names if name not in _KEPT), "log", *_NUMBERS)
    found: dict[int, Row] = {}
    content = rows(file)
    for number in range(1, origin["runs"] + 2):
        try:
            row = next(content)
        except StopIteration:
            break
        except ValueError:
            raise InvalidRows(f"{file}: line {number} {_FORMAT}") from None
        reason = _reason(row, names, origin["runs"])
        if reason or row["run"] in found:
            reason = reason or f"run {row['run']} is there twice"
            raise InvalidRows(f"{file}: line {number} {_FORMAT}: {reason}")
        found[_whole(row["run"])] = {name: row[name] for name in names}
    if not found:
        raise InvalidRows(f"{file}: holds no row yet")
    ordered = [found[run] for run in sorted(found)]
    return Runs(folder.resolve().name.removeprefix("sweep-"), study, origin, ordered, limit_m)


def _origin(file: Path) -> dict[str, Any]:
    """Return what a sweep was begun with."""
    try:
        origin = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(origin["runs"], int) and isinstance(origin["versions"], dict):
            return origin
    except (OSError, ValueError, KeyError, TypeError):
        pass
    raise InvalidRows(f"{file}: is not what `ttempc sweep` writes")


def _reason(row: Row, names: Sequence[str], planned: int) -> str:
    """Return why a row is none of the study, "" where it is one."""
    if not isinstance(row, dict):
        return "is no object"
    if missing := [name for name in names if name not in row]:
        return f"column {missing[0]} is missing"
    for name in ("run", "point", "seed"):
        if type(row[name]) is not int:
            return f"{name} is no whole number: {row[name]!r}"
    if not 0 <= _whole(row["run"]) < planned:
        return f"run {row['run']} of {planned}"
    for name in _NUMBERS:
        if not isinstance(row[name], int | float | None):
            return f"{name} is no number: {row[name]!r}"
    return ""


def _whole(value: Value) -> int:
    assert isinstance(value, int)
    return value
