"""Paths of piecewise linear curvature: lines, arcs and clothoids."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidPath
from ..types import FloatArray

# Gauss-Legendre on [0, 1]; with 5 nodes on pieces of 0.25 m the quadrature of cos(heading) and
# sin(heading) is exact to rounding for any radius above 1 m.
_LEGENDRE_NODES, _LEGENDRE_WEIGHTS = np.polynomial.legendre.leggauss(5)
_NODES = 0.5 * (_LEGENDRE_NODES + 1.0)
_WEIGHTS = 0.5 * _LEGENDRE_WEIGHTS
_PIECE_M = 0.25
_EXTENT_STEP_M = 0.02  # the extent is too small by less than step^2 / (8 radius)


class Segment(NamedTuple):
    """A part of a path along which the curvature is linear in arc length."""

    length_m: float
    curvature_start: float  # [1/m], positive to the left
    curvature_end: float  # [1/m]


class Extent(NamedTuple):
    """Axis-aligned box in the map frame [m]."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float


@dataclass(frozen=True, eq=False)
class Path:
    """A curve of continuous curvature (C2), parametrised by its arc length s [m].

    With curvature kappa(s) piecewise linear,

        heading' = kappa,   x' = cos(heading),   y' = sin(heading).

    The path is defined for every s, for example for the trailer of a vehicle at s = 0: a closed
    path repeats, an open one continues with the curvature of its ends.

    Raises:
        InvalidPath: a length or curvature is not finite, the curvature jumps, or a closed path
            does not meet its own beginning.

    Examples:
        >>> turn = Path((Segment(5.0, 0.0, 0.1), Segment(10.0, 0.1, 0.1)))  # clothoid, arc
        >>> round(float(turn.pose(15.0)[2]), 3)  # heading [rad]: the integral of the curvature
        1.25
    """

    segments: tuple[Segment, ...]
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x [m], y [m], heading [rad] at s = 0
    laps: int = 0  # number of laps of a closed path; 0 for an open path

    lap_m: float = field(init=False)  # length of the segments [m]
    _knots: FloatArray = field(init=False, repr=False)  # (n + 1,) arc lengths of piece ends [m]
    _curvature: FloatArray = field(init=False, repr=False)  # (n + 1,) [1/m]
    _pose: FloatArray = field(init=False, repr=False)  # (n + 1, 3) x, y [m], heading [rad]

    def __post_init__(self) -> None:
        _check_segments(self.segments)
        knots = [0.0]
        curvature = [self.segments[0].curvature_start]
        for length, first, last in self.segments:
            pieces = math.ceil(length / _PIECE_M)
            share = np.arange(1, pieces + 1) / pieces
            begin = knots[-1]
            knots.extend(begin + share * length)
            curvature.extend(first + share * (last - first))
        values = {"_knots": np.array(knots), "_curvature": np.array(curvature), "lap_m": knots[-1]}
        for name, value in values.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_pose", self._integrate())
        if self.laps:
            self._check_closed()

    @property
    def length_m(self) -> float:
        """Length of all laps together [m]."""
        return self.lap_m * max(1, self.laps)

    def pose(self, s: ArrayLike) -> FloatArray:
        """Return x [m], y [m] and the continuous heading [rad] at arc length `s` [m], (..., 3)."""
        along, laps = self._wrap(s)
        inside = np.clip(along, 0.0, self.lap_m)
        index, rest = self._locate(inside)
        pose = self._pose[index] + self._advance(index, rest)
        pose = pose + _arc(pose[..., 2], self.curvature(inside), along - inside)
        pose[..., 2] += laps * (self._pose[-1, 2] - self._pose[0, 2])
        return pose

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return kappa [1/m] at arc length `s` [m], shape of `s`, positive to the left."""
        return np.interp(self._wrap(s)[0], self._knots, self._curvature)

    def curvature_derivative(self, s: ArrayLike) -> FloatArray:
        """Return d kappa / ds [1/m^2] at `s` [m], shape of `s`; the limit from above at a jump."""
        along = self._wrap(s)[0]
        index, _ = self._locate(along)
        inside = (along >= 0.0) & (along < self.lap_m)
        return np.where(inside, self._slope(index), 0.0)

    def reversed(self) -> Path:
        """Return the same curve in the opposite direction, from its end to its beginning."""
        x, y, heading = self._pose[-1].tolist()
        segments = tuple(
            Segment(length, -last, -first) for length, first, last in reversed(self.segments)
        )
        return Path(segments, (x, y, heading + math.pi), self.laps)

    def extent(self) -> Extent:
        """Return the bounding box of the path from s = 0 to the end of the segments."""
        count = math.ceil(self.lap_m / _EXTENT_STEP_M) + 1
        x, y, _ = self.pose(np.linspace(0.0, self.lap_m, count)).T
        return Extent(float(x.min()), float(x.max()), float(y.min()), float(y.max()))

    def _wrap(self, s: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Split `s` into an arc length within one lap and a count of laps."""
        s = np.asarray(s, dtype=float)
        laps = np.floor(s / self.lap_m) if self.laps else np.zeros_like(s)
        return s - laps * self.lap_m, laps

    def _locate(self, s: FloatArray) -> tuple[np.ndarray, FloatArray]:
        """Return the index of the piece that contains `s`, and the length from its beginning."""
        last = len(self._knots) - 2
        index = np.clip(np.searchsorted(self._knots, s, side="right") - 1, 0, last)
        return index, s - self._knots[index]

    def _slope(self, index: np.ndarray) -> FloatArray:
        """Return d kappa / ds of each piece `index` [1/m^2]."""
        step = self._curvature[index + 1] - self._curvature[index]
        return step / (self._knots[index + 1] - self._knots[index])

    def _advance(self, index: np.ndarray, rest: FloatArray) -> FloatArray:
        """Return the change of pose over `rest` from the beginning of piece `index`, (..., 3)."""
        first = self._curvature[index]
        slope = self._slope(index)
        heading = self._pose[index, 2]
        node = rest[..., None] * _NODES  # (..., 5)
        turned = first[..., None] * node + 0.5 * slope[..., None] * node**2
        angle = heading[..., None] + turned
        return np.stack(
            [
                rest * (np.cos(angle) @ _WEIGHTS),
                rest * (np.sin(angle) @ _WEIGHTS),
                first * rest + 0.5 * slope * rest**2,
            ],
            axis=-1,
        )

    def _integrate(self) -> FloatArray:
        """Return the pose at every knot by quadrature over the pieces, (n + 1, 3)."""
        lengths = np.diff(self._knots)
        pose = np.tile(np.asarray(self.start, dtype=float), (len(self._knots), 1))
        turn = 0.5 * (self._curvature[1:] + self._curvature[:-1]) * lengths
        pose[1:, 2] += np.cumsum(turn)
        object.__setattr__(self, "_pose", pose)  # `_advance` reads the headings alone
        steps = self._advance(np.arange(len(lengths)), lengths)
        pose[1:, :2] += np.cumsum(steps[:, :2], axis=0)
        return pose

    def _check_closed(self) -> None:
        gap = math.hypot(*(self._pose[-1, :2] - self._pose[0, :2]))
        turns = (self._pose[-1, 2] - self._pose[0, 2]) / math.tau
        step = self._curvature[-1] - self._curvature[0]
        if gap > 1e-6 or abs(turns - round(turns)) > 1e-9 or abs(step) > 1e-9:
            raise InvalidPath(
                f"a path with laps={self.laps} must be closed: its end is {gap:.3g} m from its "
                f"beginning, it turns {turns:.6g} times and its curvature steps by {step:.3g} 1/m"
            )


