"""Rows of a sweep as a frame of what a report shows, and estimates over groups of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ..errors import InvalidRows
from ..results.statistics import (
    IntervalEstimate,
    Statistic,
    bootstrap,
    cvar95,
    mean,
    proportion,
    quantile95,
)
from ..results.summary import ACTUATOR_USE
from ..sweep.results import FILE, WORKING_P95, WORKING_SD, frame, rows
from ..sweep.row import Row, Value
from ..sweep.study import Axis, DrawnAxis, ListAxis, Study, load_study
from .format import format_value

_COST: Final = "timing.control_step_us.median"
_TRACTOR: Final = "tracking.all.tractor.cross_p95_m"
_OF_WORKING_POINT: Final = tuple(
    column.replace("working", f"tracking.all.{point}")
    for column in (WORKING_P95, WORKING_SD)
    for point in ("trailer", "tool")
)
_TEXTS: Final = ("run_id", "scenario", "controller", "status", "failure", "log")
_WHOLE: Final = ("run", "point", "seed")
_NUMBERS: Final = (*_OF_WORKING_POINT, _TRACTOR, _COST, *(name for _, name, _ in ACTUATOR_USE))

_UNITS: Final = {
    "kpa": "kPa",
    "mps": "m/s",
    "radps": "rad/s",
    "hz": "Hz",
    **{unit: unit for unit in ("rad", "deg", "kg", "m", "s")},
}
_CAPITALS: Final = ("iso", "gnss", "imu")
_BINS: Final = 6
_MOST_VALUES: Final = 16  # more are binned
_WIDE: Final = 12.0  # largest over smallest value from which an axis is logarithmic


@dataclass(frozen=True)
class Scale:
    """An axis of a study. `label` is the column of the frame with the index of each run's value."""

    label: str
    texts: tuple[str, ...]  # of its k values or bins
    positions: FloatArray  # of the values on a chart, (k,)
    numeric: bool
    logarithmic: bool
    binned: bool


@dataclass(frozen=True)
class Sweep:
    """Finished runs of a sweep.

    `rows` has one row a run by increasing number, with the columns of `results.jsonl` that a report
    shows, a column per scale, and: `controller` as ordered category; `failed`; of completed runs
    `error_cm`, `sd_cm` of the working point and `tractor_cm`, NaN elsewhere, all across the track;
    `step_us`; `unit`, the independent unit: the drawn point, or else the seed.
    """

    name: str
    study: Study
    origin: Mapping[str, Any]  # content of `versions.json`
    rows: pd.DataFrame
    scales: tuple[Scale, ...]
    controllers: tuple[str, ...]  # in the order of the plan
    point: str  # whose error is shown: tool, trailer, or working point for both
    refused: int  # runs left out because a scenario or a controller refuses them
    limit_m: float | None = None  # on the error, see `has_failed`

    @property
    def planned(self) -> int:
        """Return the number of runs to drive."""
        return int(self.origin["runs"]) - self.refused

    @property
    def missing(self) -> int:
        """Return the number of runs to drive that have no row yet."""
        return self.planned - len(self.rows)

    @property
    def units(self) -> str:
        """Return what the independent units are called."""
        return "points" if _by_point(self.study) else "seeds"

    @property
    def unmeasured(self) -> int:
        """Return the number of runs that completed without an error figure."""
        return int((self.rows["status"].eq("completed") & self.rows["error_cm"].isna()).sum())


def read_sweep(folder: Path, limit_m: float | None = None) -> Sweep:
    """Return the finished runs in the folder of a sweep, also of one in progress.

    Args:
        folder: of the sweep.
        limit_m: on the 95 % cross-track error of the working point [m].

    Raises:
        InvalidRows: the folder has no sweep, no row yet, or rows of another study.
        InvalidStudy: its study cannot be read.
    """
    file = folder / FILE
    for needed in (folder / "study.toml", folder / "versions.json", file):
        if not needed.is_file():
            raise InvalidRows(f"{folder}: is no folder of a sweep, it has no {needed.name}")
    _, study = load_study(str(folder / "study.toml"))
    origin = _origin(folder / "versions.json")
    table = frame(_checked(file, study, origin["runs"]))
    if not len(table):
        raise InvalidRows(f"{file}: holds no row yet")
    completed = table["status"].eq("completed")
    present = dict.fromkeys(table["controller"])
    listed = (axis for axis in study.axis if "controller" in axis.names)
    planned = [value for axis in listed if isinstance(axis, ListAxis) for value in axis.values]
    order = dict.fromkeys([*(name for name in planned if name in present), *present])
    too_far = False if limit_m is None else table[WORKING_P95] > limit_m
    more: dict[str, Any] = {
        "controller": pd.Categorical(table["controller"], [*order], ordered=True),
        "failed": ~completed | too_far,
        "error_cm": 100.0 * table[WORKING_P95].where(completed),
        "sd_cm": 100.0 * table[WORKING_SD].where(completed),
        "tractor_cm": 100.0 * table[_TRACTOR].where(completed),
        "step_us": table[_COST],
        "unit": table["point" if _by_point(study) else "seed"],
    }
    for head, name, factor in ACTUATOR_USE:
        more[head] = factor * table[name].where(completed)
    scales = []
    for scale, places in _scales(study, table):
        scales.append(scale)
        more[scale.label] = places
    name = str(origin.get("study") or folder.resolve().name.removeprefix("sweep-"))
    tool = table["tracking.all.tool.cross_p95_m"][more["error_cm"].notna()].notna()
    point = "trailer" if not tool.any() else "tool" if tool.all() else "working point"
    table, refused = table.assign(**more), int(origin.get("refused", 0))
    return Sweep(
        name, study, origin, table, tuple(scales), tuple(map(str, order)), point, refused, limit_m
    )


