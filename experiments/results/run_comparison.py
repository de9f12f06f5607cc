"""Comparison of runs on one reference, aligned by its time."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, astuple, dataclass
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ...testbed.log.reader import SALVAGED_KEY, read_log
from ...testbed.recording.channels import REFERENCE, STATE
from ...testbed.recording.record import IMPORTED_KEY, Record
from ..errors import NotComparable
from .summary import (
    ACTUATOR_USE,
    ErrorStatistics,
    TrackingStatistics,
    corridor_statistics,
    input_statistics,
    tracking_statistics,
)
from .table import COLUMNS, centimetres, format_corridor
from .tracking_errors import BODIES, START_UP_S, TrackingErrors, position_fields, tracking_errors

MAX_RUNS: Final = 6  # more lines in one figure cannot be told apart
STATISTICS_FILE: Final = "comparison.csv"  # of `comparison_csv`, in the folder of a comparison
_SAME_M: Final = 1e-6  # references closer than this are the same
_SAME_LINE_M: Final = 0.02  # of a record and of a run: both have points of one line
COMPARED: Final = ("p95", "sd", "mean", "along sd")
"""Columns of a comparison."""


@dataclass(frozen=True)
class ComparedRun:
    """One of the compared runs."""

    label: str  # scenario, controller and seed, and the log where another run has the same
    short_label: str  # what of it differs between the compared runs
    common: str  # what of it is equal for all, "" if nothing is
    record: Record
    end_s: float  # of the shortest of the compared runs

    @cached_property
    def errors(self) -> TrackingErrors:
        """Tracking errors up to the common end."""
        return tracking_errors(self.record).until(self.end_s)

    @cached_property
    def statistics(self) -> TrackingStatistics:
        """Statistics of the tracking errors up to the common end."""
        return tracking_statistics(self.errors)


def read_compared(logs: Sequence[Path], labels: Sequence[str] = ()) -> list[ComparedRun]:
    """Return 2 to 6 runs of one reference; `labels` name them, by default what differs.

    Raises:
        NotComparable: too few or too many logs or labels, a torn log, or different references.
        LogError: a file is not a log of this project.
    """
    if not 2 <= len(logs) <= MAX_RUNS:
        raise NotComparable(f"compare: got {len(logs)} logs, takes 2 to {MAX_RUNS}")
    if len({log.resolve() for log in logs}) < len(logs):
        raise NotComparable("compare: the same log is given twice")
    if labels and (len(labels) != len(logs) or len({*labels}) < len(labels)):
        raise NotComparable(f"--label: must be {len(logs)} different names, got {len(labels)}")
    records = [read_log(log) for log in logs]
    for log, record in zip(logs, records, strict=True):
        if SALVAGED_KEY in record.metadata:
            raise NotComparable(
                f"{log}: is torn ({record.metadata[SALVAGED_KEY]}); "
                f"first: ttempc log check {log} -o NEW.mcap"
            )
        if not len(record[STATE]) or not len(record[REFERENCE]):
            raise NotComparable(f"{log}: holds nothing on {STATE.topic} or {REFERENCE.topic}")
    for log, record in zip(logs[1:], records[1:], strict=True):
        _check_same_reference(logs[0], records[0], log, record)
    end_s = min(float(record[STATE].time_s[-1]) for record in records)
    parts = _label_parts(logs, records)
    differs = [len(set(column)) > 1 for column in zip(*parts, strict=True)]
    return [
        ComparedRun(
            label=label or _joined(own),
            short_label=label or _joined(compress(own, differs)),
            common=_joined(compress(own, (not each for each in differs))),
            record=record,
            end_s=end_s,
        )
        for own, record, label in zip(parts, records, labels or [""] * len(logs), strict=True)
    ]


def format_comparison(runs: Sequence[ComparedRun]) -> str:
    """Return the errors of all runs as text, in centimetres, the working point first."""
    width = max(len(run.label) for run in runs) + 2
    blocks = [f"Cross-track error [cm], {START_UP_S:g} to {runs[0].end_s:.1f} s"]
    points = [run.statistics.all.by_point for run in runs]
    for point in max(points, key=len):
        blocks += ["", point.ljust(width) + "".join(head.rjust(10) for head in COMPARED)]
        for run, errors in zip(runs, points, strict=True):
            if (error := errors.get(point)) is None:  # a run without an implement
                continue
            cells = (centimetres(getattr(error, COLUMNS[name])) for name in COMPARED)
            blocks.append(run.label.ljust(width) + "".join(cell.rjust(10) for cell in cells))
    corridors = {run.label: corridor_statistics(run.record) for run in runs}
    kept = {label: format_corridor(each) for label, each in corridors.items() if each}
    blocks += ["", *(f"{label.ljust(width)}{text}" for label, text in kept.items())] if kept else []
    blocks += ["", "Use of the actuators, whole run"]
    for run in runs:
        inputs = asdict(input_statistics(run.record))
        cells = []
        for head, key, factor in ACTUATOR_USE:
            _, name, number = key.split(".")
            value = inputs[name][number]
            cells.append(f"{head} {'–' if value is None else format(factor * value, '.1f')}")
        blocks.append(f"{run.label.ljust(width)}{', '.join(cells)}")
    return "\n".join(blocks)


def comparison_rows(runs: Sequence[ComparedRun]) -> list[tuple[str, ...]]:
    """Return rows of run, point and errors in cm as `format_comparison` has them, run by run."""
    return [
        (run.label, point, *(centimetres(getattr(error, COLUMNS[name])) for name in COMPARED))
        for run in runs
        for point, error in run.statistics.all.by_point.items()
    ]


def comparison_csv(runs: Sequence[ComparedRun]) -> str:
    """Return all tracking statistics of all runs as CSV in SI units.

    Each line holds one point of one run on straights, on curves or on all of the path.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    fields = list(ErrorStatistics.__dataclass_fields__)
    writer.writerow(["run", "end_s", "where", "body", *fields])
    for run in runs:
        for where in ("straight", "curve", "all"):
            for point, error in getattr(run.statistics, where).by_point.items():
                writer.writerow([run.label, f"{run.end_s:.3f}", where, point, *astuple(error)])
    return stream.getvalue()


