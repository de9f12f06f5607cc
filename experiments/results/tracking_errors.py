"""Tracking errors against the time-based references, and their containment in a tube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE, STATE, TOOL, TUBE, Channel, in_frame
from ...testbed.recording.record import REACTION, REACTION_ENDED, Record
from ...testbed.simulation.termination import TerminationLimits
from .stretches import LEAD_M, is_curved, passes

START_UP_S: Final = 8.0
"""Time from standstill that statistics and figures leave out."""

BODIES: Final = {"tractor": "t", "trailer": "i"}  # body: the paper's letter in the field names


QUANTITIES: Final = tuple(
    name.removesuffix("_nominal") for name in TUBE.fields if name.endswith("_nominal")
)
"""Quantities that a tube bounds: errors of the minimal state, then x and y of the trailer point."""

_POSITION_ERRORS: Final = {"tractor": ("x_t_e_m", "y_t_e_m"), "trailer": ("x_i_e_m", "y_i_e_m")}
_SCALARS: Final = ("psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
_SCALAR_ERRORS: Final = {"_e_".join(name.rsplit("_", 1)): name for name in _SCALARS}  # z_r - z


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
    on_pass: NDArray[np.bool_]  # (n,) on a pass, or in the last 5 m of the turn before it
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
        masks = (self.curved[rows], self.counted[rows], self.on_pass[rows])
        return TrackingErrors(self.time_s[rows], *masks, **points)


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
    on_pass = passes(record, LEAD_M).numbers(len(record[REFERENCE]))[reference] >= 0
    return TrackingErrors(time_s, curved, counted(record, time_s), on_pass, **errors, tool=tool)


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


@dataclass(frozen=True)
class Containment:
    """Deviation of the true error from the nominal error at the control ticks after start-up."""

    time_s: FloatArray  # (n,)
    curved: NDArray[np.bool_]  # (n,)
    deviation: FloatArray  # (n, 9) in the order of `QUANTITIES`
    half_width: FloatArray  # (n, 9) of the tube

    POINTS: ClassVar = [
        QUANTITIES.index(name) for names in _POSITION_ERRORS.values() for name in names
    ]
    """Columns of the position errors of both axle points."""

    ACROSS: ClassVar = {body: QUANTITIES.index(y) for body, (_, y) in _POSITION_ERRORS.items()}
    """Column of the cross-track error of each body."""

    @property
    def normalised_deviation(self) -> FloatArray:
        """Absolute deviation over half width, (n, 9); at most 1 inside the tube."""
        return np.abs(self.deviation) / self.half_width

    @property
    def margin(self) -> FloatArray:
        """1 minus the largest normalised deviation of both true axle points, (n,); inside: >= 0."""
        return 1.0 - self.normalised_deviation[:, self.POINTS].max(axis=1)


def containment(record: Record) -> Containment:
    """Return the containment of a run at the common times of state, reference and tube."""
    tables = [record[channel] for channel in (TUBE, STATE, REFERENCE)]
    time_s = tables[0].time_s[counted(record, tables[0].time_s)]
    for table in tables[1:]:
        time_s = time_s[np.isin(time_s, table.time_s)]
    tube, state, reference = (np.searchsorted(table.time_s, time_s) for table in tables)
    error = _true_error(record, state, reference)
    nominal = record[TUBE].columns(*(f"{name}_nominal" for name in QUANTITIES))[tube]
    half_width = record[TUBE].columns(*(f"{name}_half_width" for name in QUANTITIES))[tube]
    return Containment(time_s, is_curved(record)[reference], error - nominal, half_width)


def _true_error(record: Record, state: NDArray[np.intp], reference: NDArray[np.intp]) -> FloatArray:
    """Return the true errors z_e = T (z_r - z), (n, 9), in the order of `QUANTITIES`."""
    columns = {}
    for body, (along, cross) in _POSITION_ERRORS.items():
        # The position errors of `tracking_errors` are z - z_r in the same frame.
        error = body_error(record, state, reference, body)
        columns[along] = -error.along_m
        columns[cross] = -error.cross_m
    for name, field in _SCALAR_ERRORS.items():
        error = record[REFERENCE][field][reference] - record[STATE][field][state]
        if name.startswith("psi"):
            error = np.remainder(error + np.pi, 2.0 * np.pi) - np.pi
        columns[name] = error
    return np.column_stack([columns[name] for name in QUANTITIES])
