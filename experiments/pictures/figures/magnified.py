"""Driven paths whose distance from the line is drawn larger than it is.

An error of centimetres on a path of 50 m is thinner than the line. Drawn many times as large beside
the line, it shows where a vehicle is off, and to which side.
"""

from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.recording.channels import REFERENCE, STATE
from ....testbed.recording.record import Record
from ...results.tracking_errors import (
    BODIES,
    TrackingErrors,
    position_fields,
    rows_at_same_time,
)

_SHARE: Final = 0.06  # of the extent of the path, which a large error takes
_LARGE: Final = 99.0  # [%] of the errors are not larger
_ROUND: Final = (1.0, 2.0, 5.0, 10.0)  # leading digits of a factor


def magnification(extent_m: float, errors: list[FloatArray]) -> float:
    """Return the factor 1, 2, 5, 10, 20 ... by which errors are drawn larger, at least 1.

    Args:
        extent_m: the longer side of the path [m].
        errors: errors across the line [m]; entries that are NaN do not count.
    """
    sizes = np.abs(np.concatenate([*errors, [0.0]]))
    large_m = float(np.percentile(sizes[np.isfinite(sizes)], _LARGE))
    if not large_m > 0.0:
        return 1.0
    wanted = max(1.0, _SHARE * extent_m / large_m)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(digit for digit in _ROUND if digit * power <= wanted))


def counted_errors(errors: TrackingErrors) -> dict[str, FloatArray]:
    """Return the errors of each point to the left of the line [m], NaN where they do not count."""
    return {
        name: np.where(errors.counted, error.cross_m, np.nan)
        for name, error in errors.by_point.items()
    }


def line_of(record: Record, body: str) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) [m] and headings (n,) [rad] of a body's reference at rows of errors."""
    _, _, rows = rows_at_same_time(record, STATE, REFERENCE)
    table = record[REFERENCE]
    return table.columns(*position_fields(body))[rows], table[f"psi_{BODIES[body]}_rad"][rows]


def beside(points: FloatArray, headings: FloatArray, offset_m: FloatArray) -> FloatArray:
    """Return points (n, 2) moved to the left of their headings by offsets (n,) [m]."""
    left = np.column_stack([-np.sin(headings), np.cos(headings)])
    return points + offset_m[:, None] * left


def extent_of(points: FloatArray) -> float:
    """Return the longer side of the box around points (n, 2) [m], 0 without any."""
    finite = np.isfinite(points).all(axis=1)
    return float(np.ptp(points[finite], axis=0).max()) if finite.any() else 0.0
