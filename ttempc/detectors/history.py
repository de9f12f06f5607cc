"""Tools that detectors share: histories, medians, cumulative sums.

A history is an array (1 + n, 3) of at most n entries in the order of arrival: a time [s] and two
numbers each. Row 0 has the number of entries, the entries are in the rows from 1 on. Where it is
full, the oldest entry is lost.
"""

import math
from enum import IntEnum
from typing import Final

from ..jit import cached_njit
from ..types import FloatArray

# Nothing is allocated in these kernels: without counting references they compile faster.
kernel: Final = cached_njit(nogil=True, error_model="numpy", _nrt=False, no_rewrites=True)

SATURATION: Final = 1.5
"""Limits at which a cumulative sum saturates: an alarm ends soon after its cause. Assumed."""


class Entry(IntEnum):
    """Column of an entry of a history."""

    TIME_S = 0
    FIRST = 1
    SECOND = 2


@kernel
def remember(
    history: FloatArray, oldest_s: float, time_s: float, first: float, second: float
) -> int:
    """Drop the entries before the first one from `oldest_s` on; add one unless its time is NaN.

    Returns the number of entries.
    """
    count = int(history[0, 0])
    adds = not math.isnan(time_s)
    dropped = 0
    while dropped < count and history[1 + dropped, Entry.TIME_S] < oldest_s:
        dropped += 1
    if adds and not dropped and count == len(history) - 1:
        dropped = 1

    if dropped:
        count -= dropped
        for n in range(1, count + 1):
            for column in range(3):
                history[n, column] = history[n + dropped, column]
    if adds:
        count += 1
        history[count, Entry.TIME_S] = time_s
        history[count, Entry.FIRST] = first
        history[count, Entry.SECOND] = second
    history[0, 0] = count
    return count


@kernel
def forget(history: FloatArray) -> None:
    """Remove all entries."""
    history[0, 0] = 0.0


@kernel
def sums(history: FloatArray) -> tuple[float, float]:
    """Return the sums of the first and of the second numbers of all entries."""
    first = 0.0
    second = 0.0
    for n in range(1, 1 + int(history[0, 0])):
        first += history[n, Entry.FIRST]
        second += history[n, Entry.SECOND]
    return first, second


@kernel
def mean_in_span(history: FloatArray, begin_s: float, end_s: float) -> float:
    """Return the mean of the first numbers of the entries in a span, NaN if there are none."""
    total = 0.0
    count = 0
    for n in range(1, 1 + int(history[0, 0])):
        if begin_s <= history[n, Entry.TIME_S] <= end_s:
            total += history[n, Entry.FIRST]
            count += 1
    return total / count if count else math.nan


@kernel
def median(values: FloatArray, count: int) -> float:
    """Return the median of the first `count` values, whose order changes.

    Selection after Hoare, Algorithm 65: FIND (1961), Communications of the ACM 4.
    """
    low = 0
    high = count - 1
    middle = count // 2
    while low < high:
        pivot = values[(low + high) // 2]
        left = low
        right = high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while values[right] > pivot:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left += 1
                right -= 1
        low = left if right < middle else low
        high = right if middle < left else high

    if count % 2:
        return values[middle]
    below = values[0]
    for n in range(1, middle):
        below = max(below, values[n])
    return (below + values[middle]) / 2.0


@kernel
def cusum(total: float, residual: float, allowance: float, limit: float) -> float:
    """Return a cumulative sum after another residual (Page 1954, Biometrika 41),

        g <- min(max(0, g + r - k), 1.5 h),

    with the residual r, the allowance k and the limit h. It grows where the mean residual is above
    the allowance, which is half of the shift that is to be detected (Montgomery, Introduction to
    Statistical Quality Control, ch. 9). The side below 0 is that of -r.
    """
    return min(max(0.0, total + residual - allowance), SATURATION * limit)
