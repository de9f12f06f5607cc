"""Time of a guidance: seconds from its first update on, on the clock of the samples."""

from __future__ import annotations

import math

import numpy as np

from ..errors import GuidanceFailed, InvalidTime
from ..layout import SAMPLE
from ..types import FloatArray


class GuidanceClock:
    """Converts time stamps of any epoch to seconds from the first update on.

    Seconds from the start keep their resolution; those of the Unix epoch have steps of 2e-7.
    """

    def __init__(self) -> None:
        self.origin_s: float | None = None
        """Time stamp of the first update [s], None before it."""
        self.updated_s = -math.inf
        """Time of the last update, from the first one [s]."""

    def require_update(self, caller: str) -> None:
        """Refuse a call before the first update.

        Raises:
            GuidanceFailed: `update` was not called yet.
        """
        if self.origin_s is None:
            raise GuidanceFailed(f"{caller}: call update(time_s, measurements) first")

    def seconds(self, time_s: float) -> float:
        """Return the time stamp of an update in seconds from the first one, which this may be.

        Raises:
            InvalidTime: it is no finite number or before that of the last update.
        """
        try:
            is_finite = math.isfinite(time_s)
        except (OverflowError, TypeError) as error:
            raise InvalidTime(f"update: time_s: {error}, must be a finite number") from None
        if not is_finite:
            raise InvalidTime(f"update: time_s = {time_s}, must be finite")
        if self.origin_s is None:
            self.origin_s = time_s
        now = time_s - self.origin_s
        late = self.updated_s - now
        if late > 0.0:
            raise InvalidTime(f"update: time_s = {time_s} is {late:g} s before the last update")
        return now

    def from_start(self, rows: FloatArray) -> FloatArray:
        """Return sample rows (n, `SAMPLE`) with their times in seconds from the first update."""
        if not self.origin_s:
            return rows
        offset = np.zeros(SAMPLE)
        offset[0] = self.origin_s
        return rows - offset
