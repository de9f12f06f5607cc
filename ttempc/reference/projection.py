"""Nearest place on a polyline, followed from call to call."""

from __future__ import annotations

import math

import numpy as np

from ..types import FloatArray

_REACH_M = 3.0  # along the polyline, each way, from the last place; assumed


class Projection:
    """Orthogonal projection of points that move along a polyline.

    The search covers some metres about the last place alone, so that a path that crosses itself is
    followed in its order. The first call searches from the first point on.

    Args:
        points: (N, 2) [m], N of 2 or more.
    """

    def __init__(self, points: FloatArray) -> None:
        self._points = points[:-1]
        self._segments = np.diff(points, axis=0)
        squared = np.sum(np.square(self._segments), axis=1)
        self._squared = np.maximum(squared, np.finfo(float).tiny)
        spacing = float(np.sqrt(squared).mean())
        self._reach = math.ceil(_REACH_M / max(spacing, _REACH_M / len(squared)))
        self._last = 0

    def place(self, x: float, y: float) -> float:
        """Return the index of the nearest place, its fraction within a segment included."""
        first = max(0, self._last - self._reach)
        window = slice(first, self._last + self._reach + 1)
        offset = np.array([x, y]) - self._points[window]
        segments = self._segments[window]
        along = np.clip(np.sum(offset * segments, axis=1) / self._squared[window], 0.0, 1.0)
        distance = np.sum(np.square(offset - along[:, None] * segments), axis=1)
        nearest = int(np.argmin(distance))
        self._last = first + nearest
        return self._last + float(along[nearest])

    def fresh(self) -> Projection:
        """Return a projection on the same polyline before its first call."""
        return Projection(np.vstack([self._points, self._points[-1:] + self._segments[-1:]]))
