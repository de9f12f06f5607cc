"""`results.jsonl`: rows appended and synced one by one, read line by line or as a data frame.

A row is on the disk before the next run is awaited. A killed driver leaves whole lines and at most
one incomplete last line, which the next driver removes.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

from ....testbed.foreign_files import bounded_lines, json_table, open_member
from ...errors import SweepRefused, SweepStopped
from .row import FIGURES, Row, line, working_error

if TYPE_CHECKING:
    from pandas import DataFrame

FILE: Final = "results.jsonl"
"""Name of the file of the rows in the folder of a sweep."""

WORKING_P95: Final = "working.cross_p95_m"
WORKING_SD: Final = "working.cross_sd_m"
"""Columns that `frame` adds: cross-track error of the working point, the tool point where there is
an implement, else the trailer's axle point: 95th percentile of its size, standard deviation [m]."""

_BATCH: Final = 10_000  # rows that are held as dictionaries at a time


class Results:
    """The open file of a sweep's rows; a context manager.

    Args:
        file: to append to; created if it does not exist, cut after its last complete line if it
            does.
        runs: number of runs in the plan.

    Raises:
        SweepRefused: a line of the file is not a row of this plan.
        SweepStopped: the file cannot be opened.
    """

    def __init__(self, file: Path, runs: int) -> None:
        self.file = file
        self._done = bytearray(runs)
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_APPEND
            self._stream = open_member(file.parent, file.name, flags)
        except OSError as error:
            raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None
        try:
            whole = self._find_done()
        except SweepRefused:
            self._stream.close()
            raise
        self._stream.truncate(whole)

    def _find_done(self) -> int:
        """Mark the runs that have rows, and return where the last complete line ends.

        Raises:
            SweepRefused: a line is not a row of this plan.
        """
        whole = 0
        lines = 0
        try:
            with open_member(self.file.parent, self.file.name) as stream:
                for text in bounded_lines(stream):
                    lines += 1
                    if not text.endswith(b"\n"):
                        break
                    run = json_table(text)["run"]
                    if type(run) is not int or run not in range(len(self._done)):
                        raise ValueError(f"run {run!r} of {len(self._done)}")
                    self._done[run] = 1
                    whole += len(text)
        except (ValueError, KeyError):
            raise SweepRefused(f"{self.file}: line {lines} is no row of this study") from None
        return whole

    @property
    def count(self) -> int:
        """Return the number of rows."""
        return sum(self._done)

    def has(self, run: int) -> bool:
        """Return whether a run has a row."""
        return bool(self._done[run])

    def append(self, *rows: Row) -> None:
        """Write rows and sync them to the disk.

        Raises:
            SweepStopped: writing failed; the file ends with the row before them.
        """
        stream = self._stream
        whole = os.fstat(self._stream.fileno()).st_size
        try:
            # Unbuffered: after a failure, the rest of a buffer would be written on closing.
            data = "".join(map(line, rows)).encode()
            while data:
                data = data[os.write(stream.fileno(), data) :]
            os.fsync(stream.fileno())
        except OSError as error:
            os.truncate(stream.fileno(), whole)
            raise SweepStopped(f"{self.file}: cannot be written: {error.strerror}") from None
        for row in rows:
            run = row["run"]
            assert isinstance(run, int)
            self._done[run] = 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()


def rows(file: Path) -> Iterator[Row]:
    """Yield the rows of a file in the folder of a sweep, without an incomplete last line.

    Raises:
        OSError: the file cannot be read, or is a link.
        ValueError: a line is no object of JSON, or too long.
    """
    with open_member(file.parent, file.name) as stream:
        for text in bounded_lines(stream):
            if text.endswith(b"\n"):
                yield json_table(text)


def frame(rows: Iterable[Row]) -> DataFrame:
    """Return rows as a data frame by increasing run number, one row a run, labels from 0.

    The columns are those of the rows, and `WORKING_P95`, `WORKING_SD`. A number that a run does not
    have is NaN.
    """
    import pandas as pd  # here, since workers and `ttempc list` do without

    numbers = dict.fromkeys((*FIGURES, WORKING_P95, WORKING_SD, "wall_s"), float)
    parts = [pd.DataFrame()]
    iterator = iter(rows)
    while batch := list(itertools.islice(iterator, _BATCH)):
        records = [
            {
                **row,
                WORKING_P95: working_error(row),
                WORKING_SD: working_error(row, "cross_sd_m"),
            }
            for row in batch
        ]
        part = pd.DataFrame.from_records(records)
        parts.append(part.astype({name: kind for name, kind in numbers.items() if name in part}))
    table = pd.concat(parts[1:] or parts, ignore_index=True)
    return table.sort_values("run", ignore_index=True) if len(table) else table


def read_frame(folder: Path) -> DataFrame:
    """Return the rows in the folder of a sweep, also of one in progress, see `frame`."""
    return frame(rows(folder / FILE))
