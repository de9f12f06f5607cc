"""How far tractor and trailer were from where they should have been, at every recorded moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from proving_ground.testbed.recording.channels import REFERENCE, STATE, Channel
from proving_ground.testbed.recording.record import Record
from ttempc.types import FloatArray

START_UP_S: Final = 8.0  # the vehicle starts from standstill; this time counts in no statistic

BODIES: Final = {"tractor": "t", "trailer": "i"}  # and the paper's letter in the fields' names

# A reference counts as curved from 1 % of its sharpest curvature on, so that the blends between
# line and arc count as curve, and the numerical dust on a line does not.
_CURVED_FRACTION: Final = 0.01
_STRAIGHT_PER_M: Final = 1e-6  # a path that is nowhere sharper than this is a straight line


@dataclass(frozen=True, slots=True)
class BodyError:
    """The position error of one axle point in the frame of its own reference."""

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
class Tracking:
    """Errors at every time at which both the state and its reference are on record."""

    time_s: FloatArray  # (n,)
    curved: NDArray[np.bool_]  # (n,) by the reference's curvature at the tractor point
    tractor: BodyError
    trailer: BodyError

    def until(self, end_s: float) -> Tracking:
        """Return the errors up to a time."""
        rows = self.time_s <= end_s
        tractor, trailer = self.tractor.at(rows), self.trailer.at(rows)
        return Tracking(self.time_s[rows], self.curved[rows], tractor, trailer)


def tracking(record: Record) -> Tracking:
    """Return the errors of both axle points against their time-based references."""
    time_s, state, reference = rows_at_same_time(record, STATE, REFERENCE)
    errors = {body: _body_error(record, state, reference, body) for body in BODIES}
    return Tracking(time_s, is_curved(record)[reference], **errors)


def is_curved(record: Record) -> NDArray[np.bool_]:
    """Return where the reference of a run counts as curve, one for each of its rows."""
    curvature = np.abs(record[REFERENCE]["curvature_per_m"])
    sharpest = float(curvature.max(initial=0.0, where=np.isfinite(curvature)))
    return curvature > max(_CURVED_FRACTION * sharpest, _STRAIGHT_PER_M)


def rows_at_same_time(
    record: Record, first: Channel, second: Channel
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]]:
    """Return the times that both channels have, and the rows of both at these times.

    The loop stamps what belongs together with one and the same number: times are compared
    exactly, and nothing is interpolated.
    """
    return np.intersect1d(
        record[first].time_s, record[second].time_s, assume_unique=False, return_indices=True
    )


def _body_error(
    record: Record, state: NDArray[np.intp], reference: NDArray[np.intp], body: str
) -> BodyError:
    letter = BODIES[body]
    place = [f"x_{letter}_m", f"y_{letter}_m"]
    dx, dy = (record[STATE].columns(*place)[state] - record[REFERENCE].columns(*place)[reference]).T
    heading = record[REFERENCE][f"psi_{letter}_rad"][reference]
    cos, sin = np.cos(heading), np.sin(heading)
    return BodyError(cos * dx + sin * dy, cos * dy - sin * dx)