def _check_segments(segments: Sequence[Segment]) -> None:
    if not segments:
        raise InvalidPath("a path needs at least one segment, got none")
    begin = 0.0
    for segment in segments:
        if not all(map(math.isfinite, segment)) or segment.length_m <= 0.0:
            raise InvalidPath(
                f"segment at s = {begin:.2f} m: got {segment}, the length must be above 0 "
                "and all values finite"
            )
        begin += segment.length_m
    begin = 0.0
    for before, after in pairwise(segments):
        begin += before.length_m
        if abs(after.curvature_start - before.curvature_end) > 1e-12:
            raise InvalidPath(
                f"curvature jumps at s = {begin:.2f} m from {before.curvature_end:.4g} to "
                f"{after.curvature_start:.4g} 1/m: put a blend between, a path must be C2"
            )


def _arc(heading: FloatArray, curvature: FloatArray, length: FloatArray) -> FloatArray:
    """Return the change of pose along an arc of constant curvature, (..., 3)."""
    turn = curvature * length
    chord = length * np.sinc(turn / math.tau)  # np.sinc(x) = sin(pi x) / (pi x)
    middle = heading + 0.5 * turn
    return np.stack([chord * np.cos(middle), chord * np.sin(middle), turn], axis=-1)


def straight(length_m: float) -> Path:
    """Return a straight line from the origin along the x axis.

    Examples:
        >>> float(straight(20.0).length_m)
        20.0
    """
    return Path((Segment(length_m, 0.0, 0.0),))