def _check_same_reference(first: Path, one: Record, second: Path, other: Record) -> None:
    """Raise `NotComparable` if the references of two runs differ at a common time."""
    if IMPORTED_KEY in one.metadata or IMPORTED_KEY in other.metadata:
        _check_same_line(first, one, second, other)
        return
    time_s, rows, other_rows = np.intersect1d(
        one[REFERENCE].time_s, other[REFERENCE].time_s, return_indices=True
    )
    if not len(time_s):
        raise NotComparable(f"{first} and {second}: have no time in common")
    fields = [field for body in BODIES for field in position_fields(body)]
    distance = np.abs(
        one[REFERENCE].columns(*fields)[rows] - other[REFERENCE].columns(*fields)[other_rows]
    ).max(axis=1)
    if distance.max() > _SAME_M:
        k = int(np.argmax(distance > _SAME_M))
        raise NotComparable(
            f"{first} and {second}: have different references (at {time_s[k]:.2f} s "
            f"{distance[k]:.3g} m apart); runs are compared on one path at one speed"
        )


def _check_same_line(first: Path, one: Record, second: Path, other: Record) -> None:
    """Raise `NotComparable` if a record was to drive another line than a run.

    The reference of a record is the nearest point of its line, at any speed.
    """
    fields = position_fields("tractor")
    lines = [record[REFERENCE].columns(*fields) for record in (one, other)]
    lines = [line[np.isfinite(line).all(axis=1)] for line in lines]
    for file, line in zip((first, second), lines, strict=True):
        if len(line) < 2:
            raise NotComparable(
                f"{file}: has no line that was to be driven: import it with --scenario, whose "
                "path.file is that line"
            )
    apart_m = min(_farthest(*lines), _farthest(*lines[::-1]))
    if apart_m > _SAME_LINE_M:
        raise NotComparable(
            f"{first} and {second}: the lines are {apart_m:.2f} m apart, must be within "
            f"{_SAME_LINE_M:g} m"
        )


def _farthest(points: FloatArray, line: FloatArray) -> float:
    """Return the largest distance of some of the points from a line [m]."""
    some = points[:: max(1, len(points) // 500)]
    begin = line[:-1]
    piece = np.diff(line, axis=0)
    squared = np.maximum(np.sum(piece**2, axis=1), np.finfo(float).tiny)
    largest = 0.0
    for point in some:
        along = np.clip(np.sum((point - begin) * piece, axis=1) / squared, 0.0, 1.0)
        gap = point - begin - along[:, None] * piece
        largest = max(largest, float(np.hypot(*gap.T).min()))
    return largest


def _label_parts(logs: Sequence[Path], records: Sequence[Record]) -> list[tuple[str, ...]]:
    titles = [
        (r.metadata["scenario"], r.metadata["controller"], f"seed {r.metadata['seed']}")
        for r in records
    ]
    counts = Counter(titles)
    # Logs have one name and differ by their folders.
    folders = [str(log.parent if log.name == "log.mcap" else log) for log in logs]
    return [
        (*title, folder if counts[title] > 1 else "")
        for title, folder in zip(titles, folders, strict=True)
    ]


def _joined(parts: Iterable[str]) -> str:
    return " · ".join(filter(None, parts))
