"""Motion of a vehicle from a foreign record: states on a grid of times."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

from ..errors import UnreadableFile
from ..formats.mapping import Point
from ..formats.table import MOST_ROWS

FINE_S: Final = 0.04
COARSE_S: Final = 0.2
"""Steps of the grid of times: for records of 20 Hz and more, and for slower ones."""

_COURSE_M: Final = 0.5  # way over which the course of a track is taken, on either side
_SMOOTH_S: Final = 0.2  # deviation of the bell over which a track is averaged for its course
_MOVES_MPS: Final = 0.3  # below it a steering angle does not follow from a yaw rate
_STANDS_MPS: Final = 0.05  # below it a course is not known
_MOST_GAP_S: Final = 2.0  # between positions, or ten times the usual one; longer ones end a record


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion:
    """Motion at the times of a grid, every array (n,); angles in radians."""

    time_s: FloatArray
    x_t: FloatArray  # tractor point [m]
    y_t: FloatArray
    psi_t: FloatArray  # continuous, not wrapped
    x_i: FloatArray  # trailer point [m]
    y_i: FloatArray
    psi_i: FloatArray
    delta_t: FloatArray
    delta_i: FloatArray
    speed: FloatArray  # [m/s], negative in reverse
    yaw_rate: FloatArray  # [rad/s]
    computed: tuple[str, ...]  # quantities that are computed, not measured

    @property
    def psi_d(self) -> FloatArray:
        """Yaw of the drawbar."""
        return self.psi_i + self.delta_i

    @property
    def beta(self) -> FloatArray:
        """Hitch angle psi_t - psi_d."""
        return self.psi_t - self.psi_d


def recorded_motion(
    columns: Mapping[str, FloatArray],
    points: FloatArray,
    trailer_points: FloatArray | None,
    vehicle: Vehicle,
    point: Point,
    antenna_m: FloatArray,
) -> RecordedMotion:
    """Return the motion of a record.

    Args:
        columns: those of the table, with `time_s` from 0.
        points: places of the logged point in the map frame, (n, 2), NaN without a sample.
        trailer_points: those of the trailer, None if it has none.
        vehicle: lengths by which the trailer follows where it is not measured.
        point: what `points` are.
        antenna_m: antenna ahead of, left of and above the tractor point, (3,).

    Raises:
        UnreadableFile: the record has no times, no motion, or a gap.
    """
    if point == "implement":
        raise UnreadableFile(
            "map: point = 'implement' has no place of the tractor; a record of both has columns "
            "trailer_x_m, trailer_y_m for the implement"
        )
    at_s, place = _known(columns["time_s"], points)
    times, usual_s = _grid_of(at_s)
    record = _Gridded(columns, times)

    # The track of the tractor, with its speed and heading
    x_m, y_m = _between(times, at_s, place, usual_s)
    speed = _speed(record, x_m, y_m, usual_s)
    width = max(_SMOOTH_S, usual_s) / record.step_s
    smooth = gaussian_filter1d(x_m, width), gaussian_filter1d(y_m, width)
    spacing_m = float(np.median(np.hypot(*np.diff(place, axis=0).T)))
    psi_t = _yaw(record, *smooth, speed, max(_COURSE_M, spacing_m))
    yaw_rate = record.column("yaw_rate_radps")
    if yaw_rate is None:
        yaw_rate = gaussian_filter1d(np.gradient(psi_t, record.step_s), width)
    if point == "antenna":
        x_m, y_m = tractor_points(np.column_stack([x_m, y_m]), psi_t, antenna_m).T

    # Steering angles follow from the motion where they are not recorded
    delta_t = record.column("steering_rad")
    if delta_t is None:
        record.computed.append("steering_tractor")
        delta_t = _steering(vehicle, speed, yaw_rate)
    delta_i = record.column("trailer_steering_rad")
    if delta_i is None:
        record.computed.append("steering_trailer")
        delta_i = np.zeros(len(times))

    # The trailer follows where it is not recorded
    psi_i = _trailer_yaw(record, psi_t, delta_i, speed, yaw_rate, vehicle)
    if trailer_points is None:
        record.computed.append("gnss_trailer")
        x_i, y_i = _behind(x_m, y_m, (psi_t, psi_i + delta_i, psi_i), vehicle)
    else:
        trailer_s, trailer = _known(columns["time_s"], trailer_points)
        x_i = np.interp(times, trailer_s, trailer[:, 0])
        y_i = np.interp(times, trailer_s, trailer[:, 1])
    return RecordedMotion(
        time_s=times,
        x_t=x_m,
        y_t=y_m,
        psi_t=psi_t,
        x_i=x_i,
        y_i=y_i,
        psi_i=psi_i,
        delta_t=delta_t,
        delta_i=delta_i,
        speed=speed,
        yaw_rate=yaw_rate,
        computed=tuple(record.computed),
    )


class _Gridded:
    """Columns of a record at the times of a grid, and what had to be computed for want of one."""

    def __init__(self, columns: Mapping[str, FloatArray], time_s: FloatArray) -> None:
        self._columns = columns
        self.time_s = time_s
        self.step_s = time_s[1] - time_s[0]
        self.computed: list[str] = []  # names of the quantities, as of `RecordedMotion.computed`

    def column(self, name: str) -> FloatArray | None:
        """Return a column at the times of the grid, None where it is not recorded."""
        samples = samples_of(self._columns, name)
        return None if samples is None else np.interp(self.time_s, *samples)

    def angle(self, name: str) -> FloatArray | None:
        """Return a column of angles as `column`, without the jumps of whole turns."""
        samples = samples_of(self._columns, name)
        if samples is None:
            return None
        times, angles = samples
        return np.interp(self.time_s, times, np.unwrap(angles))


def _grid_of(times: FloatArray) -> tuple[FloatArray, float]:
    """Return the grid over the times of the positions, and the usual distance of these [s].

    Raises:
        UnreadableFile: there are too few positions, or a gap between them.
    """
    gap_s = np.diff(times)
    usual_s = float(np.median(gap_s)) if len(gap_s) else 0.0
    most_s = max(_MOST_GAP_S, 10.0 * usual_s)
    if len(times) < 3 or (gap_s > most_s).any():
        k = int(np.argmax(gap_s)) if len(gap_s) else 0
        where = f"; the longest gap, {gap_s[k]:.1f} s, begins at {times[k]:.1f} s" if k else ""
        raise UnreadableFile(
            f"has {len(times)} positions with times; a record needs 3 or more, none later than "
            f"{most_s:g} s after the one before{where} (--seconds FROM:TO takes a part)"
        )
    step_s = FINE_S if usual_s < 0.5 * COARSE_S else COARSE_S
    lasts_s = times[-1] - times[0]
    count = math.floor(lasts_s / step_s + 1e-6) + 1
    if not 2 <= count <= MOST_ROWS:
        raise UnreadableFile(
            f"lasts {lasts_s:.1f} s, must be {step_s:g} s to {step_s * MOST_ROWS:.0f} s"
        )
    return times[0] + step_s * np.arange(count, dtype=np.float64), usual_s


def _steering(vehicle: Vehicle, speed: FloatArray, yaw_rate: FloatArray) -> FloatArray:
    """Return the front steering angle of a yaw rate, 0 of a vehicle that hardly moves."""
    moving = np.where(np.abs(speed) < _MOVES_MPS, np.inf, speed)
    angle = np.arctan(vehicle.wheelbase * yaw_rate / moving)
    return np.clip(angle, -vehicle.steering_limit_t, vehicle.steering_limit_t)


def _between(
    grid: FloatArray, times: FloatArray, places: FloatArray, usual_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return places at the times of the grid: linear between close samples, else by a spline.

    At 1 Hz and 2 m/s on a circle of 10 m, chords are 5 cm off; a cubic spline is below 1 mm off.
    """
    if usual_s < 0.25:
        return np.interp(grid, times, places[:, 0]), np.interp(grid, times, places[:, 1])
    x_m, y_m = CubicSpline(times, places)(grid).T
    return x_m, y_m


