"""Predicted path of both axle points: the reference less the predicted errors."""

from __future__ import annotations

import numpy as np

from ..reference.reference import ReferenceSample
from ..types import FloatArray, State


def rotation(angle: FloatArray) -> FloatArray:
    """Return the rotation matrices by `angle` (N,) [rad], counter-clockwise, (N, 2, 2)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


class PredictedPath:
    """Path of both axle points under a plan, to first order in the errors.

    Args:
        grid: the reference at every tick.
        errors: (ticks, Np, 4, p) matrices from the plan of a tick to the position errors of
            tractor (x, y) and trailer (x, y) in the frames of the reference.
    """

    def __init__(self, grid: ReferenceSample, errors: FloatArray) -> None:
        ticks, horizon = errors.shape[:2]
        ahead = 1 + np.arange(ticks)[:, None] + np.arange(horizon)  # (ticks, Np)
        to_map = np.zeros((*ahead.shape, 4, 4))
        to_map[..., :2, :2] = rotation(grid.state[:, State.PSI_T])[ahead]
        to_map[..., 2:, 2:] = rotation(grid.state[:, State.PSI_I])[ahead]
        self._by_plan = (-to_map @ errors).reshape(ticks, 4 * horizon, -1)
        self._reference = np.concatenate([grid.state[:, :2], grid.trailer_xy], axis=1)[ahead]

    def of(self, k: int, plan: FloatArray) -> FloatArray:
        """Return x_t, y_t, x_i, y_i [m], map frame, under the `plan` (p,) of tick k, (Np, 4)."""
        path = self._reference[k]
        return path + (self._by_plan[k] @ plan).reshape(path.shape)
