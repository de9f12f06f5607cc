"""Corridor and hitch limit as soft bounds on outputs of the articulated error model."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..reference.corridor import Corridor
from ..reference.reference import ReferenceSample
from ..types import FloatArray, State
from .qp import OutputBounds

_ACROSS: Final = [1, 3]  # rows of C with the cross-track errors of tractor and trailer point


def corridor_bounds(
    corridor: Corridor,
    grid: ReferenceSample,
    outputs: FloatArray,
    first: int,
) -> OutputBounds:
    """Return the bounds on the predicted error that keep the vehicle in its corridor.

    The rows are the cross-track errors of tractor and trailer point, that of the tool point where
    there is one, and the error of the hitch angle where it is limited. With a tool l behind the
    trailer point and beta = psi_t - psi_i - delta_i, they are to first order

        y_tool = y_i - l psi_i,    beta_e = psi_t - psi_i - delta_i    of the error z_e,

    and |beta_r - beta_e| is at most the limit. Errors are those to the reference of the same time:
    on a curve the vehicle has to be near it along the path, too.

    Args:
        corridor: to keep to.
        grid: the reference at N + 1 ticks.
        outputs: C (N + 1, 4, n) of `error_dynamics`.
        first: stage of the horizon from which on the bounds hold.

    Raises:
        InvalidTuning: the reference itself is beyond the limit of the hitch angle, with numbers.
    """
    ticks, _, n = outputs.shape
    corridor.require_hitch(grid.hitch_angle)
    half_width = corridor.half_width(grid.distance_m)
    rows = [outputs[:, row] for row in _ACROSS]
    upper = [half_width, half_width]
    if corridor.tool_behind_m is not None:
        behind = np.zeros(n)
        behind[State.PSI_I] = corridor.tool_behind_m
        rows.append(rows[1] - behind)
        upper.append(half_width)
    lower = [-bound for bound in upper]
    if corridor.hitch_limit is not None:
        beta, limit = grid.hitch_angle, corridor.hitch_limit
        hitch = np.zeros((ticks, n))
        hitch[:, [State.PSI_T, State.PSI_I, State.DELTA_I]] = 1.0, -1.0, -1.0
        rows.append(hitch)
        lower.append(beta - limit)
        upper.append(beta + limit)
    return OutputBounds(np.stack(rows, 1), np.stack(lower, 1), np.stack(upper, 1), first)
