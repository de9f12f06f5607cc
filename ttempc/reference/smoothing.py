"""Smoothing of a polygon of points to a path of continuous curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy

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
_LEAST_PENALTY, _LARGEST_PENALTY = 1e-6, 1e6
_MOST_SAMPLES = 40_000  # 10 km in steps of 0.25 m; a minute of smoothing
_HALVINGS = 30  # bisection steps on the logarithm of the penalty
_CORRECTIONS = 2  # of the drift of the integrated curvature; each reduces it to a hundredth
_LEAST_PACE = 0.2  # metres of path per metre of polygon; below, the polygon turns back
# Gauss-Legendre on [-1, 1]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedPath:
    """A path along a polygon of points."""

    path: Path
    distance_m: FloatArray  # (n,) arc length of the path at each point [m]
    deviation_m: float  # largest distance between polygon and path [m]


def smooth(points: FloatArray, max_deviation_m: float) -> SmoothedPath:
    """Return the smoothest path within `max_deviation_m` [m] of the polygon through `points`.

    `points` are (n, 2) [m]. A natural cubic smoothing spline

        min  sum |p(u_j) - q_j|^2 + penalty * integral |p''(u)|^2 du

    is fitted to samples q_j of the polygon over its length u. The penalty is the largest (by
    bisection) for which no p(u) is farther from q(u) than 99 % of `max_deviation_m`, which bounds
    the distance from path to polygon and from polygon to path. The path is the integral of the
    curvature of the spline, linear in arc length between knots: C2, |dp/ds| = 1 to rounding, zero
    curvature at both ends. The deviation that is returned is that of the path.

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
    along = _lengths(points)  # (n,)
    samples = _sampled(along)
    line = np.column_stack([np.interp(samples, along, points[:, axis]) for axis in (0, 1)])
    between = np.union1d(samples, 0.5 * (samples[1:] + samples[:-1]))
    targets = np.column_stack([np.interp(between, along, points[:, axis]) for axis in (0, 1)])

    low, high = math.log(_LEAST_PENALTY), math.log(_LARGEST_PENALTY)
    spline = _fitted(samples, line, low)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        candidate = _fitted(samples, line, middle)
        if _farthest(candidate(between), targets) <= 0.99 * max_deviation_m:
            low, spline = middle, candidate
        else:
            high = middle
    smoothed = spline(between)
    path, travelled = _integrated(spline, between, along, points)
    for _ in range(_CORRECTIONS):
        drift = path.pose(travelled)[:, :2] - smoothed
        line -= drift[::2]  # every other of `between` is a sample
        spline = _fitted(samples, line, low)
        path, travelled = _integrated(spline, between, along, points)
    deviation = _farthest(path.pose(travelled)[:, :2], targets)
    if deviation > max_deviation_m:
        raise InvalidPath(
            f"path: smoothed, it is {deviation:.3g} m beside its points; max_deviation_m = "
            f"{max_deviation_m:g} is too little for points like these"
        )
    return SmoothedPath(path, np.interp(along, between, travelled), deviation)


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
    velocity, bend = spline.derivative(), spline.derivative(2)
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
    (vx, vy), (ax, ay) = velocity(at).T, bend(at).T
    curvature = (vx * ay - vy * ax) / pace**3
    curvature[[0, -1]] = 0.0  # natural ends
    lengths, kappa = np.diff(travelled).tolist(), curvature.tolist()
    segments = tuple(map(Segment, lengths, kappa[:-1], kappa[1:]))
    x, y = spline(0.0).tolist()
    return Path(segments, (x, y, math.atan2(vy[0], vx[0]))), travelled


def _place(point: FloatArray, along: float) -> str:
    return f"x = {point[0]:.2f}, y = {point[1]:.2f} m, {along:.2f} m along the line"
