"""Formatting of estimates, run numbers, axis values and commands."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..results.statistics import IntervalEstimate
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


def format_numbers(numbers: Sequence[int]) -> str:
    """Return ascending whole numbers with runs of three and more as ranges: "0-2, 14"."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1].append(number)
        else:
            ranges.append([number])
    return ", ".join(
        f"{part[0]}-{part[-1]}" if len(part) > 2 else ", ".join(map(str, part)) for part in ranges
    )


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
