"""`results.jsonl`: rows appended and synced one by one, read back line by line.

A row is on the disk before the next one is asked for. What a killed driver leaves is a file of
whole lines and perhaps a torn last one, which the next driver drops.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Self

from proving_ground.testbed.atomic_write import atomic_write

from ..errors import SweepRefused, SweepStopped
from .row import Row, line

_SEEN: Final = 100  # rows from which polars.read_ndjson learns the types


class Results:
    """The open file of a sweep's rows; a context manager.

    Args:
        file: to append to; made where it does not exist, rid of a torn last line where it does.
        runs: number of runs in the plan.

    Raises:
        SweepRefused: a line in the file is no row of this plan.
        SweepStopped: the file cannot be opened.
    """

    def __init__(self, file: Path, runs: int) -> None:
        self.file = file
        self._done = bytearray(runs)
        try:
            self._stream = open(file, "ab")  # noqa: SIM115 - closed by __exit__
        except OSError as error:
            raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None
        whole = 0
        for number, text in enumerate(_lines(file), 1):
            if not text.endswith(b"\n"):
                break
            try:
                self._done[json.loads(text)["run"]] = 1
            except (ValueError, KeyError, TypeError, IndexError):
                self._stream.close()
                raise SweepRefused(f"{file}: line {number} is no row of this study") from None
            whole += len(text)
        self._stream.truncate(whole)

    @property
    def count(self) -> int:
        """Return the number of rows."""
        return sum(self._done)

    def has(self, run: int) -> bool:
        """Return whether a run has its row."""
        return bool(self._done[run])

    def append(self, row: Row) -> None:
        """Write a row and see it on the disk.

        Raises:
            SweepStopped: the disk does not take it; the file ends with the row before.
        """
        stream, whole = self._stream, os.fstat(self._stream.fileno()).st_size
        try:
            # past Python's buffer: what is left there after a failure would be written at the end
            data = line(row).encode()
            while data:
                data = data[os.write(stream.fileno(), data) :]
            os.fsync(stream.fileno())
        except OSError as error:
            os.truncate(stream.fileno(), whole)
            raise SweepStopped(f"{self.file}: cannot be written: {error.strerror}") from None
        run = row["run"]
        assert isinstance(run, int)
        self._done[run] = 1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()


def rows(file: Path) -> Iterator[Row]:
    """Yield the rows of a file of results, without a torn last line."""
    for text in _lines(file):
        if text.endswith(b"\n"):
            yield json.loads(text)


def settle(file: Path, change: Callable[[Row], Row] = lambda row: row) -> None:
    """Rewrite a file of results so that readers which guess types see each column's early.

    Rows that have a figure which none of the first rows has are moved up; the file is replaced by
    one that is whole, or not at all.

    Args:
        file: of results, closed.
        change: made to every row.

    Raises:
        SweepStopped: the disk does not take it; the file is as it was.
    """
    seen: set[str] = set()
    moved: set[int] = set()
    changed = False
    for number, row in enumerate(rows(file)):
        now = change(row)
        changed |= now != row
        found = {key for key, value in now.items() if value is not None} - seen
        if found and number >= _SEEN:
            moved.add(number)
        seen |= found
    if not changed and not moved:
        return
    try:
        with atomic_write(file) as stream:
            for first in (True, False):
                for number, row in enumerate(rows(file)):
                    if (number in moved) is first:
                        stream.write(line(change(row)).encode())
    except OSError as error:
        raise SweepStopped(f"{file}: cannot be written: {error.strerror}") from None


def _lines(file: Path) -> Iterator[bytes]:
    with open(file, "rb") as stream:
        yield from stream
