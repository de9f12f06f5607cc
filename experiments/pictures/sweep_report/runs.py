"""Rows of a sweep as a frame of what a report shows, and estimates over groups of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from ttempc.types import FloatArray

from ...errors import InvalidRows
from ...results.statistics import IntervalEstimate, mean, proportion
from ...results.summary import ACTUATOR_USE, BEYOND, EUCLIDEAN, PARTS
from ...studies.sweep.folder import Origin, read_origin
from ...studies.sweep.results import FILE, WORKING_P95, WORKING_SD, frame, rows
from ...studies.sweep.row import Row
from ...studies.sweep.study import Axis, DrawnAxis, Study, load_study
from .format import format_value

_COST: Final = "timing.control_step_us.median"
_TRACTOR: Final = "tracking.all.tractor.cross_p95_m"
_WORKING: Final = [
    column.replace("working", f"tracking.all.{point}")
    for column in (WORKING_P95, WORKING_SD)
    for point in ("trailer", "tool")
]
_COLUMNS: Final = (*ACTUATOR_USE, *EUCLIDEAN, *PARTS, *BEYOND)
_TEXTS: Final = ("run_id", "scenario", "controller", "status", "failure", "log")
_NUMBERS: Final = (
    "point",
    "seed",
    *_WORKING,
    _TRACTOR,
    _COST,
    *(key for _, key, _ in _COLUMNS),
)

_FIGURES: Final = {  # column of a report -> column of the rows, factor
    "error_cm": (WORKING_P95, 100.0),
    "sd_cm": (WORKING_SD, 100.0),
    "tractor_cm": (_TRACTOR, 100.0),
    "step_us": (_COST, 1.0),
    **{head: (key, factor) for head, key, factor in _COLUMNS},
}

_UNITS: Final = {
    "kpa": "kPa",
    "mps": "m/s",
    "radps": "rad/s",
    "hz": "Hz",
    **{unit: unit for unit in ("rad", "deg", "kg", "m", "s")},
}
_CAPITALS: Final = ("iso", "gnss", "imu")
_BINS: Final = 6
_MOST_VALUES: Final = 16  # an axis with more values is binned
_WIDE: Final = 12.0  # largest over smallest value from which an axis is logarithmic


@dataclass(frozen=True)
class Scale:
    """An axis of a study."""

    label: str
    texts: tuple[str, ...]  # of its k values or bins
    positions: FloatArray  # of the values on a chart, (k,)
    numeric: bool = False
    logarithmic: bool = False
    binned: bool = False

    @property
    def column(self) -> str:
        """Return the column of the frame with the index of each run's value.

        The label alone may be a column of the rows, as `scenario` is.
        """
        return f"place on {self.label}"


@dataclass(frozen=True)
class Sweep:
    """Finished runs of a sweep.

    `rows` has one row a run by increasing number, with the columns of `results.jsonl` that a report
    shows, a column per scale, and: `controller` as ordered category; `failed`; of completed runs
    `error_cm`, `sd_cm` of the working point and `tractor_cm`, all across the track, `step_us` and
    the heads of `_COLUMNS`, NaN elsewhere; `unit`, the independent unit: the drawn point, or
    else the seed.
    """

    name: str
    study: Study
    origin: Origin
    rows: pd.DataFrame
    scales: tuple[Scale, ...]
    controllers: tuple[str, ...]  # in the order of the plan
    point: str  # whose error is shown: tool, trailer, or working point for both
    limit_m: float | None = None  # on the error, see `has_failed`

    @property
    def refused(self) -> int:
        """Return the number of runs left out because a scenario or a controller refuses them."""
        return self.origin.refused

    @property
    def planned(self) -> int:
        """Return the number of runs to drive."""
        return self.origin.runs - self.refused

    @property
    def missing(self) -> int:
        """Return the number of runs to drive that have no row yet."""
        return self.planned - len(self.rows)

    @property
    def units(self) -> str:
        """Name of the independent units."""
        return "seeds" if self.study.samples is None else "points"


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
    origin = read_origin(folder, InvalidRows)
    table = frame(_checked(file, study, origin.runs))
    if not len(table):
        raise InvalidRows(f"{file}: holds no row yet")

    # Controllers in the order of the study, then others
    completed = table["status"].eq("completed")
    listed = (axis for axis in study.axis if "controller" in axis.names)
    planned = [value for axis in listed for value in getattr(axis, "values", ())]
    present = table["controller"].unique()
    order = dict.fromkeys([*(name for name in planned if name in present), *present])

    too_far = False if limit_m is None else table[WORKING_P95] > limit_m
    scales = [*_scales(study, table)]
    table = table.assign(
        **{
            "controller": pd.Categorical(table["controller"], [*order], ordered=True),
            "failed": ~completed | too_far,
            "unit": table["seed" if study.samples is None else "point"],
            **{
                name: factor * table[key].where(completed)
                for name, (key, factor) in _FIGURES.items()
            },
            **{scale.column: places for scale, places in scales},
        }
    )

    name = origin.study or folder.resolve().name.removeprefix("sweep-")
    tool = table["tracking.all.tool.cross_p95_m"][table["error_cm"].notna()].notna()
    point = "trailer" if not tool.any() else "tool" if tool.all() else "working point"
    shown = tuple(scale for scale, _ in scales)
    return Sweep(name, study, origin, table, shown, tuple(map(str, order)), point, limit_m)


def groups(sweep: Sweep, by: Sequence[Scale] = ()) -> pd.DataFrame:
    """Return one row for each controller, at each combination of values that has runs.

    Columns: those of the scales, `controller`; `runs` and `failed`, their numbers; `rate`, the
    proportion of failed ones; means of the figures of `Sweep.rows`, None where no run has one.
    """

    def of(part: pd.DataFrame) -> dict[str, Any]:
        failed = int(part["failed"].sum())
        means = {name: _mean(part, name) for name in _FIGURES}
        return {"runs": len(part), "failed": failed, "rate": proportion(failed, len(part)), **means}

    return _each(sweep.rows, by, of)


def differences(sweep: Sweep, against: str) -> pd.DataFrame:
    """Return the difference of every other controller to one, paired by point and seed.

    Columns: `controller`; `runs` that have a counterpart; `pairs`, the number of those in which
    both have an error; `difference`, their mean difference [cm]; `alone`, `other`: numbers of runs
    of which it alone failed, or the counterpart alone.
    """
    rows = sweep.rows
    keys = ["point", "seed"]
    counterpart = rows[rows["controller"] == against][[*keys, "error_cm", "failed"]]
    pairs = rows[rows["controller"] != against].merge(counterpart, on=keys, suffixes=("", "_other"))
    pairs["error_cm"] -= pairs["error_cm_other"]

    def of(part: pd.DataFrame) -> dict[str, Any]:
        failed = part["failed"]
        other = part["failed_other"]
        return {
            "runs": len(part),
            "pairs": int(part["error_cm"].notna().sum()),
            "difference": _mean(part, "error_cm"),
            "alone": int((failed & ~other).sum()),
            "other": int((~failed & other).sum()),
        }

    return _each(pairs, (), of)


def best(sweep: Sweep) -> str:
    """Return the controller with the least median error of its runs.

    A run that did not complete counts as worse than any other, so that no controller gains by the
    runs that it does not complete.
    """
    rows = sweep.rows
    error = rows["error_cm"].where(rows["status"].eq("completed"), np.inf)
    medians = error.groupby(rows["controller"], observed=True).quantile(interpolation="higher")
    return str(medians.fillna(np.inf).idxmin())


def _mean(part: pd.DataFrame, column: str) -> IntervalEstimate | None:
    """Return the mean of a column over the runs that have it, None if there is none."""
    known = part[part[column].notna()]
    return mean(known[column].to_numpy(), known["unit"].to_numpy()) if len(known) else None


def _each(
    rows: pd.DataFrame, by: Sequence[Scale], of: Callable[[pd.DataFrame], dict[str, Any]]
) -> pd.DataFrame:
    """Return what `of` makes of the runs of each controller at each combination of values."""
    keys = [*(scale.column for scale in by), "controller"]
    records = [
        dict(zip(keys, values, strict=True)) | of(part)
        for values, part in rows.groupby(keys, observed=True)
    ]
    return pd.DataFrame.from_records(records)


def _scales(study: Study, table: pd.DataFrame) -> Iterator[tuple[Scale, Any]]:
    """Yield each axis with more than one value, and every run's index on it, (n,)."""
    axes = [axis for axis in study.axis if "controller" not in axis.names]
    labels = [_label(axis.names[0]) for axis in axes]
    for axis, label in zip(axes, labels, strict=True):
        scale, places = _scale(axis, axis.label if labels.count(label) > 1 else label, table)
        if len(scale.texts) > 1:
            yield scale, places