def figure_eight(
    radius_m: float = 10.0, centre_distance_m: float = 30.0, blend_m: float = 2.0, laps: int = 2
) -> Path:
    """Return two circles on the x axis, joined by two straights that cross at the origin.

    It starts at the origin in the middle of a straight, so that the vehicle is straight and its
    start-up is over before the first curve. The right-hand circle comes first, counter-clockwise.
    Each arc begins and ends with a clothoid of length `blend_m`. A clothoid between a line and a
    circle of radius R increases their distance to R + shift. The angle alpha of the straights to
    the x axis is such that the circles keep their centres and their radius:

        sin(alpha) = (R + shift) / (centre distance / 2).

    Args:
        radius_m: radius of the circles [m].
        centre_distance_m: distance between the centres of the circles [m].
        blend_m: length of each clothoid [m].
        laps: number of laps.

    Raises:
        InvalidPath: a length or `laps` is not positive, or the circles are too close together.

    Examples:
        >>> path = figure_eight(radius_m=10.0, laps=1)
        >>> round(float(path.length_m), 1)
        136.7
        >>> path.pose(0.0).shape  # x [m], y [m], heading [rad]
        (3,)
    """
    lengths = {"radius_m": radius_m, "centre_distance_m": centre_distance_m, "blend_m": blend_m}
    for name, value in lengths.items():
        if not math.isfinite(value) or value <= 0.0:
            raise InvalidPath(f"figure eight: {name} = {value}, must be finite and above 0")
    if laps < 1:
        raise InvalidPath(f"figure eight: laps = {laps}, must be at least 1")
    kappa = 1.0 / radius_m
    x, y, turned = Path((Segment(blend_m, 0.0, kappa),)).pose(blend_m).tolist()
    circle_ahead = x - radius_m * math.sin(
        turned
    )  # centre of the circle from the start of the blend
    circle_aside = y + radius_m * math.cos(turned)  # R + shift
    half = 0.5 * centre_distance_m
    if half <= circle_aside:
        raise InvalidPath(
            f"figure eight: centre_distance_m = {centre_distance_m}, must be above "
            f"{2 * circle_aside:.3f} for radius_m = {radius_m} and blend_m = {blend_m}"
        )
    alpha = math.asin(circle_aside / half)
    half_straight = math.sqrt(half**2 - circle_aside**2) - circle_ahead
    arc = radius_m * (math.pi + 2.0 * alpha - 2.0 * turned)
    if half_straight <= 0.0 or arc <= 0.0:
        raise InvalidPath(
            f"figure eight: blend_m = {blend_m} leaves no room for the straights "
            f"({2 * half_straight:.2f} m) or the arcs ({arc:.2f} m): make it shorter"
        )

    def loop(sign: float) -> list[Segment]:
        return [
            Segment(half_straight, 0.0, 0.0),
            Segment(blend_m, 0.0, sign * kappa),
            Segment(arc, sign * kappa, sign * kappa),
            Segment(blend_m, sign * kappa, 0.0),
            Segment(half_straight, 0.0, 0.0),
        ]

    return Path((*loop(1.0), *loop(-1.0)), start=(0.0, 0.0, -alpha), laps=laps)


_REACH_M = 3.0  # along the polyline, each way, from the last place; assumed


class Projection:
    """Orthogonal projection of points that move along a polyline.

    The search covers some metres about the last place alone, so that a path that crosses itself is
    followed in its order. The first call searches from the first point on.
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
