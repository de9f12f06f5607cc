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
    """

    def __init__(self, grid: ReferenceSample) -> None:
        self._to_map = np.zeros((len(grid.state), 4, 4))
        self._to_map[:, :2, :2] = rotation(grid.state[:, State.PSI_T])
        self._to_map[:, 2:, 2:] = rotation(grid.state[:, State.PSI_I])
        self._reference = np.concatenate([grid.state[:, :2], grid.trailer_xy], axis=1)

    def of(self, k: int, errors: FloatArray, plan: FloatArray) -> FloatArray:
        """Return x_t, y_t, x_i, y_i [m], map frame, under the plan of tick `k`, (Np, 4).

        Args:
            k: the tick.
            errors: (Np, 4, p) matrices from the plan to the position errors of tractor (x, y) and
                trailer (x, y) in the frames of the reference.
            plan: (p,)
        """
        ahead = slice(k + 1, k + 1 + len(errors))
        path = self._reference[ahead]
        in_frames = (errors.reshape(path.size, -1) @ plan).reshape(*path.shape, 1)
        return path - (self._to_map[ahead] @ in_frames)[..., 0]
