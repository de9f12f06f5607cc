"""Record of the samples and commands of the last control ticks: arrays, seen as a sequence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, overload

import numpy as np

from ..layout import SAMPLE, measurements_of, sample_rows
from ..types import Command, FloatArray, Measurement

TIME, COMMAND, HEADINGS, SAMPLES = 0, slice(1, 4), slice(4, 6), 6
"""Columns of a tick: time [s], the command of the period before, NaN where there was none, the
estimated yaw of tractor and trailer [rad], and the number of samples up to the end of the tick."""

_TICK: Final = 7
_NO_COMMAND: Final = np.full(3, math.nan)


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """What an estimator received at one control tick."""

    time_s: float
    samples: tuple[Measurement, ...]  # in the order of arrival
    command: Command | None  # of the period before; None at the first tick
    headings: tuple[float, float]  # estimated yaw of tractor and trailer [rad], may be NaN


class Window(Sequence[RecordedTick]):
    """Recorded ticks, oldest first; an entry is made of the arrays when someone looks at it.

    Args:
        ticks: (n, 7), see `TIME`, `COMMAND`, `HEADINGS`, `SAMPLES`.
        samples: rows (m, 5) of `SAMPLE` in the order of arrival.
    """

    def __init__(self, ticks: FloatArray, samples: FloatArray) -> None:
        self.ticks, self.samples = ticks, samples

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
            return [self[i] for i in range(*index.indices(len(self)))]
        index = range(len(self))[index]
        time_s, *command, psi_t, psi_i, end = self.ticks[index].tolist()
        begin = self.ticks.item(index - 1, SAMPLES) if index else 0
        samples = measurements_of(self.samples[int(begin) : int(end)])
        known = Command(*command) if command[0] == command[0] else None
        return RecordedTick(time_s, tuple(samples), known, (psi_t, psi_i))


class Recorder:
    """Keeps the last `memory` ticks at least, in arrays that double where they are too short."""

    def __init__(self, memory: int) -> None:
        self._memory = memory
        self._ticks, self._samples = np.empty((64, _TICK)), np.empty((1024, SAMPLE))
        self.count = 0  # of all ticks that were recorded
        self._first = 0  # of them, in the arrays
        self._all_samples = self._first_sample = 0  # likewise

    def append(
        self,
        time_s: float,
        samples: FloatArray,
        command: FloatArray,
        psi_t: float,
        psi_i: float,
    ) -> None:
        """Record a tick: samples (n, `SAMPLE`) in the order of arrival, command (3,), headings."""
        end = self._all_samples + len(samples)
        if self.count - self._first == len(self._ticks) or end - self._first_sample > len(
            self._samples
        ):
            self._make_room(len(samples))
        tick = self._ticks[self.count - self._first]
        tick[TIME], tick[COMMAND], tick[HEADINGS] = time_s, command, (psi_t, psi_i)
        tick[SAMPLES] = end
        start = self._all_samples - self._first_sample
        self._samples[start : start + len(samples)] = samples
        self.count, self._all_samples = self.count + 1, end

    def since(self, tick: int) -> Window:
        """Return a copy of the ticks from the `tick`-th on, of those that are kept."""
        begin, end = max(tick - self._first, 0), self.count - self._first
        ticks, base = self._ticks[begin:end].copy(), self._first_sample
        dropped = int(self._ticks[begin - 1, SAMPLES]) if begin else base
        ticks[:, SAMPLES] -= dropped
        return Window(ticks, self._samples[dropped - base : self._all_samples - base].copy())

    def _make_room(self, more: int) -> None:
        kept = self.since(self.count - self._memory)
        self._first = self.count - len(kept)
        self._first_sample = self._all_samples - len(kept.samples)
        kept.ticks[:, SAMPLES] += self._first_sample
        for name, rows, needed in (
            ("_ticks", kept.ticks, 2 * len(kept)),
            ("_samples", kept.samples, 2 * (len(kept.samples) + more)),
        ):
            array = getattr(self, name)
            if needed > len(array):
                array = np.empty((needed, array.shape[1]))
                setattr(self, name, array)
            array[: len(rows)] = rows
