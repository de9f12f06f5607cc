"""Record of the samples and commands of the last control ticks.

The record is kept in arrays. A `Window` shows them as a sequence of `RecordedTick`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, overload

import numpy as np

from ..layout import SAMPLE, measurements_of, sample_rows
from ..types import Command, FloatArray, Measurement

# Columns of a recorded tick.
TIME: Final = 0  # [s]
COMMAND: Final = slice(1, 4)  # of the period before, NaN where there was none
HEADINGS: Final = slice(4, 6)  # estimated yaw of tractor and trailer [rad]
SAMPLES: Final = 6  # number of all samples of the window up to the end of the tick
_TICK: Final = 7  # number of columns
_NO_COMMAND: Final = np.full(3, math.nan)


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """Samples and command that an estimator received at one control tick."""

    time_s: float
    samples: tuple[Measurement, ...]  # in the order of arrival
    command: Command | None  # of the period before; None at the first tick
    headings: tuple[float, float]  # estimated yaw of tractor and trailer [rad], may be NaN


class Window(Sequence[RecordedTick]):
    """Recorded ticks, oldest first. An entry is made from the arrays when it is read.

    Args:
        ticks: (n, 7), see `TIME`, `COMMAND`, `HEADINGS`, `SAMPLES`.
        samples: rows (m, 5) of `SAMPLE` in the order of arrival.
    """

    def __init__(self, ticks: FloatArray, samples: FloatArray) -> None:
        self.ticks = ticks
        self.samples = samples

    @classmethod
    def of(cls, window: Sequence[RecordedTick]) -> Window:
        """Return recorded ticks as arrays."""
        if isinstance(window, cls):
            return window
        recorder = Recorder(len(window))
        for tick in window:
            command = _NO_COMMAND if tick.command is None else tick.command.as_array()
            recorder.append(tick.time_s, sample_rows(tick.samples), command, *tick.headings)
        return recorder.since(0)

    def __len__(self) -> int:
        return len(self.ticks)

    @overload
    def __getitem__(self, index: int) -> RecordedTick: ...
    @overload
    def __getitem__(self, index: slice) -> list[RecordedTick]: ...
    def __getitem__(self, index: int | slice) -> RecordedTick | list[RecordedTick]:
        if isinstance(index, slice):
            return [self[position] for position in range(*index.indices(len(self)))]

        position = range(len(self))[index]  # from 0, also of a negative index
        time_s, *entries, psi_t, psi_i, end = self.ticks[position].tolist()
        begin = self.ticks.item(position - 1, SAMPLES) if position > 0 else 0
        samples = measurements_of(self.samples[int(begin) : int(end)])
        command = None if math.isnan(entries[0]) else Command(*entries)
        return RecordedTick(time_s, tuple(samples), command, (psi_t, psi_i))


class Recorder:
    """Remembers the last `memory` ticks."""

    def __init__(self, memory: int) -> None:
        self._ticks: deque[tuple[list[float], FloatArray]] = deque(maxlen=memory)
        self.count = 0  # number of all ticks that were recorded

    def append(
        self, time_s: float, samples: FloatArray, command: FloatArray, psi_t: float, psi_i: float
    ) -> None:
        """Record a tick: samples (n, `SAMPLE`) in the order of arrival, command (3,), headings."""
        tick = [time_s, *command.tolist(), psi_t, psi_i, len(samples)]
        self._ticks.append((tick, samples.copy()))
        self.count += 1

    def since(self, tick: int) -> Window:
        """Return a copy of the remembered ticks from the `tick`-th recorded one on."""
        forgotten = self.count - len(self._ticks)
        remembered = list(self._ticks)[max(tick - forgotten, 0) :]

        # The number of samples of each tick becomes their number up to its end.
        ticks = np.array([entries for entries, _ in remembered]).reshape(-1, _TICK)
        ticks[:, SAMPLES] = np.cumsum(ticks[:, SAMPLES])

        no_rows = np.empty((0, SAMPLE))  # for a window without samples
        samples = np.concatenate([no_rows, *(rows for _, rows in remembered)])
        return Window(ticks, samples)
