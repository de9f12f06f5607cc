"""Runs side by side: aligned by the time of their common reference, as table and figures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from proving_ground.testbed.log.log_reader import SALVAGED_KEY, read_log
from proving_ground.testbed.recording.channels import REFERENCE, STATE
from proving_ground.testbed.recording.record import Record

from ..errors import NotComparable
from .metrics import tracking_statistics
from .summary import ErrorStatistics, TrackingStatistics
from .table import centimetres
from .tracking import BODIES, Tracking, tracking

MOST: Final = 6  # runs in a figure that can still be told apart
_SAME_M: Final = 1e-6
_FIGURES: Final = ("mean_euclidean_m", "p95_m", "max_m", "cross_sd_m")
_HEADS: Final = ("mean", "p95", "max", "cross sd")


@dataclass(frozen=True)
class Compared:
    """One of the runs."""

    label: str
    record: Record
    end_s: float  # up to which all runs go

    @cached_property
    def errors(self) -> Tracking:
        """Tracking errors up to the common end."""
        return tracking(self.record).until(self.end_s)

    @cached_property
    def statistics(self) -> TrackingStatistics:
        """The figures of these errors."""
        return tracking_statistics(self.errors)


def read_compared(logs: Sequence[Path]) -> list[Compared]:
    """Read runs and see that they belong side by side.

    Raises:
        NotComparable: too few or too many logs, one of them torn, or of different references.
        LogError: one is no log of ours.
    """
    if not 2 <= len(logs) <= MOST:
        raise NotComparable(f"compare: got {len(logs)} logs, takes 2 to {MOST}")
    if len({log.resolve() for log in logs}) < len(logs):
        raise NotComparable("compare: the same log is given twice")
    records = [read_log(log) for log in logs]
    for log, record in zip(logs, records, strict=True):
        if SALVAGED_KEY in record.metadata:
            raise NotComparable(
                f"{log}: is torn ({record.metadata[SALVAGED_KEY]}); "
                f"first: ttempc log check {log} --recover NEW.mcap"
            )
        if not len(record[STATE]) or not len(record[REFERENCE]):
            raise NotComparable(f"{log}: holds nothing on {STATE.topic} or {REFERENCE.topic}")
    for log, record in zip(logs[1:], records[1:], strict=True):
        _check_same_reference(logs[0], records[0], log, record)
    end_s = min(float(record[STATE].time_s[-1]) for record in records)
    labels = _labels(logs, records)
    return [Compared(*item, end_s) for item in zip(labels, records, strict=True)]


def table(runs: Sequence[Compared]) -> str:
    """Return the tracking errors of all runs as text, in centimetres."""
    width = max(len(run.label) for run in runs) + 2
    blocks = [f"Tracking error [cm], 8 to {runs[0].end_s:.1f} s"]
    for body in BODIES:
        blocks += ["", body.ljust(width) + "".join(head.rjust(10) for head in _HEADS)]
        for run in runs:
            error: ErrorStatistics = getattr(run.statistics.all, body)
            cells = (centimetres(getattr(error, name)) for name in _FIGURES)
            blocks.append(run.label.ljust(width) + "".join(cell.rjust(10) for cell in cells))
    return "\n".join(blocks)


def table_csv(runs: Sequence[Compared]) -> str:
    """Return all tracking statistics of all runs as CSV, SI units, a line per run and part."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    fields = list(ErrorStatistics.__dataclass_fields__)
    writer.writerow(["run", "end_s", "where", "body", *fields])
    for run in runs:
        for where, bodies in asdict(run.statistics).items():
            for body, figures in bodies.items():
                numbers = (figures[field] for field in fields)
                writer.writerow([run.label, f"{run.end_s:.3f}", where, body, *numbers])
    return stream.getvalue()


def _check_same_reference(first: Path, one: Record, second: Path, other: Record) -> None:
    time_s, here, there = np.intersect1d(
        one[REFERENCE].time_s, other[REFERENCE].time_s, return_indices=True
    )
    names = ("x_t_m", "y_t_m", "x_i_m", "y_i_m")
    apart = np.abs(one[REFERENCE].columns(*names)[here] - other[REFERENCE].columns(*names)[there])
    if not len(time_s):
        raise NotComparable(f"{first} and {second}: have no time in common")
    if apart.max() > _SAME_M:
        k = int(np.argmax(apart.max(axis=1) > _SAME_M))
        raise NotComparable(
            f"{first} and {second}: have different references (at {time_s[k]:.2f} s "
            f"{apart[k].max():.3g} m apart); runs are compared on one path at one speed"
        )


def _labels(logs: Sequence[Path], records: Sequence[Record]) -> list[str]:
    """Return what tells the runs apart: scenario, controller, seed, and the file where needed."""
    said = [
        " · ".join((r.metadata["scenario"], r.metadata["controller"], f"seed {r.metadata['seed']}"))
        for r in records
    ]
    return [
        label if said.count(label) == 1 else f"{label} ({log})"
        for label, log in zip(said, logs, strict=True)
    ]