def groups(sweep: Sweep, by: Sequence[Scale] = ()) -> pd.DataFrame:
    """Return one row for each controller, at each combination of values that has runs.

    Columns: the labels of the scales, `controller`; `runs` and `failed`, arrays of run numbers;
    `rate`, the proportion of failed ones; `error`, the mean error [cm], None where no run
    has one.
    """

    def of(part: pd.DataFrame) -> dict[str, Any]:
        failed = part["failed"]
        return {
            "runs": part["run"].to_numpy(),
            "failed": part["run"][failed].to_numpy(),
            "rate": proportion(int(failed.sum()), len(part)),
            "error": average(part, "error_cm"),
        }

    return _each(sweep.rows, by, of)


def tails(sweep: Sweep) -> pd.DataFrame:
    """Return further estimates of each controller; None where no run has the figure.

    Columns: `quantile95` and `cvar95` of the errors [cm]; means of `sd_cm`, `tractor_cm`, `step_us`
    and the heads of `ACTUATOR_USE`.
    """
    shown = ("sd_cm", "tractor_cm", "step_us", *(head for head, _, _ in ACTUATOR_USE))

    def tail(part: pd.DataFrame, statistic: Statistic) -> IntervalEstimate | None:
        known = part[part["error_cm"].notna()]
        values, units = known["error_cm"].to_numpy(), known["unit"].to_numpy()
        return bootstrap(values, units, statistic) if len(known) else None

    def of(part: pd.DataFrame) -> dict[str, Any]:
        return {
            "quantile95": tail(part, quantile95),
            "cvar95": tail(part, cvar95),
            **{name: average(part, name) for name in shown},
        }

    return _each(sweep.rows, (), of)


def differences(sweep: Sweep, against: str, by: Sequence[Scale] = ()) -> pd.DataFrame:
    """Return the difference of every other controller to one, paired by point and seed.

    Columns: as `groups`, with `runs` that have a counterpart; `pairs`, the number of those in which
    both have an error; `error`, their mean difference [cm]; `alone`, `other`: numbers of runs of
    which it alone failed, or the counterpart alone.
    """
    rows = sweep.rows
    counterpart = rows[rows["controller"] == against][["point", "seed", "error_cm", "failed"]]
    pairs = rows[rows["controller"] != against].merge(
        counterpart, on=["point", "seed"], suffixes=("", "_other")
    )
    pairs["error_cm"] -= pairs["error_cm_other"]

    def of(part: pd.DataFrame) -> dict[str, Any]:
        failed, other = part["failed"], part["failed_other"]
        return {
            "runs": part["run"].to_numpy(),
            "pairs": int(part["error_cm"].notna().sum()),
            "error": average(part, "error_cm"),
            "alone": part["run"][failed & ~other].to_numpy(),
            "other": part["run"][~failed & other].to_numpy(),
        }

    return _each(pairs, by, of)


def ranking(sweep: Sweep) -> list[str]:
    """Return the controllers, that with the least error first.

    They are compared by the median error of their runs. A run that did not complete counts as
    worse than any other, so that no controller gains by the runs that it does not complete.
    """
    rows = sweep.rows
    error = rows["error_cm"].where(rows["status"].eq("completed"), np.inf)
    by = rows["controller"]
    order = pd.DataFrame(
        {
            # Without runs that are too short for an error.
            "median": error.groupby(by, observed=True).quantile(0.5, interpolation="higher"),
            "failed": rows["failed"].groupby(by, observed=True).mean(),
        }
    )
    order["median"] = order["median"].fillna(np.inf)
    return [*order.sort_values(["median", "failed"], kind="stable").index]


def average(part: pd.DataFrame, column: str) -> IntervalEstimate | None:
    """Return the mean of a column over the runs that have it, None if there is none."""
    known = part[part[column].notna()]
    return mean(known[column].to_numpy(), known["unit"].to_numpy()) if len(known) else None


