"""Rows of a sweep as columns, limited to those that a report needs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..errors import InvalidRows
from ..results.summary import ACTUATOR_USE
from ..sweep.failure import ERROR, has_failed, is_unmeasured
from ..sweep.results import rows
from ..sweep.row import Row, Value
from ..sweep.study import DrawnAxis, ListAxis, Study, load_study

COST: Final = "timing.control_step_us.median"
_KEPT: Final = ("run", "point", "run_id", "scenario", "controller", "seed", "status", "failure")
_NUMBERS: Final = (ERROR, COST, *(name for _, name, _ in ACTUATOR_USE))
_FORMAT: Final = "is no row of this study, as `ttempc sweep` writes them"


@dataclass(frozen=True)
class Runs:
    """Finished runs of a sweep by increasing run number.

    Args:
        name: of the study.
        study: its content.
        origin: content of `versions.json`.
        rows: with the columns that a report needs.
        limit_m: on the trailer's 95 % cross-track error [m], see `has_failed`.
    """

    name: str
    study: Study
    origin: dict[str, Any]
    rows: Sequence[Row]
    limit_m: float | None = None

    @property
    def planned(self) -> int:
        """Return the number of runs to drive."""
        return int(self.origin["runs"]) - self.refused

    @property
    def refused(self) -> int:
        """Return the number of runs left out because a scenario or a controller refuses them."""
        return int(self.origin.get("refused", 0))

    @property
    def missing(self) -> int:
        """Return the number of runs to drive that have no row yet."""
        return self.planned - len(self.rows)

    @cached_property
    def controllers(self) -> tuple[str, ...]:
        """Return the names of the controllers in the order of the plan."""
        present = dict.fromkeys(str(row["controller"]) for row in self.rows)
        named = [axis for axis in self.study.axis if "controller" in axis.names]
        planned = named[0].values if named and isinstance(named[0], ListAxis) else ()
        return tuple(dict.fromkeys([*(name for name in planned if name in present), *present]))

    @cached_property
    def run(self) -> NDArray[np.intp]:
        """Return the number of each run, (n,)."""
        return np.array([row["run"] for row in self.rows], dtype=np.intp)

    @cached_property
    def controller_index(self) -> NDArray[np.intp]:
        """Return the index of each run's controller in `controllers`, (n,)."""
        place = {name: number for number, name in enumerate(self.controllers)}
        return np.array([place[str(row["controller"])] for row in self.rows], dtype=np.intp)

    @cached_property
    def pair(self) -> NDArray[np.intp]:
        """Return an index of point and seed, equal for runs to compare with each other, (n,)."""
        keys = [[row["point"], row["seed"]] for row in self.rows]
        return np.unique(np.array(keys, dtype=np.intp), axis=0, return_inverse=True)[1].ravel()

    @property
    def by_point(self) -> bool:
        """Return whether points were drawn at random; they are then the independent units."""
        return any(isinstance(axis, DrawnAxis) for axis in self.study.axis)

    @property
    def units(self) -> str:
        """Return what the independent units are called."""
        return "points" if self.by_point else "seeds"

    @property
    def unit_count(self) -> int:
        """Return the number of independent units."""
        return len(set(self.unit.tolist()))

    @cached_property
    def unit(self) -> NDArray[np.intp]:
        """Return the independent unit of each run, (n,): the drawn point, or else the seed."""
        name = "point" if self.by_point else "seed"
        return np.array([row[name] for row in self.rows], dtype=np.intp)

    @cached_property
    def completed(self) -> NDArray[np.bool_]:
        """Return whether each run completed, (n,)."""
        return np.array([row["status"] == "completed" for row in self.rows], dtype=bool)

    @cached_property
    def error_cm(self) -> FloatArray:
        """Return each run's 95 % cross-track error of the trailer, (n,) [cm].

        NaN where it did not complete, or lasted too short for an error figure.
        """
        return np.where(self.completed, 100.0 * self.numbers(ERROR), np.nan)

    @cached_property
    def step_us(self) -> FloatArray:
        """Return each run's median cost of a control step, (n,) [us]; NaN: none."""
        return self.numbers(COST)

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Return whether each run failed, (n,)."""
        return np.array([has_failed(row, self.limit_m) for row in self.rows], dtype=bool)

    @property
    def unmeasured(self) -> int:
        """Return the number of runs that completed without an error figure."""
        return sum(map(is_unmeasured, self.rows))

    def numbers(self, name: str) -> FloatArray:
        """Return a column of `results.jsonl` that a report needs, (n,); NaN: none."""
        return np.array([row[name] for row in self.rows], dtype=float)  # None becomes NaN


def read_sweep(folder: Path, limit_m: float | None = None) -> Runs:
    """Return the finished runs in the folder of a sweep, also of one in progress.

    Args:
        folder: of the sweep.
        limit_m: on the trailer's 95 % cross-track error [m].

    Raises:
        InvalidRows: the folder has no sweep, no row yet, or rows of another study.
        InvalidStudy: its study cannot be read.
    """
    file = folder / "results.jsonl"
    for needed in (folder / "study.toml", folder / "versions.json", file):
        if not needed.is_file():
            raise InvalidRows(f"{folder}: is no folder of a sweep, it has no {needed.name}")
    _, study = load_study(str(folder / "study.toml"))
    origin = _origin(folder / "versions.json")
    names = (*_KEPT, *(name for name in study.names if name not in _KEPT), "log", *_NUMBERS)
    by_run: dict[int, Row] = {}
    content = rows(file)
    for number in range(1, origin["runs"] + 2):
        try:
            row = next(content)
        except StopIteration:
            break
        except ValueError:
            raise InvalidRows(f"{file}: line {number} {_FORMAT}") from None
        reason = _reason(row, names, origin["runs"])
        if reason or row["run"] in by_run:
            reason = reason or f"run {row['run']} is there twice"
            raise InvalidRows(f"{file}: line {number} {_FORMAT}: {reason}")
        by_run[_whole(row["run"])] = {name: row[name] for name in names}
    if not by_run:
        raise InvalidRows(f"{file}: holds no row yet")
    ordered = [by_run[run] for run in sorted(by_run)]
    name = str(origin.get("study") or folder.resolve().name.removeprefix("sweep-"))
    return Runs(name, study, origin, ordered, limit_m)


def _origin(file: Path) -> dict[str, Any]:
    """Return the content of `versions.json`."""
    try:
        origin = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(origin["runs"], int) and isinstance(origin["versions"], dict):
            return origin
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    raise InvalidRows(f"{file}: is not what `ttempc sweep` writes")


def _reason(row: Row, names: Sequence[str], planned: int) -> str:
    """Return the reason why a row does not belong to the study, "" if it does."""
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
