"""Formatting of estimates, run numbers and axis values."""

import re
from collections.abc import Sequence

from ...results.statistics import IntervalEstimate
from ...studies.sweep.row import Value


def format_estimate(estimate: IntervalEstimate | None, decimals: int = 1, sign: str = "") -> str:
    """Return an estimate with its interval, a dash where there is none."""
    if estimate is None:
        return "–"
    form = f"{sign}z.{decimals}f"  # z: no negative zero
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
