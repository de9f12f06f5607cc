"""Checks of the validation: a measured figure, its permitted range and the source of it."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ttempc.types import FloatArray

Verdict = Literal["pass", "FAIL", "not applicable"]
_VERDICTS: Final[dict[bool | None, Verdict]] = {True: "pass", False: "FAIL", None: "not applicable"}


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line of a chart."""

    label: str
    x: FloatArray  # (n,)
    y: FloatArray  # (n,)
    measured: bool = True  # False: the expected curve


@dataclass(frozen=True, slots=True)
class Chart:
    """Measured and expected curves of an experiment; units are part of the labels."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class Check:
    """A figure and its permitted range.

    `figure` is None where the check does not apply; `note` then gives the reason.
    """

    name: str
    figure: float | None  # in `unit`
    unit: str
    expectation: str  # text of the range
    low: float  # smallest figure that passes
    high: float  # largest figure that passes
    source: str  # where the expectation is from
    note: str = ""
    chart: Chart | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the figure is in its range (NaN is not); None where the check does not apply."""
        return None if self.figure is None else bool(self.low <= self.figure <= self.high)

    @property
    def verdict(self) -> Verdict:
        """The result as a word."""
        return _VERDICTS[self.passed]


def between(
    name: str,
    figure: float,
    low: float,
    high: float,
    unit: str,
    source: str,
    *,
    note: str = "",
) -> Check:
    """Return a check of a figure that must lie in [low, high]; an infinite end is no bound."""
    return Check(name, float(figure), unit, range_text(low, high), low, high, source, note)


def range_text(low: float, high: float) -> str:
    """Return a range as text."""
    if np.isinf(high):
        return f"at least {number(low)}"
    if np.isinf(low) or low == 0.0:
        return f"at most {number(high)}"
    return f"{number(low)} to {number(high)}"


def number(value: float) -> str:
    """Format a number with four digits; a number from 1000 on as an integer."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"
