"""A polyline that a point follows, and its offsets from it."""

import math

import numpy as np

from ttempc.reference.path import Projection
from ttempc.types import FloatArray

_SPACING_M = 0.1  # between the points of an evenly spaced line


class FollowedLine:
    """A polyline (n, 2) [m] that a point follows in its order."""

    def __init__(self, points: FloatArray) -> None:
        self._points = points
        self._projection = Projection(points)

    @classmethod
    def evenly(cls, points: FloatArray) -> "FollowedLine":
        """Return the line through points that may be repeated or far apart."""
        steps = np.hypot(*np.diff(points, axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(2, math.ceil(along[-1] / _SPACING_M) + 1)
        at = np.linspace(0.0, along[-1], count)
        return cls(np.column_stack([np.interp(at, along, column) for column in points.T]))

    def offset(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of a point, see `Projection`, and its offset to the left [m]."""
        place = self._projection.place(x, y)
        k = min(int(place), len(self._points) - 2)
        (x_0, y_0), (x_1, y_1) = self._points[k : k + 2].tolist()
        along = x_1 - x_0
        across = y_1 - y_0
        length = math.hypot(along, across)
        return place, (along * (y - y_0) - across * (x - x_0)) / length if length else math.nan

    def offsets(self, places: FloatArray) -> FloatArray:
        """Return the offsets of places (n, 2) [m] in the order of time, (n,) [m]; NaN stays so."""
        offsets = np.full(len(places), math.nan)
        for row, (x, y) in enumerate(places.tolist()):
            if math.isfinite(x):
                _, offsets[row] = self.offset(x, y)
        return offsets
