"""Errors on the passes of a run and at its changes of curvature.

On a pass two standard deviations of the cross-track error stand side by side: the true one, and the
one that the machine itself sees, by its own receivers and filter. Field records of guided machines
have the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import ESTIMATE, REFERENCE, STATE, TOOL, in_frame
from ...testbed.recording.record import Record
from .stretches import curvature_changes, passes
from .tracking_errors import BODIES, TrackingErrors, counted, position_fields, rows_at_same_time

_LEAST_ROWS: Final = 10  # counted control ticks of a pass; fewer tell no standard deviation


def peaks(record: Record, errors: TrackingErrors) -> dict[str, FloatArray]:
    """Return the largest absolute cross-track error of each point at each curvature change [m].

    Changes before the errors count are left out, and so is a tool that is raised.
    """
    _, _, reference = rows_at_same_time(record, STATE, REFERENCE)
    changes = curvature_changes(record)
    found: dict[str, FloatArray] = {}
    for point, error in errors.by_point.items():
        largest: list[float] = []
        for first, end in zip(changes.first, changes.end, strict=True):
            rows = errors.counted & (reference >= first) & (reference < end)
            cross = np.abs(error.cross_m[rows])
            cross = cross[np.isfinite(cross)]
            if cross.size:
                largest.append(float(cross.max()))
        found[point] = np.array(largest)
    return found


@dataclass(frozen=True, slots=True)
class SeenErrors:
    """Cross-track errors at the control ticks: the true ones, and those that the machine sees."""

    time_s: FloatArray  # (n,)
    reference: NDArray[np.intp]  # (n,) rows of the reference
    true_m: dict[str, FloatArray]  # (n,) by point; NaN where the tool is not lowered
    seen_m: dict[str, FloatArray]  # (n,) the same by the estimate


def seen_errors(record: Record) -> SeenErrors:
    """Return true and seen cross-track errors of both axle points, and of the tool if any."""
    state_s, state, estimate = rows_at_same_time(record, STATE, ESTIMATE)
    _, kept, reference = np.intersect1d(state_s, record[REFERENCE].time_s, return_indices=True)
    state = state[kept]
    estimate = estimate[kept]
    true: dict[str, FloatArray] = {}
    seen: dict[str, FloatArray] = {}
    line = record[REFERENCE]
    for body, letter in BODIES.items():
        fields = position_fields(body)
        on_line = line.columns(*fields)[reference]
        heading = line[f"psi_{letter}_rad"][reference]
        true[body] = in_frame(record[STATE].columns(*fields)[state] - on_line, heading)[1]
        seen[body] = in_frame(record[ESTIMATE].columns(*fields)[estimate] - on_line, heading)[1]
    tool = record.tables.get(TOOL.topic)
    if tool is not None and len(tool):
        rows = np.searchsorted(tool.time_s, state_s[kept])
        raised = tool["lowered"][rows] < 1.0
        heading = line["psi_i_rad"][reference]
        offset = tool.columns("x_m", "y_m") - tool.columns("x_reference_m", "y_reference_m")
        turned = record[ESTIMATE]["psi_i_rad"][estimate] - heading
        true["tool"] = in_frame(offset[rows], heading)[1]
        seen["tool"] = seen["trailer"] - _behind(record) * np.sin(turned)
        true["tool"][raised] = np.nan
        seen["tool"][raised] = np.nan
    return SeenErrors(state_s[kept], reference, true, seen)


def _behind(record: Record) -> float:
    """Return the distance of the tool behind the trailer's axle, by their references [m]."""
    tool = record[TOOL]
    line = record[REFERENCE]
    row = np.searchsorted(line.time_s, tool.time_s[0])
    offset = tool.columns("x_reference_m", "y_reference_m")[0]
    return float(np.hypot(*(offset - line.columns(*position_fields("trailer"))[row])))


def pass_spreads(record: Record) -> tuple[int, dict[str, tuple[FloatArray, FloatArray]]]:
    """Return the number of passes, and true and seen standard deviations on each by point [m]."""
    errors = seen_errors(record)
    time_counts = counted(record, errors.time_s)
    number = passes(record).numbers(len(record[REFERENCE]))[errors.reference]
    spreads: dict[str, tuple[FloatArray, FloatArray]] = {}
    count = 0
    for point, true_m in errors.true_m.items():
        seen_m = errors.seen_m[point]
        known = time_counts & np.isfinite(true_m) & np.isfinite(seen_m)
        rows = [known & (number == index) for index in range(number.max(initial=-1) + 1)]
        rows = [each for each in rows if each.sum() >= _LEAST_ROWS]
        spreads[point] = (_deviations(true_m, rows), _deviations(seen_m, rows))
        count = max(count, len(rows))
    return count, spreads


def _deviations(error_m: FloatArray, rows: list[NDArray[np.bool_]]) -> FloatArray:
    """Return the standard deviation of errors on each of the passes, (passes,) [m]."""
    return np.array([float(np.std(error_m[each])) for each in rows])
