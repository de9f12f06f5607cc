"""From a line of points to a path of continuous curvature that stays beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline

from ..errors import InvalidPath
from ..types import FloatArray
from .path import Path, Segment

_SPACING_M = 0.25  # of the samples of the line to which the spline is fitted
_REPEATED_M = 1e-6  # points nearer than this are one
_WEIGHT_AT_ENDS = 1e4  # the path begins and ends where the line does
# The penalty of the spline, over that of samples 1 m apart: features shorter than about
# 2 pi penalty^(1/4) m fade. From a millimetre's noise to a field's length.
_LEAST_PENALTY, _LARGEST_PENALTY = 1e-6, 1e6
_HALVINGS = 30  # of the penalty's logarithm
_CORRECTIONS = 2  # of the drift of the integrated curvature; each leaves a hundredth
_LEAST_PACE = 0.2  # metres of path per metre of line; below, the line turns back on itself
# Gauss-Legendre on [-1, 1]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedPath:
    """A path beside a line of points."""

    path: Path
    distance_m: FloatArray  # (n,) arc length of the path beside each point
    deviation_m: float  # largest distance between line and path


def smooth(points: FloatArray, max_deviation_m: float) -> SmoothedPath:
    """Return the smoothest path that stays within `max_deviation_m` of the line through `points`.

    The line is the polygon through the points (n, 2) [m]. A natural cubic smoothing spline

        min  sum |p(u_j) - q_j|^2 + penalty * integral |p''(u)|^2 du

    is fitted to samples q_j of the line over its length u, with the largest penalty (bisection)
    with which no p(u) is farther from q(u) than 99 % of what is allowed. That bounds the distance
    from path to line and that from line to path. The path then is the integral of the spline's
    curvature, linear between knots in arc length: C2, |dp/ds| = 1 to rounding, without curvature at
    both ends. The deviation that is returned is that of the path.

    Raises:
        InvalidPath: fewer than two points, one that is not finite or repeated, or a line that
            turns back on itself; with index, place and length along the line.
    """
    if not (math.isfinite(max_deviation_m) and max_deviation_m > 0.0):
        raise InvalidPath(f"max_deviation_m: got {max_deviation_m}, must be finite and above 0")
    along = _lengths(points)  # (n,)
    samples = _sampled(along)
    line = np.column_stack([np.interp(samples, along, points[:, axis]) for axis in (0, 1)])
    between = np.union1d(samples, 0.5 * (samples[1:] + samples[:-1]))
    wanted = np.column_stack([np.interp(between, along, points[:, axis]) for axis in (0, 1)])

    low, high = math.log(_LEAST_PENALTY), math.log(_LARGEST_PENALTY)
    spline = _fitted(samples, line, low)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        candidate = _fitted(samples, line, middle)
        if _farthest(candidate(between), wanted) <= 0.99 * max_deviation_m:
            low, spline = middle, candidate
        else:
            high = middle
    target = spline(between)
    path, travelled = _integrated(spline, between, along, points)
    for _ in range(_CORRECTIONS):
        drift = path.pose(travelled)[:, :2] - target
        line -= drift[::2]  # every other of `between` is a sample
        spline = _fitted(samples, line, low)
        path, travelled = _integrated(spline, between, along, points)
    deviation = _farthest(path.pose(travelled)[:, :2], wanted)
    if deviation > max_deviation_m:
        raise InvalidPath(
            f"path: smoothed, it is {deviation:.3g} m beside its points; max_deviation_m = "
            f"{max_deviation_m:g} is too little for points like these"
        )
    return SmoothedPath(path, np.interp(along, between, travelled), deviation)


def _lengths(points: FloatArray) -> FloatArray:
    """Return the length of the line up to each point (n,) [m], or refuse the points."""
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise InvalidPath(f"path: got {len(points)} points, must be two or more of x and y")
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(wrong):
        x, y = points[wrong[0]]
        raise InvalidPath(f"path: point {wrong[0]} is ({x}, {y}), must be finite")
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
    """Return lengths along the line at which to sample it: every point, and some in between."""
    parts = [
        np.linspace(first, last, max(1, math.ceil((last - first) / _SPACING_M)), endpoint=False)
        for first, last in pairwise(along)
    ]
    samples = np.concatenate([*parts, along[-1:]])
    return samples if len(samples) >= 5 else np.linspace(0.0, along[-1], 5)  # the spline's least


def _fitted(samples: FloatArray, line: FloatArray, log_penalty: float) -> BSpline:
    """Return the smoothing spline of (n, 2) samples; a penalty does not depend on their number."""
    weights = np.gradient(samples)
    weights[[0, -1]] *= _WEIGHT_AT_ENDS
    return make_smoothing_spline(samples, line, weights, math.exp(log_penalty))


def _farthest(one: FloatArray, other: FloatArray) -> float:
    return float(np.max(np.hypot(*(one - other).T)))


def _integrated(
    spline: BSpline, at: FloatArray, along: FloatArray, points: FloatArray
) -> tuple[Path, FloatArray]:
    """Return the path whose curvature is the spline's, and its arc length at the parameters `at`.

    Between two of `at`, which hold the knots of the spline, its curvature is not quite linear: the
    path drifts from the spline by millimetres in 100 m, which the caller corrects.
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
