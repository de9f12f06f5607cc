"""Shares of a sweep that several machines drive, and the union of their folders."""

import itertools
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ....testbed.atomic_write import atomic_write
from ....testbed.foreign_files import open_member
from ...errors import SweepRefused, SweepStopped
from .folder import SweepFolder, read_origin, refuse_other_code, same_study
from .plan import SweepPlan
from .results import FILE, Results, rows
from .row import Row

_SYNCED: Final = 1000  # rows that are written at a time


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several shares of a sweep; all controllers of a point and seed are in the same."""

    number: int = 1  # from 1
    count: int = 1

    def runs(self, plan: SweepPlan) -> Iterator[int]:
        """Yield the numbers of the plan's runs in this share."""
        for run in plan.runs():
            if run // plan.controller_count % self.count == self.number - 1:
                yield run


WHOLE: Final = Shard()


def merge(plan: SweepPlan, folder: SweepFolder, sources: Sequence[Path]) -> int:
    """Take over the rows and kept logs of other folders of the same sweep.

    Of a run that several folders have, the first row counts.

    Args:
        plan: of the sweep.
        folder: locked by this process.
        sources: folders of shares of the sweep; they stay as they are.

    Returns:
        How many of the plan's runs have no row yet.

    Raises:
        SweepRefused: a source is no folder of this study, its code or its versions differ, or a
            row is none of this plan; the first two before anything is written.
        SweepStopped: the disk is full; written rows remain.
    """
    for source in sources:
        _refuse_other(plan, folder, source)
    folder.logs.mkdir(exist_ok=True)
    with Results(folder.results, plan.size) as results:
        for source in sources:
            wanted = (row for row in _rows(source, plan) if not results.has(int(str(row["run"]))))
            while batch := list(itertools.islice(wanted, _SYNCED)):
                for row in batch:
                    _take_log(row, source, folder)
                results.append(*batch)
        return plan.run_count - results.count


def _refuse_other(plan: SweepPlan, folder: SweepFolder, source: Path) -> None:
    begun = read_origin(source)
    refuse_other_code(source, begun, folder.origin)
    if begun.plan != folder.origin.plan or not same_study(source, plan):
        raise SweepRefused(f"folder {source}: is of another study than {plan.name}, or as it was")


def _rows(source: Path, plan: SweepPlan) -> Iterator[Row]:
    """Yield the rows of a folder.

    Raises:
        SweepRefused: one is none of the plan's.
    """
    try:
        for row in rows(source / FILE):
            run = row.get("run")
            if type(run) is not int or run not in range(plan.size):
                raise SweepRefused(f"{source / FILE}: run {run!r} is none of the {plan.size}")
            yield row
    except OSError as error:
        raise SweepRefused(f"{source / FILE}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise SweepRefused(f"{source / FILE}: {error}") from None


def _take_log(row: Row, source: Path, folder: SweepFolder) -> None:
    """Copy the log of a row, whose name a stranger may have chosen."""
    if not row.get("log"):
        return
    name = Path(str(row["log"])).name
    if row["log"] != f"logs/{name}":
        raise SweepRefused(f"{source / FILE}: log {row['log']!r} is not in its folder")
    try:
        log = open_member(source / "logs", name)
    except OSError as error:
        raise SweepRefused(f"{source / 'logs' / name}: {error.strerror}") from None
    try:
        with log, atomic_write(folder.logs / name) as copy:
            shutil.copyfileobj(log, copy)
    except OSError as error:
        raise SweepStopped(f"{folder.logs / name}: cannot be written: {error.strerror}") from None