def tractor_points(places: FloatArray, yaw: FloatArray, antenna_m: FloatArray) -> FloatArray:
    """Return the tractor points (n, 2) [m] of places of an antenna, by the yaw at each [rad].

    `antenna_m` is (3,): ahead of, left of and above the tractor point.
    """
    ahead, left, _ = antenna_m
    east = ahead * np.cos(yaw) - left * np.sin(yaw)
    north = ahead * np.sin(yaw) + left * np.cos(yaw)
    return places - np.column_stack([east, north])


def _behind(
    x_m: FloatArray, y_m: FloatArray, headings: Sequence[FloatArray], vehicle: Vehicle
) -> tuple[FloatArray, FloatArray]:
    """Return the trailer point behind the tractor point; yaw of tractor, drawbar and trailer."""
    lengths = vehicle.hitch_offset, vehicle.drawbar_length, vehicle.trailer_length
    east = sum(a * np.cos(psi) for a, psi in zip(lengths, headings, strict=True))
    north = sum(a * np.sin(psi) for a, psi in zip(lengths, headings, strict=True))
    return x_m - east, y_m - north


def _known(times: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times and places (n, 2) of the samples without NaN, by time."""
    kept = np.isfinite(points).all(axis=1)
    return _unique(times[kept], points[kept])


def _unique(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return samples at rising times; of several at one time the first."""
    times, first = np.unique(times, return_index=True)
    return times, values[first]


def samples_of(
    columns: Mapping[str, FloatArray], name: str
) -> tuple[FloatArray, FloatArray] | None:
    """Return times and values of the samples of a column, None where it has fewer than two."""
    if name not in columns:
        return None
    kept = np.isfinite(columns[name]) & np.isfinite(columns["time_s"])
    times, values = _unique(columns["time_s"][kept], columns[name][kept])
    return (times, values) if len(times) > 1 else None


def _speed(record: _Gridded, x_m: FloatArray, y_m: FloatArray, usual_s: float) -> FloatArray:
    """Return the speed: the recorded one, else that of the track."""
    over_ground = record.column("speed_mps")
    of_wheels = record.column("wheel_speed_mps")
    if of_wheels is None:
        record.computed.append("encoder")
    for recorded in (over_ground, of_wheels):
        if recorded is not None:
            return recorded

    # positions of a receiver have centimetres of noise, stamps of slow records seconds
    times = record.time_s
    width = max(1, round(max(0.5, usual_s) / record.step_s))
    ahead = np.minimum(np.arange(len(times)) + width, len(times) - 1)
    behind = np.maximum(np.arange(len(times)) - width, 0)
    way = np.hypot(x_m[ahead] - x_m[behind], y_m[ahead] - y_m[behind])
    return way / (times[ahead] - times[behind])


def _yaw(
    record: _Gridded, x_m: FloatArray, y_m: FloatArray, speed: FloatArray, reach_m: float
) -> FloatArray:
    """Return the heading: that of a pose or a compass, else the course over ground."""
    for name in ("pose_yaw_rad", "yaw_rad"):
        yaw = record.angle(name)
        if yaw is not None:
            return yaw
    record.computed.append("heading")
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
    ahead = np.minimum(np.searchsorted(way, way + reach_m), len(way) - 1)
    behind = np.maximum(np.searchsorted(way, way - reach_m) - 1, 0)
    east = x_m[ahead] - x_m[behind]
    north = y_m[ahead] - y_m[behind]
    backwards = speed < 0.0
    course = np.arctan2(np.where(backwards, -north, north), np.where(backwards, -east, east))
    known = (np.hypot(east, north) > 0.5 * reach_m) & (np.abs(speed) > _STANDS_MPS)
    if not known.any():
        raise UnreadableFile("has no heading, and moves too little for a course")
    times = record.time_s
    return np.interp(times, times[known], np.unwrap(course[known]))


def _trailer_yaw(
    record: _Gridded,
    psi_t: FloatArray,
    delta_i: FloatArray,
    speed: FloatArray,
    yaw_rate: FloatArray,
    vehicle: Vehicle,
) -> FloatArray:
    """Return the heading of the trailer: measured by itself or at the hitch, else as it follows.

    Without side slip, lambda = psi_t - psi_i (see `ttempc.models.kinematics.articulated`):

        psi_i' = (v sin(lambda) - a psi_t' cos(lambda) - d delta_i' cos(delta_i))
                 / (L_i + d cos(delta_i)).
    """
    hitch = record.angle("hitch_rad")
    if hitch is None:
        record.computed.append("hitch")
    for name in ("trailer_pose_yaw_rad", "trailer_yaw_rad"):
        yaw = record.angle(name)
        if yaw is not None:
            turns = np.round((psi_t[0] - yaw[0]) / math.tau)
            return yaw + math.tau * turns
    if hitch is not None:
        return psi_t - hitch - delta_i

    # Neither is measured: integrate how it follows
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    length = vehicle.trailer_length
    step_s = record.step_s
    rate_i = np.gradient(delta_i, step_s)
    psi_i = np.empty(len(psi_t))
    psi_i[0] = psi_t[0] - delta_i[0]
    for k in range(len(psi_t) - 1):
        lam = psi_t[k] - psi_i[k]
        across = speed[k] * math.sin(lam) - a * yaw_rate[k] * math.cos(lam)
        across -= d * rate_i[k] * math.cos(delta_i[k])
        psi_i[k + 1] = psi_i[k] + step_s * across / (length + d * math.cos(delta_i[k]))
    return psi_i
