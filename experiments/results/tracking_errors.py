"""Tracking errors of tractor, trailer and tool against their time-based references."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE, STATE, TOOL, Channel, in_frame
from ...testbed.recording.record import REACTION, REACTION_ENDED, Record
from ...testbed.simulation.termination import TerminationLimits

START_UP_S: Final = 8.0
"""Time from standstill that statistics and figures leave out."""

BODIES: Final = {"tractor": "t", "trailer": "i"}  # body: the paper's letter in the field names

# A reference counts as curved from 1 % of its largest curvature on: the blends between line and
# arc then count as curve, and rounding errors on a line do not.
_CURVED_FRACTION: Final = 0.01
_STRAIGHT_PER_M: Final = 1e-6  # a path whose largest curvature is below this is a straight line


@dataclass(frozen=True, slots=True)
class BodyError:
    """Position error of one axle point in the frame of its reference."""

    along_m: FloatArray  # (n,) positive ahead of the reference
    cross_m: FloatArray  # (n,) positive to the left of the reference

    @property
    def euclidean_m(self) -> FloatArray:
        """Distance to the reference, (n,)."""
        return np.hypot(self.along_m, self.cross_m)

    def at(self, rows: NDArray[np.bool_]) -> BodyError:
        """Return the error at the rows that are True."""
        return BodyError(self.along_m[rows], self.cross_m[rows])


@dataclass(frozen=True, slots=True)
class TrackingErrors:
    """Errors at all times at which both the state and its reference are recorded."""

    time_s: FloatArray  # (n,)
    curved: NDArray[np.bool_]  # (n,) by the reference's curvature at the tractor point
    counted: NDArray[np.bool_]  # (n,) see `counted`
    tractor: BodyError
    trailer: BodyError
    tool: BodyError | None = None  # of an implement's tool point, NaN while it is not lowered

    @property
    def by_point(self) -> dict[str, BodyError]:
        """Return the errors by the name of their point: tractor, trailer, tool if any."""
        points = {"tractor": self.tractor, "trailer": self.trailer}
        return points if self.tool is None else {**points, "tool": self.tool}

    def until(self, end_s: float) -> TrackingErrors:
        """Return the errors up to a time."""
        rows = self.time_s <= end_s
        points = {name: error.at(rows) for name, error in self.by_point.items()}
        return TrackingErrors(self.time_s[rows], self.curved[rows], self.counted[rows], **points)


def counted(record: Record, time_s: FloatArray) -> NDArray[np.bool_]:
    """Return which times count in statistics, (n,).

    The start-up does not count, nor the time at the end in which a vehicle stands that the
    supervisor has stopped: its reference may have gone on.
    """
    ends = [event.time_s for event in record.events if event.text == REACTION_ENDED]
    starts = [event.time_s for event in record.events if event.text.startswith(REACTION)]
    stop_s = min((start for start in starts if start > max(ends, default=-1.0)), default=np.inf)
    table = record[STATE]
    moving = table.time_s[~(np.abs(table["v_mps"]) < TerminationLimits().standing)]
    return (time_s >= START_UP_S) & (time_s <= max(stop_s, moving.max(initial=0.0)))


def tracking_errors(record: Record) -> TrackingErrors:
    """Return the errors of all points against their time-based references."""
    time_s, state, reference = rows_at_same_time(record, STATE, REFERENCE)
    errors = {body: body_error(record, state, reference, body) for body in BODIES}
    tool = _tool_error(record, time_s, reference)
    curved = is_curved(record)[reference]
    return TrackingErrors(time_s, curved, counted(record, time_s), **errors, tool=tool)


def is_curved(record: Record) -> NDArray[np.bool_]:
    """Return for each row of the reference whether it counts as curve."""
    curvature = np.abs(record[REFERENCE]["curvature_per_m"])
    largest = float(curvature.max(initial=0.0, where=np.isfinite(curvature)))
    return curvature > max(_CURVED_FRACTION * largest, _STRAIGHT_PER_M)


def rows_at_same_time(
    record: Record, first: Channel, second: Channel
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]]:
    """Return the common times of two channels and the rows of each at these times.

    The simulation stamps rows of one moment with the same number. The times are compared exactly,
    and nothing is interpolated.
    """
    return np.intersect1d(
        record[first].time_s, record[second].time_s, assume_unique=False, return_indices=True
    )


def position_fields(body: str) -> tuple[str, str]:
    """Return the field names of a body's axle point in the channels with poses."""
    letter = BODIES[body]
    return f"x_{letter}_m", f"y_{letter}_m"


def body_error(
    record: Record, state: NDArray[np.intp], reference: NDArray[np.intp], body: str
) -> BodyError:
    """Return the position error of one body at rows (n,) of state and reference of equal times."""
    fields = position_fields(body)
    position = record[STATE].columns(*fields)[state]
    error = position - record[REFERENCE].columns(*fields)[reference]
    heading = record[REFERENCE][f"psi_{BODIES[body]}_rad"][reference]
    return BodyError(*in_frame(error, heading))


def _tool_error(
    record: Record, time_s: FloatArray, reference: NDArray[np.intp]
) -> BodyError | None:
    """Return the error of the tool point at times and reference rows (n,), None without one."""
    table = record.tables.get(TOOL.topic)
    if table is None or not len(table):
        return None
    rows = np.searchsorted(table.time_s, time_s)
    error = table.columns("x_m", "y_m") - table.columns("x_reference_m", "y_reference_m")
    error[table["lowered"] < 1.0] = np.nan
    return BodyError(*in_frame(error[rows], record[REFERENCE]["psi_i_rad"][reference]))
