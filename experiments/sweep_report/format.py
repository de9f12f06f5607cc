"""Formatting of estimates, run numbers, axis values and commands."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..results.statistics import IntervalEstimate, Proportion
from ..sweep.row import Value
from ..sweep.study import BY_NAME, Study


def format_estimate(estimate: IntervalEstimate | None, decimals: int = 1, sign: str = "") -> str:
    """Return an estimate with its interval, a dash where there is none."""
    if estimate is None:
        return "–"
    form = f"{sign}.{decimals}f"
    value = format(estimate.value, form)
    if estimate.low is None or estimate.high is None:
        return value
    return f"{value} ({estimate.low:{form}} to {estimate.high:{form}})"


def format_percent(proportion: Proportion) -> str:
    """Return a proportion with its interval in percent."""
    low, high = proportion.ends
    return f"{100 * proportion.value:.0f} ({100 * low:.0f} to {100 * high:.0f})"


def format_numbers(numbers: Sequence[int] | NDArray[np.intp]) -> str:
    """Return whole numbers as ranges: 0, 3, 6, 9, 14 is "0-9/3, 14".

    A part is a number, or first-last/step with a step of 1 left out; sweep.js parses it.
    """
    ordered = sorted(int(number) for number in numbers)
    parts, at = [], 0
    while at < len(ordered):
        end, step = at, ordered[at + 1] - ordered[at] if at + 1 < len(ordered) else 0
        while end + 1 < len(ordered) and ordered[end + 1] - ordered[end] == step:
            end += 1
        if end - at < 2:  # two numbers are no range
            end = at
        last = f"-{ordered[end]}" + (f"/{step}" if step > 1 else "") if end > at else ""
        parts.append(f"{ordered[at]}{last}")
        at = end + 1
    return ", ".join(parts)


def format_value(value: Value) -> str:
    """Return the value of an axis; of a path, the name of its file."""
    if isinstance(value, str):
        return re.sub(r".*/|\.toml$", "", value)
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower()


def rerun_command(study: Study, row: Mapping[Any, Any]) -> str:
    """Return the command that repeats a run of a study and writes its log."""
    parts = ["ttempc", "run", str(row["scenario"]), "--seed", str(row["seed"])]
    parts += ["--controller", str(row["controller"])]
    axes = {name: row[name] for name in study.names if name not in BY_NAME}
    fixed = {key: value for key, value in _leaves(study.set) if key != "controller.name"}
    for key, value in {**{key: fixed[key] for key in fixed if key not in axes}, **axes}.items():
        if value is not None:
            parts += ["--set", f"{key}={_toml(value)}"]
    return shlex.join(parts)


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _toml(value: Any) -> str:  # noqa: ANN401 - any value of a study file
    """Return a value as TOML on one line."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{json.dumps(key)} = {_toml(item)}" for key, item in value.items())
        return f"{{{inside}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False)
