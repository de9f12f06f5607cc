"""Smoothing of a polygon of points to a path of continuous curvature."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import InvalidPath
from ..types import FloatArray
from .path import Path, Segment

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_SPACING_M = 0.25  # of the samples of the polygon to which the spline is fitted
_REPEATED_M = 1e-6  # points closer together count as repeated
_WEIGHT_AT_ENDS = 1e4  # so that path and polygon have the same ends
# Penalty of the spline for samples 1 m apart: features shorter than about 2 pi penalty^(1/4) m are
# smoothed out. The range spans noise of millimetres to the length of a field.
_LEAST_PENALTY = 1e-6
_LARGEST_PENALTY = 1e6
_MOST_SAMPLES = 40_000  # 10 km in steps of 0.25 m; a minute of smoothing
_HALVINGS = 20  # bisection steps on the logarithm of the penalty
_NEAREST_M = 0.002  # from the polygon that a path keeps at least: half the dip of points 1 m apart
# on a radius of 30 m, which is no corner that anyone has drawn
_CLOSE_ENOUGH = 0.2  # of logarithms of penalties: a distance from the polygon within some 10 %
_CORRECTIONS = 2  # of the drift of the integrated curvature; each reduces it to a hundredth
_KEPT = 2  # paths; one of 10 km has some 80 MB
_LEAST_PACE = 0.2  # metres of path per metre of polygon; below, the polygon turns back
# Gauss-Legendre on [-1, 1]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedPath:
    """A path along a polygon of points."""

    path: Path
    distance_m: FloatArray  # (n,) arc length of the path at each point [m]
    deviation_m: float  # largest distance between polygon and path [m]


def smooth(
    points: FloatArray,
    max_deviation_m: float,
    suits: Callable[[Path], bool] | None = None,
) -> SmoothedPath:
    """Return a path of continuous curvature within `max_deviation_m` [m] of the polygon.

    `points` are (n, 2) [m]. A natural cubic smoothing spline

        min  sum |p(u_j) - q_j|^2 + penalty * integral |p''(u)|^2 du

    is fitted to samples q_j of the polygon over its length u. The distance from p(u) to q(u) bounds
    that from path to polygon and from polygon to path. Without `suits` the penalty is the largest
    (by bisection) for which it is at most 99 % of `max_deviation_m`: the smoothest path. With it,
    the penalty is the smallest whose path suits, from 2 mm of distance on: the nearest path that a
    vehicle can drive. Where none suits, the smoothest path is returned.

    The path is the integral of the curvature of the spline, linear in arc length between knots: C2,
    |dp/ds| = 1 to rounding, zero curvature at both ends. The deviation that is returned is that of
    the path.

    The last paths are kept: all runs of a sweep drive the same few. `suits` is therefore hashable;
    two that are equal decide alike.

    Raises:
        InvalidPath: fewer than two points, a point that is not finite or repeated, or a polygon
            that turns back on itself, with index, place and length along the polygon; or
            `max_deviation_m` is not above 0 or too small for the points, or the line is too long.

    Examples:
        >>> points = np.array([[0.0, 0.0], [20.0, 0.0], [40.0, 8.0]])
        >>> smoothed = smooth(points, max_deviation_m=0.3)
        >>> smoothed.deviation_m <= 0.3
        True
    """
    if not (math.isfinite(max_deviation_m) and max_deviation_m > 0.0):
        raise InvalidPath(f"max_deviation_m: got {max_deviation_m}, must be finite and above 0")
    points = np.asarray(points, dtype=np.float64)  # `_smoothed` reads its memory as such
    return _smoothed(points.tobytes(), points.shape, max_deviation_m, suits)


@functools.lru_cache(maxsize=_KEPT)
def _smoothed(
    points: bytes,
    shape: tuple[int, ...],
    max_deviation_m: float,
    suits: Callable[[Path], bool] | None,
) -> SmoothedPath:
    """Do `smooth`, of the points (n, 2) in the memory of an array of doubles."""
    polygon = _Polygon.of(np.frombuffer(points, dtype=np.float64).reshape(shape))
    smoothest = polygon.largest_penalty_within(0.99 * max_deviation_m)
    chosen = polygon.path_of(smoothest)
    if suits is not None:
        nearest = polygon.largest_penalty_within(min(_NEAREST_M, 0.99 * max_deviation_m))
        chosen = _first_that_suits(polygon, nearest, smoothest, suits) or chosen
    if chosen.deviation_m > max_deviation_m:
        raise InvalidPath(
            f"path: smoothed, it is {chosen.deviation_m:.3g} m beside its points; max_deviation_m "
            f"= {max_deviation_m:g} is too little for points like these"
        )
    chosen.distance_m.flags.writeable = False  # it is kept
    return chosen


def _first_that_suits(
    polygon: _Polygon, nearest: float, smoothest: float, suits: Callable[[Path], bool]
) -> SmoothedPath | None:
    """Return the path of the smallest penalty that suits, by bisection; None if none does.

    `nearest` and `smoothest` are the logarithms of the penalties between which it lies.
    """
    with contextlib.suppress(InvalidPath):  # so close to its points it turns back on itself
        path = polygon.path_of(nearest)
        if suits(path.path):
            return path
    found = polygon.path_of(smoothest)
    if not suits(found.path):
        return None
    low = nearest
    high = smoothest
    while high - low > _CLOSE_ENOUGH:
        middle = 0.5 * (low + high)
        with contextlib.suppress(InvalidPath):
            path = polygon.path_of(middle)
            if suits(path.path):
                found = path
                high = middle
                continue
        low = middle
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Polygon:
    """Polygon through points, sampled, and the paths that smooth it.

    A penalty is given by its logarithm.
    """

    points: FloatArray  # (n, 2) [m]
    along: FloatArray  # (n,) length of the polygon up to each point [m]
    samples: FloatArray  # (m,) lengths of the samples [m]
    line: FloatArray  # (m, 2) samples of the polygon [m]
    between: FloatArray  # (2 m - 1,) lengths of the samples and of the middles between them [m]
    targets: FloatArray  # (2 m - 1, 2) the polygon there [m]

    @classmethod
    def of(cls, points: FloatArray) -> _Polygon:
        """Return the polygon of points (n, 2) [m]; refuse invalid points."""
        along = _lengths(points)
        samples = _sampled(along)
        between = np.union1d(samples, 0.5 * (samples[1:] + samples[:-1]))

        def at(lengths: FloatArray) -> FloatArray:
            columns = [np.interp(lengths, along, points[:, axis]) for axis in (0, 1)]
            return np.column_stack(columns)

        return cls(points, along, samples, at(samples), between, at(between))

    def largest_penalty_within(self, deviation_m: float) -> float:
        """Return the penalty of the smoothest spline within a distance of the polygon [m]."""
        low = math.log(_LEAST_PENALTY)
        high = math.log(_LARGEST_PENALTY)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            spline = _fitted(self.samples, self.line, middle)
            if _farthest(spline(self.between), self.targets) <= deviation_m:
                low = middle
            else:
                high = middle
        return low

    def path_of(self, penalty: float) -> SmoothedPath:
        """Return the path of a penalty.

        Raises:
            InvalidPath: it turns back on itself.
        """
        line = self.line.copy()
        spline = _fitted(self.samples, line, penalty)
        smoothed = spline(self.between)
        path, travelled = _integrated(spline, self.between, self.along, self.points)
        for _ in range(_CORRECTIONS):
            drift = path.pose(travelled)[:, :2] - smoothed
            line -= drift[::2]  # every other of `between` is a sample
            spline = _fitted(self.samples, line, penalty)
            path, travelled = _integrated(spline, self.between, self.along, self.points)
        deviation = _farthest(path.pose(travelled)[:, :2], self.targets)
        return SmoothedPath(path, np.interp(self.along, self.between, travelled), deviation)


def _lengths(points: FloatArray) -> FloatArray:
    """Return the length of the polygon up to each point (n,) [m]; refuse invalid points."""
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise InvalidPath(f"path: got {len(points)} points, must be two or more of x and y")
    invalid = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(invalid):
        x, y = points[invalid[0]]
        raise InvalidPath(f"path: point {invalid[0]} is ({x}, {y}), must be finite")
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    repeated = np.flatnonzero(steps < _REPEATED_M)
    if len(repeated):
        index = int(repeated[0]) + 1
        raise InvalidPath(
            f"path: point {index} at {_place(points[index], along[index])} repeats the one before "
            "it, points must differ"
        )
    return along


def _sampled(along: FloatArray) -> FloatArray:
    """Return the lengths of the samples (m,) [m]: those of all points and some in between.

    Raises:
        InvalidPath: there are too many.
    """
    counts = np.maximum(1.0, np.ceil(np.diff(along) / _SPACING_M))
    if counts.sum() > _MOST_SAMPLES:
        raise InvalidPath(
            f"path: {len(along)} points over {along[-1]:.6g} m make {counts.sum():.6g} samples "
            f"of the line, at most {_MOST_SAMPLES}: one a point, and one every {_SPACING_M} m"
        )
    parts = [
        np.linspace(first, last, max(1, math.ceil((last - first) / _SPACING_M)), endpoint=False)
        for first, last in pairwise(along)
    ]
    samples = np.concatenate([*parts, along[-1:]])
    return (
        samples if len(samples) >= 5 else np.linspace(0.0, along[-1], 5)
    )  # the fewest that the spline takes


def _fitted(samples: FloatArray, line: FloatArray, log_penalty: float) -> BSpline:
    """Return the smoothing spline of the points `line` (m, 2) at the lengths `samples` (m,).

    The weights make the penalty independent of the spacing.
    """
    weights = np.gradient(samples)
    weights[[0, -1]] *= _WEIGHT_AT_ENDS
    return scipy.interpolate.make_smoothing_spline(samples, line, weights, math.exp(log_penalty))


def _farthest(one: FloatArray, other: FloatArray) -> float:
    """Return the largest distance between points of the same index, both (m, 2) [m]."""
    return float(np.max(np.hypot(*(one - other).T)))


def _integrated(
    spline: BSpline, at: FloatArray, along: FloatArray, points: FloatArray
) -> tuple[Path, FloatArray]:
    """Return the path with the curvature of the spline, and its arc length (m,) at `at` (m,) [m].

    The parameters `at` include the knots of the spline. Between them its curvature is not quite
    linear: the path drifts from the spline by millimetres in 100 m, which the caller corrects.
    """
    velocity = spline.derivative()
    bend = spline.derivative(2)
    half = 0.5 * np.diff(at)
    node = at[:-1, None] + half[:, None] * (1.0 + _NODES)  # (n - 1, 3)
    steps = half * (np.linalg.norm(velocity(node), axis=-1) @ _WEIGHTS)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    pace = np.linalg.norm(velocity(at), axis=-1)
    worst = int(np.argmin(pace))
    if pace[worst] < _LEAST_PACE:
        index = int(np.searchsorted(along, at[worst]))
        raise InvalidPath(
            f"path: turns back on itself near point {index} at {_place(points[index], at[worst])}"
        )
    vx, vy = velocity(at).T
    ax, ay = bend(at).T
    curvature = (vx * ay - vy * ax) / pace**3
    curvature[[0, -1]] = 0.0  # natural ends
    lengths = np.diff(travelled).tolist()
    kappa = curvature.tolist()
    segments = tuple(map(Segment, lengths, kappa[:-1], kappa[1:]))
    x, y = spline(0.0).tolist()
    return Path(segments, (x, y, math.atan2(vy[0], vx[0]))), travelled


_THINNED_M = (0.05, 0.1, 0.2, 0.5)  # distances of points that are tried one after the other
_BACK = math.radians(90.0)  # turn at a point that a polygon through noise has and a track has not
_CUSP = math.radians(150.0)  # turn of a line that comes back on itself
_CHORD_M = 0.5  # over which the direction of a line is taken, above the noise of a receiver


def thinned(points: FloatArray) -> NDArray[np.intp]:
    """Return the indices (m,) of the points (n, 2) [m] that a recorded track needs.

    A point nearer than 5 cm to the last one kept is dropped: repeated points, and those of a
    standing vehicle. Where the line then still turns by more than 90 deg at a point, noise is
    larger than the distances between points, and 10, 20 and 50 cm are tried.

    Raises:
        InvalidPath: the line comes back on itself over more than half a metre: a vehicle would
            change its gear there, with the place.
    """
    kept = np.arange(len(points))
    if len(points) < 2:
        return kept
    _refuse_cusp(points)
    for spacing in _THINNED_M:
        kept = _apart(points, spacing)
        if not np.any(np.abs(_turns(points[kept])) > _BACK):
            break
    return kept


def _refuse_cusp(points: FloatArray) -> None:
    chords = _apart(points, _CHORD_M)
    turns = _turns(points[chords])
    if len(turns) and np.max(np.abs(turns)) > _CUSP:
        index = int(chords[int(np.argmax(np.abs(turns))) + 1])
        x, y = points[index]
        raise InvalidPath(
            f"path: comes back on itself near point {index} at x = {x:.2f}, y = {y:.2f} m: the "
            "vehicle would change its gear there, and a path is driven in one; split it into a "
            "forward path and one with path.reverse = true"
        )


def _apart(points: FloatArray, spacing_m: float) -> NDArray[np.intp]:
    """Return the indices of points that are `spacing_m` [m] or more apart, with both ends."""
    kept = [0]
    last_x, last_y = points[0].tolist()
    for index, (x, y) in enumerate(points.tolist()):
        if math.hypot(x - last_x, y - last_y) >= spacing_m:
            kept.append(index)
            last_x = x
            last_y = y
    last = len(points) - 1
    if kept[-1] != last and np.any(points[kept[-1]] != points[last]):
        if len(kept) > 1:  # the end takes the place of the point that it is too near to
            kept.pop()
        kept.append(last)
    return np.array(kept)


def _turns(points: FloatArray) -> FloatArray:
    """Return the turn of a polygon (n, 2) at each inner point, (n - 2,) [rad]."""
    x, y = np.diff(points, axis=0).T
    return np.remainder(np.diff(np.arctan2(y, x)) + math.pi, math.tau) - math.pi


def _place(point: FloatArray, along: float) -> str:
    return f"x = {point[0]:.2f}, y = {point[1]:.2f} m, {along:.2f} m along the line"
