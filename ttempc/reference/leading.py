"""Path of a tractor that keeps the working point of a plain trailer on a line."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from ..errors import InvalidPath
from ..types import FloatArray
from ..vehicle import Vehicle
from .path import Path
from .posture import trailer_drift, unit
from .smoothing import smooth

_STEP_M: Final = 0.05  # between the places of the line
_ON_AXLE_M: Final = 1e-3  # a hitch nearer to the rear axle than that is on it


def leading_path(
    line: Path, vehicle: Vehicle, max_deviation_m: float, suits: Callable[[Path], bool]
) -> Path:
    """Return the path of the tractor point that tows the working point along `line`.

    The working point is the tool where there is one, g = `tool_behind` behind the axle, else the
    trailer point (g = 0). Its trailer moves along itself in a place c behind the axle, hence its
    heading psi_i beside that of the line is `trailer_drift`. A plain trailer is one body with its
    drawbar, and the hitch is at

        RJ1 = p + (L_i + d + g) e(psi_i).

    The tractor point is a ahead of the hitch and moves along the tractor:

        p_t = RJ1 + a e(psi_t),   a psi_t' = -n(psi_t) RJ1'.

    For a > 0 this grows along the line, and is integrated from its end; for a < 0 from its
    beginning. The points are smoothed like those of a file, by at most `max_deviation_m` [m], until
    the path `suits`: a line whose curvature has kinks asks for jumps of the steering.

    Raises:
        InvalidPath: the points cannot be smoothed so, or the line is too tight for the trailer.
    """
    hitch = _hitch_points(line, vehicle)
    a = vehicle.hitch_offset
    if abs(a) < _ON_AXLE_M:
        points = hitch
    else:
        yaw = _tractor_yaw(hitch, a)
        points = hitch + a * unit(yaw)
    return smooth(points, max_deviation_m, suits).path


def _hitch_points(line: Path, vehicle: Vehicle) -> FloatArray:
    """Return RJ1 (n, 2) [m] with the working point at equidistant places of all laps of `line`."""
    count = math.ceil(line.length_m / _STEP_M) + 1
    along = np.linspace(0.0, line.length_m, count)
    behind = vehicle.tool_behind
    ahead = behind - vehicle.trailer_turning_offset  # of the place that moves along the trailer
    pose = line.pose(along)
    yaw = pose[:, 2]
    if abs(ahead) > _ON_AXLE_M:
        yaw = yaw - trailer_drift(line, ahead, 0.0, along)
    length = vehicle.trailer_length + vehicle.drawbar_length + behind
    return pose[:, :2] + length * unit(yaw)


def _tractor_yaw(hitch: FloatArray, a: float) -> FloatArray:
    """Return psi_t (n,) [rad] for the hitch points (n, 2) [m].

    The direction theta of the hitch's motion is followed with a lag over the length a.
    """
    steps = np.gradient(hitch, axis=0)
    travel = np.hypot(steps[:, 0], steps[:, 1])
    direction = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    order = slice(None, None, -1 if a > 0.0 else 1)
    yaw = np.empty(len(hitch))
    now = float(direction[order][0])
    for index, (to, moved) in enumerate(zip(direction[order], travel[order], strict=True)):
        # exact for a straight step: tan(u / 2) decays by e^(-step / |a|)
        half = math.tan(0.5 * (now - to)) * math.exp(-moved / abs(a))
        now = to + 2.0 * math.atan(half)
        yaw[index] = now
    return yaw[order]


def check_plain(vehicle: Vehicle) -> None:
    """Refuse a trailer with steering, which keeps both points on the line.

    Raises:
        InvalidPath: it has steering.
    """
    if not vehicle.is_plain:
        raise InvalidPath(
            "path.on_line = 'working-point' is of a plain trailer; this one steers up to "
            f"{math.degrees(vehicle.steering_limit_i):.0f} deg and keeps both points on the line"
        )