def _each(
    rows: pd.DataFrame, by: Sequence[Scale], of: Callable[[pd.DataFrame], dict[str, Any]]
) -> pd.DataFrame:
    """Return what `of` makes of the runs of each controller at each combination of values."""
    keys = [*(scale.label for scale in by), "controller"]
    records = [
        dict(zip(keys, values, strict=True)) | of(part)
        for values, part in rows.groupby(keys, observed=True)
    ]
    return pd.DataFrame.from_records(records)


def _by_point(study: Study) -> bool:
    """Return whether points are drawn at random; they are then the independent units."""
    return any(isinstance(axis, DrawnAxis) for axis in study.axis)


def _scales(study: Study, table: pd.DataFrame) -> Iterator[tuple[Scale, Any]]:
    """Yield the axes except the controller, with the index of each run's value, (n,)."""
    axes = [
        axis
        for axis in study.axis
        if "controller" not in axis.names
        and not (isinstance(axis, ListAxis) and len(axis.values) == 1)
    ]
    labels = [_label(axis.names[0]) for axis in axes]
    for axis, label in zip(axes, labels, strict=True):
        yield _scale(axis, axis.label if labels.count(label) > 1 else label, table)


def _label(key: str) -> str:
    """Return the label of a key with the unit: `soil.cone_index_kpa` is "cone index [kPa]"."""
    *words, last = key.rpartition(".")[2].split("_")
    unit = f" [{_UNITS[last]}]" if words and last in _UNITS else ""
    words = words if unit else [*words, last]
    return " ".join(word.upper() if word in _CAPITALS else word for word in words) + unit


def _scale(axis: Axis, label: str, table: pd.DataFrame) -> tuple[Scale, Any]:
    entries = table[[*axis.names]].itertuples(index=False, name=None)
    values: list[Value] = [
        entry[0] if len(set(entry)) == 1 else ", ".join(map(format_value, entry))
        for entry in entries
    ]
    if not all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        listed = axis.values if isinstance(axis, ListAxis) and not axis.relative else ()
        order = [*dict.fromkeys([*(v for v in listed if v in values), *values])]
        texts = tuple(map(format_value, order))
        scale = Scale(label, texts, np.arange(len(order), dtype=float), False, False, False)
        return scale, [order.index(value) for value in values]
    numbers = pd.Series(values, index=table.index, dtype=float)
    places, distinct = pd.factorize(numbers, sort=True)
    if isinstance(axis, ListAxis):
        logarithmic = bool(distinct[0] > 0.0 and distinct[-1] >= _WIDE * distinct[0])
    else:
        spacing = getattr(axis, "spacing", "") + getattr(axis, "distribution", "")
        logarithmic = spacing.startswith("log")
    if not isinstance(axis, DrawnAxis) and len(distinct) <= _MOST_VALUES:
        texts = tuple(map(_short, distinct))
        if len(set(texts)) < len(texts):
            texts = tuple(f"{value:g}" for value in distinct)
        return Scale(label, texts, np.asarray(distinct), True, logarithmic, binned=False), places
    bins = places * min(_BINS, len(distinct)) // len(distinct)
    span = numbers.groupby(bins).agg(["min", "max", "median"])
    texts = tuple(
        f"{_short(a)} to {_short(b)}" for a, b in zip(span["min"], span["max"], strict=True)
    )
    return Scale(label, texts, span["median"].to_numpy(), True, logarithmic, binned=True), bins


def _short(number: float) -> str:
    return f"{number:.3g}" if abs(number) < 1000.0 else f"{number:.0f}"


def _origin(file: Path) -> dict[str, Any]:
    """Return the content of `versions.json`."""
    try:
        origin = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(origin["runs"], int) and isinstance(origin["versions"], dict):
            return origin
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    raise InvalidRows(f"{file}: is not what `ttempc sweep` writes")


def _checked(file: Path, study: Study, planned: int) -> Iterator[Row]:
    """Yield the shown columns of the rows of a file, each row checked."""
    names = dict.fromkeys((*_WHOLE, *_TEXTS, *study.names, *_NUMBERS))
    known: set[Value] = set()
    content = rows(file)
    for number in range(1, planned + 2):
        reason = ""
        try:
            row = next(content)
        except StopIteration:
            return
        except ValueError:
            row = None
        if not isinstance(row, dict):
            reason = "is no object"
        elif missing := [name for name in names if name not in row]:
            reason = f"column {missing[0]} is missing"
        elif wrong := [name for name in _WHOLE if type(row[name]) is not int]:
            reason = f"{wrong[0]} is no whole number: {row[wrong[0]]!r}"
        elif wrong := [name for name in _NUMBERS if not isinstance(row[name], int | float | None)]:
            reason = f"{wrong[0]} is no number: {row[wrong[0]]!r}"
        elif row["run"] not in range(planned):
            reason = f"run {row['run']} of {planned}"
        elif row["run"] in known:
            reason = f"run {row['run']} is there twice"
        if reason or row is None:
            raise InvalidRows(
                f"{file}: line {number} is no row of this study, as `ttempc sweep` writes them: "
                f"{reason}"
            )
        known.add(row["run"])
        yield {name: row[name] for name in names}