def _label(key: str) -> str:
    """Return the label of a key with the unit: `soil.cone_index_kpa` is "cone index [kPa]"."""
    *words, last = key.rpartition(".")[2].split("_")
    unit = f" [{_UNITS[last]}]" if words and last in _UNITS else ""
    words = words if unit else [*words, last]
    return " ".join(word.upper() if word in _CAPITALS else word for word in words) + unit


def _scale(axis: Axis, label: str, table: pd.DataFrame) -> tuple[Scale, Any]:
    values: list[Any] = [
        entry[0] if len(set(entry)) == 1 else ", ".join(map(format_value, entry))
        for entry in table[[*axis.names]].itertuples(index=False, name=None)
    ]
    if not all(type(value) in (int, float) for value in values):
        listed: Any = getattr(axis, "values", ())
        order = [*dict.fromkeys([*(value for value in listed if value in values), *values])]
        scale = Scale(label, tuple(map(format_value, order)), np.arange(float(len(order))))
        return scale, [order.index(value) for value in values]
    numbers = pd.Series(values, index=table.index, dtype=float)
    places, distinct = pd.factorize(numbers, sort=True)
    logarithmic = bool(distinct[0] > 0.0 and distinct[-1] >= _WIDE * distinct[0])
    if not isinstance(axis, DrawnAxis) and len(distinct) <= _MOST_VALUES:
        texts = tuple(f"{value:g}" for value in distinct)
        return Scale(label, texts, np.asarray(distinct), True, logarithmic), places
    bins = places * min(_BINS, len(distinct)) // len(distinct)
    span = numbers.groupby(bins).agg(["min", "max", "median"])
    texts = tuple(f"{a:.3g} to {b:.3g}" for a, b in zip(span["min"], span["max"], strict=True))
    return Scale(label, texts, span["median"].to_numpy(), True, logarithmic, binned=True), bins


def _checked(file: Path, study: Study, planned: int) -> Iterator[Row]:
    """Yield the shown columns of the rows of a file, each row checked."""
    names = dict.fromkeys(("run", *_TEXTS, *study.names, *_NUMBERS))
    known = set()
    try:
        for row in rows(file):
            shown = {name: row[name] for name in names}
            if row["run"] in known or row["run"] not in range(planned):
                raise ValueError(f"run {row['run']} of {planned}")
            if wrong := [key for key in _NUMBERS if not isinstance(row[key], int | float | None)]:
                raise ValueError(f"{wrong[0]} is no number: {row[wrong[0]]!r}")
            known.add(row["run"])
            yield shown
    except (OSError, ValueError, KeyError, TypeError) as error:
        line = len(known) + 1
        reason = str(error).partition("\n")[0]
        raise InvalidRows(f"{file}: line {line} is no row of this study: {reason}") from None
