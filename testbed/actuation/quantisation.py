"""What is left of a number where it is sent or read in whole units."""

from __future__ import annotations


def quantised(value: float, resolution: float) -> float:
    """Return the multiple of `resolution` nearest to `value`; the value itself where that is 0."""
    return resolution * round(value / resolution) if resolution else value
