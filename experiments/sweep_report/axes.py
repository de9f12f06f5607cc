"""Axes of a study as a report shows them: labels, units and values to group by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..sweep.row import Value
from ..sweep.study import Axis, DrawnAxis, ListAxis
from .format import format_value
from .runs import Runs

_UNITS: Final = {
    "kpa": "kPa",
    "rad": "rad",
    "deg": "deg",
    "mps": "m/s",
    "radps": "rad/s",
    "kg": "kg",
    "hz": "Hz",
    "m": "m",
    "s": "s",
}
_CAPITALS: Final = ("iso", "gnss", "imu")
_BINS: Final = 6
_MOST_VALUES: Final = 16  # more are binned
_WIDE: Final = 12.0  # largest over smallest value from which an axis is logarithmic


@dataclass(frozen=True)
class Scale:
    """An axis of a study, with the position of every run on it."""

    keys: tuple[str, ...]
    label: str
    texts: tuple[str, ...]  # of its k values or bins
    positions: FloatArray  # of the values on a chart, (k,)
    place: NDArray[np.intp]  # index of each run's value, (n,)
    numeric: bool
    logarithmic: bool
    binned: bool


def scales(runs: Runs) -> tuple[Scale, ...]:
    """Return all axes of a study except the controller, in the order of the file."""
    axes = [axis for axis in runs.study.axis if "controller" not in axis.names and _varies(axis)]
    names = [_label(axis.names) for axis in axes]
    return tuple(
        _scale(runs, axis, name if names.count(name) == 1 else axis.label)
        for axis, name in zip(axes, names, strict=True)
    )


def _varies(axis: Axis) -> bool:
    return not isinstance(axis, ListAxis) or len(axis.values) > 1


def _label(keys: Sequence[str]) -> str:
    """Return the label of keys with the unit: `soil.cone_index_kpa` is "cone index [kPa]"."""
    stem, unit = keys[0].rpartition(".")[2], ""
    *words, last = stem.split("_")
    if words and last in _UNITS:
        stem, unit = "_".join(words), f" [{_UNITS[last]}]"
    words = stem.split("_")
    return " ".join(word.upper() if word in _CAPITALS else word for word in words) + unit


def _scale(runs: Runs, axis: Axis, label: str) -> Scale:
    """Return an axis with the values of the runs on it."""
    columns = [[row[name] for row in runs.rows] for name in axis.names]
    values: list[Value] = [
        entry[0] if len(set(entry)) == 1 else ", ".join(map(format_value, entry))
        for entry in zip(*columns, strict=True)
    ]
    numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not numeric:
        listed = axis.values if isinstance(axis, ListAxis) and not axis.relative else ()
        order = {v: None for v in listed if v in set(values)} | dict.fromkeys(values)
        places = {value: number for number, value in enumerate(order)}
        return Scale(
            axis.names,
            label,
            tuple(format_value(value) for value in order),
            np.arange(len(order), dtype=float),
            np.array([places[value] for value in values], dtype=np.intp),
            numeric=False,
            logarithmic=False,
            binned=False,
        )
    numbers = np.array(values, dtype=float)
    distinct, place = np.unique(numbers, return_inverse=True)
    logarithmic = bool(distinct[0] > 0.0 and _wide(axis, distinct))
    if not isinstance(axis, DrawnAxis) and len(distinct) <= _MOST_VALUES:
        texts = tuple(_short(value) for value in distinct)
        if len(set(texts)) < len(texts):
            texts = tuple(f"{value:g}" for value in distinct)
        return Scale(axis.names, label, texts, distinct, place, True, logarithmic, binned=False)
    count = min(_BINS, len(distinct))
    bins = (np.arange(len(distinct)) * count // len(distinct)).astype(np.intp)
    parts = [distinct[bins == number] for number in range(count)]
    texts = tuple(f"{_short(part[0])} to {_short(part[-1])}" for part in parts)
    middles = np.array([np.median(part) for part in parts])
    return Scale(axis.names, label, texts, middles, bins[place], True, logarithmic, binned=True)


def _short(number: float) -> str:
    return f"{number:.3g}" if abs(number) < 1000.0 else f"{number:.0f}"


def _wide(axis: Axis, distinct: FloatArray) -> bool:
    """Return whether an axis is logarithmic."""
    if not isinstance(axis, ListAxis):
        return "log" in (getattr(axis, "spacing", ""), getattr(axis, "distribution", "")[:3])
    return bool(distinct[-1] >= _WIDE * distinct[0])
