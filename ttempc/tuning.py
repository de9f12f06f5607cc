"""Range over which an option of a controller is searched when it is tuned.

The options of a controller declare their ranges as `search_space`, so that all controllers can be
tuned by one procedure with one budget.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class SearchRange(NamedTuple):
    """An option, or an entry of one, with its bounds; positions run from 0 (`low`) to 1 (`high`).

    Examples:
        >>> weight = SearchRange("output_weight", 0.1, 10.0, entry=3)
        >>> weight.position(1.0), weight.value(1.0)
        (0.5, 10.0)
    """

    option: str  # name in the dataclass of the options
    low: float
    high: float
    entry: int | None = None  # of an option with several numbers
    log: bool = True  # whether positions are logarithmic

    @property
    def label(self) -> str:
        """Return the name of the option, with the entry if it is one."""
        return self.option if self.entry is None else f"{self.option}[{self.entry}]"

    def position(self, value: float) -> float:
        """Return the position of a value."""
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def value(self, position: float) -> float:
        """Return the value at a position, to four digits."""
        if self.log:
            value = self.low * (self.high / self.low) ** position
        else:
            value = self.low + position * (self.high - self.low)
        return min(max(float(f"{value:.4g}"), self.low), self.high)
