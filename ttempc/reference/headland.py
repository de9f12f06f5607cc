"""Headland pattern: parallel passes over a field, joined by turns beyond their ends."""

import math
from collections.abc import Callable
from itertools import chain

import scipy

from ..errors import InvalidPath
from .path import Path, Segment

_LARGEST_SCALE = 1e3  # of the radius of a half circle; a U-turn takes over far below


def headland(
    length_m: float = 30.0,
    width_m: float = 4.0,
    passes: int = 4,
    radius_m: float = 7.0,
    blend_m: float = 2.0,
    laps: int = 0,
) -> Path:
    """Return parallel passes in alternating directions, each to the left of the one before.

    The pattern is centred on the origin and begins to the east. Its turns begin and end where the
    passes do. Their curvature is at most 1 / `radius_m` and is reached over `blend_m`. Depending on
    the width, a turn is

    - two quarter circles with a straight between them, if the width allows it (U);
    - else a half circle of at least `radius_m`, if the width allows it;
    - else a loop (omega): an angle alpha away from the next pass, pi + 2 alpha towards it, and
      alpha away again, with alpha such that the loop ends on the next pass.

    Args:
        length_m: length of each pass [m].
        width_m: distance between neighbouring passes [m].
        passes: number of passes.
        radius_m: smallest radius of the turns [m].
        blend_m: length over which the curvature goes from 0 to 1 / `radius_m` [m].
        laps: of two passes, how often both are driven, with a turn back; 0: once, without it.

    Raises:
        InvalidPath: a length is not finite or not above 0, `passes` is below 1, or there are laps
            of other than two passes.

    Examples:
        >>> path = headland(length_m=30.0, width_m=4.0, passes=2)
        >>> bool(path.length_m > 60.0)
        True
    """
    lengths = {"length_m": length_m, "width_m": width_m, "radius_m": radius_m, "blend_m": blend_m}
    for name, value in lengths.items():
        if not math.isfinite(value) or value <= 0.0:
            raise InvalidPath(f"headland: {name} = {value}, must be finite and above 0")
    if passes < 1:
        raise InvalidPath(f"headland: passes = {passes}, must be at least 1")
    if laps and passes != 2:
        raise InvalidPath(f"headland: laps = {laps} of {passes} passes, must be of 2")
    turn = _turn_to_next(width_m, radius_m, blend_m)
    ends = (turn if index % 2 == 0 else _mirrored(turn) for index in range(passes - 1))
    segments = (
        Segment(length_m, 0.0, 0.0),
        *chain.from_iterable((*end, Segment(length_m, 0.0, 0.0)) for end in ends),
    )
    start = -0.5 * length_m, -0.5 * (passes - 1) * width_m, 0.0
    return Path((*segments, *turn) if laps else segments, start, laps)


def _turn_to_next(width: float, radius: float, blend: float) -> tuple[Segment, ...]:
    """Return the turn by pi that ends `width` [m] to the left of its beginning."""
    quarter = bend(0.5 * math.pi, radius, blend)
    rest = width - 2.0 * _end(quarter)[1]
    if rest >= 0.0:
        between = (Segment(rest, 0.0, 0.0),) if rest > 0.0 else ()
        return (*quarter, *between, *quarter)
    half = bend(math.pi, radius, blend)
    if width >= _end(half)[1]:

        def half_circle(scale: float) -> tuple[Segment, ...]:
            return bend(math.pi, scale * radius, blend)

        return half_circle(
            _root(lambda scale: _end(half_circle(scale))[1] - width, 1.0, _LARGEST_SCALE)
        )

    def loop(alpha: float) -> tuple[Segment, ...]:
        away = bend(-alpha, radius, blend)
        return (*away, *bend(math.pi + 2.0 * alpha, radius, blend), *away)

    return loop(_root(lambda alpha: _end(loop(alpha))[1] - width, 0.0, 0.5 * math.pi))


def bend(angle: float, radius_m: float, blend_m: float) -> tuple[Segment, ...]:
    """Return a turn by `angle` [rad] from straight to straight, positive to the left.

    It has two clothoids of d(curvature)/ds = 1 / (radius blend) with an arc between them. If the
    angle is too small for the arc, it has the clothoids alone and a larger radius.
    """
    if angle == 0.0:
        return ()
    sharpest = min(1.0 / radius_m, math.sqrt(abs(angle) / (radius_m * blend_m)))
    ramp = sharpest * radius_m * blend_m
    arc = abs(angle) / sharpest - ramp
    kappa = math.copysign(sharpest, angle)
    middle = (Segment(arc, kappa, kappa),) if arc > 1e-9 else ()
    return (Segment(ramp, 0.0, kappa), *middle, Segment(ramp, kappa, 0.0))


def _mirrored(segments: tuple[Segment, ...]) -> tuple[Segment, ...]:
    return tuple(Segment(length, -first, -last) for length, first, last in segments)


def _end(segments: tuple[Segment, ...]) -> tuple[float, float]:
    """Return the end (x, y) [m] of segments that begin at the origin."""
    path = Path(segments)
    x, y, _ = path.pose(path.lap_m).tolist()
    return x, y


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-13))
