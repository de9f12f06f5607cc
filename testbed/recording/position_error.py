"""Errors of axle points in the frames of their references."""

from __future__ import annotations

import numpy as np

from ttempc.types import FloatArray

from .channels import REFERENCE, STATE

_POINTS = (("x_t_m", "y_t_m", "psi_t_rad"), ("x_i_m", "y_i_m", "psi_i_rad"))


def in_frame(error: FloatArray, heading: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return errors along and across references, each (n,) [m], positive ahead and to the left.

    Args:
        error: position minus reference, (n, 2) [m] map frame.
        heading: of the references, (n,) [rad].
    """
    dx, dy = error.T
    cos, sin = np.cos(heading), np.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx


def error_rows(state: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the rows of `channels.ERROR` (n, fields) from rows of state and reference.

    Args:
        state: rows of `channels.STATE`, (n, fields).
        reference: rows of `channels.REFERENCE` of the same times, (n, fields).
    """
    columns = []
    with np.errstate(invalid="ignore"):  # a row that is not finite has errors that are NaN
        for names in _POINTS:
            at = state[:, [STATE.fields.index(name) for name in names]]
            due = reference[:, [REFERENCE.fields.index(name) for name in names]]
            along, cross = in_frame(at[:, :2] - due[:, :2], due[:, 2])
            turned = at[:, 2] - due[:, 2]
            heading = np.arctan2(np.sin(turned), np.cos(turned))
            columns += [along, cross, np.hypot(along, cross), heading]
    return np.column_stack(columns)
