"""Cross-track errors of a log in the terms of ISO 12188-2:2012, passes on straight lines.

The standard tests satellite-based guidance on level ground: one representative vehicle point, here
the tractor point, on straight passes of 100 m at 0.1, 2.5 and 5 m/s; the relative cross-track error
is the distance of one pass from an earlier one over the same line, at the same place along it. What
of this a log does not meet is said, not hidden.

Errors are taken at equal distances along the line, interpolated between recorded points. The
nearest recorded point overstates the mean error by 8 % at 1.25 m/s and 1 Hz
(https://uknowledge.uky.edu/bae_facpub/41).
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE, STATE
from ...testbed.recording.record import Record
from ..errors import InvalidReplay
from .tracking_errors import START_UP_S

EDITION: Final = "ISO 12188-2:2012"

_STATION_M: Final = 0.1  # between the places at which errors are taken
_TURNED: Final = math.radians(5.0)  # heading off the line at which a pass ends
_SHORTEST_M: Final = 10.0  # of a pass
_SAME_LINE_M: Final = 1.0  # largest distance of passes that count as on one line
_LENGTH_M: Final = 100.0  # of a pass in the standard
_SPEEDS_MPS: Final = (0.1, 2.5, 5.0)  # of the standard
_SPEED_BAND: Final = (0.05, 0.2, 0.2)
_SHORT_TERM_S: Final = 900.0  # between passes whose relative error is called short-term
_SAME_TIME_S: Final = 1e-9  # times this close are the same
_LEVEL_RAD: Final = 0.03  # assumed: roll or pitch up to which ground counts as level


@dataclass(frozen=True, slots=True)
class Errors:
    """Cross-track errors of a pass, or of one pass to another [m]."""

    mean_m: float
    sd_m: float
    rms_m: float
    p95_m: float  # of the absolute error
    max_m: float  # of the absolute error

    @classmethod
    def of(cls, cross: FloatArray) -> "Errors":
        """Return the statistics of errors at equal distances."""
        size = np.abs(cross)
        return cls(
            float(cross.mean()),
            float(cross.std()),
            float(np.sqrt(np.mean(cross**2))),
            float(np.percentile(size, 95.0)),
            float(size.max()),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """A straight pass: errors at stations along its line."""

    begin_s: float
    end_s: float
    heading: float  # of the line in its direction of travel [rad]
    speed_mps: float
    origin: FloatArray  # (2,) a point of the line [m]
    along: FloatArray  # (n,) stations [m] from the origin, rising
    cross: FloatArray  # (n,) distance to the left of the line [m]
    level: bool

    @property
    def length_m(self) -> float:
        """Length of the pass."""
        return float(self.along[-1] - self.along[0])


def passes(record: Record) -> list[Pass]:
    """Return the straight passes of a log.

    The line of a pass is that of the reference, where the log has one; else that of least squares
    through the pass, or through an earlier one that is within a metre.

    Raises:
        InvalidReplay: the log has no states.
    """
    state = record[STATE]
    if len(state) < 2:
        raise InvalidReplay("record: has no states")
    points = state.columns("x_t_m", "y_t_m")
    yaw = np.unwrap(state["psi_t_rad"])
    headings, origins = _reference_lines(record)
    tilt = np.maximum(np.abs(state["roll_t_rad"]), np.abs(state["pitch_t_rad"]))
    found: list[Pass] = []
    for begin, end in _straight_parts(state.time_s, points, yaw):
        rows = slice(begin, end)
        if np.isfinite(headings[rows]).all():
            middle = (begin + end) // 2
            heading = float(headings[middle])
            origin = origins[middle]
        else:
            heading, origin = _line(points[rows], yaw[rows], found)
        along, cross = _along_line(points[rows], heading, origin)
        stations = np.arange(along[0], along[-1], _STATION_M)
        duration_s = state.time_s[end - 1] - state.time_s[begin]
        found.append(
            Pass(
                begin_s=float(state.time_s[begin]),
                end_s=float(state.time_s[end - 1]),
                heading=heading,
                speed_mps=float((along[-1] - along[0]) / duration_s),
                origin=origin,
                along=stations,
                cross=np.interp(stations, along, cross),
                level=bool(np.median(tilt[rows]) < _LEVEL_RAD),
            )
        )
    return found


def _reference_lines(record: Record) -> tuple[FloatArray, FloatArray]:
    """Return heading (n,) and a point (n, 2) of the reference at each state, NaN without one."""
    time_s = record[STATE].time_s
    reference = record[REFERENCE]
    headings = np.full(len(time_s), np.nan)
    origins = np.full((len(time_s), 2), np.nan)
    rows = np.searchsorted(reference.time_s, time_s - _SAME_TIME_S)
    known = rows < len(reference)
    headings[known] = reference["psi_t_rad"][rows[known]]
    origins[known] = reference.columns("x_t_m", "y_t_m")[rows[known]]
    return headings, origins


def _along_line(
    points: FloatArray, heading: float, origin: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return places along a line, rising, and the distances of points to the left of it [m]."""
    ahead = np.array([math.cos(heading), math.sin(heading)])
    offset = points - origin
    along = offset @ ahead
    cross = offset @ np.array([-ahead[1], ahead[0]])
    order = np.argsort(along, kind="stable")
    return along[order], cross[order]


def _straight_parts(
    time_s: FloatArray, points: FloatArray, yaw: FloatArray
) -> list[tuple[int, int]]:
    """Return first and last row of the parts with a heading within 5 deg of their median."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    parts = []
    begin = int(np.searchsorted(time_s, START_UP_S))
    while begin < len(yaw) - 1:
        end = begin + 1
        low = high = yaw[begin]
        while end < len(yaw):
            low = min(low, yaw[end])
            high = max(high, yaw[end])
            if high - low > 2.0 * _TURNED:
                break
            end += 1
        if way[end - 1] - way[begin] >= _SHORTEST_M:
            parts.append((begin, end))
            begin = end
        else:
            begin += max(1, (end - begin) // 4)
    return parts


def _line(points: FloatArray, yaw: FloatArray, earlier: Sequence[Pass]) -> tuple[float, FloatArray]:
    """Return heading and a point of the line of a pass for which none is given."""
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    heading = math.atan2(direction[1], direction[0])
    if math.cos(heading - float(np.median(yaw))) < 0.0:
        heading += math.pi
    for other in earlier:
        normal = np.array([-math.sin(other.heading), math.cos(other.heading)])
        if abs((middle - other.origin) @ normal) < _SAME_LINE_M and _parallel(heading, other):
            return other.heading, other.origin
    return heading, middle


def _parallel(heading: float, other: Pass) -> bool:
    return abs(math.sin(heading - other.heading)) < math.sin(_TURNED)


def relative_errors(first: Pass, second: Pass) -> FloatArray | None:
    """Return the distance of the second pass from the first at the same places, to the left of it.

    None where they are not on one line.
    """
    if not _parallel(second.heading, first):
        return None
    ahead = np.array([math.cos(first.heading), math.sin(first.heading)])
    normal = np.array([-ahead[1], ahead[0]])
    sign = 1.0 if math.cos(second.heading - first.heading) > 0.0 else -1.0
    shift = second.origin - first.origin
    if abs(shift @ normal) > _SAME_LINE_M:
        return None
    along = sign * second.along + shift @ ahead
    cross = sign * second.cross + shift @ normal
    order = np.argsort(along)
    common = (first.along >= along.min()) & (first.along <= along.max())
    if common.sum() * _STATION_M < _SHORTEST_M:
        return None
    return np.interp(first.along[common], along[order], cross[order]) - first.cross[common]


def report(record: Record) -> dict[str, Any]:
    """Return the report of a log in types of JSON.

    Raises:
        InvalidReplay: the log has no straight pass of 10 m.
    """
    found = passes(record)
    if not found:
        raise InvalidReplay(f"record: has no straight pass of {_SHORTEST_M:g} m for {EDITION}")
    pairs = []
    for number, one in enumerate(found):
        for later, other in enumerate(found[number + 1 :], number + 1):
            cross = relative_errors(one, other)
            if cross is not None:
                apart_s = other.begin_s - one.begin_s
                term = "short-term" if apart_s < _SHORT_TERM_S else "long-term"
                pairs.append(
                    {
                        "passes": [number + 1, later + 1],
                        "term": term,
                        "apart_s": apart_s,
                        **asdict(Errors.of(cross)),
                    }
                )
    return {
        "standard": EDITION,
        "point": "tractor point, centre of the rear axle",
        "passes": [
            {
                "pass": number,
                "begin_s": each.begin_s,
                "length_m": each.length_m,
                "speed_mps": each.speed_mps,
                **asdict(Errors.of(each.cross)),
            }
            for number, each in enumerate(found, 1)
        ],
        "relative": pairs,
        "departures": _departures(found, pairs),
    }


def _departures(found: Sequence[Pass], pairs: Sequence[Any]) -> list[str]:
    """Return what of the standard the log does not meet."""
    lines = []
    short = [each for each in found if each.length_m < _LENGTH_M]
    if short:
        lines.append(f"{len(short)} of {len(found)} passes are shorter than {_LENGTH_M:g} m")
    bands = list(zip(_SPEEDS_MPS, _SPEED_BAND, strict=True))
    other = [each for each in found if not any(abs(each.speed_mps - v) <= b for v, b in bands)]
    if other:
        lines.append(f"{len(other)} of {len(found)} passes are not at 0.1, 2.5 or 5 m/s")
    if not all(each.level for each in found):
        lines.append("the ground is not level")
    if not pairs:
        lines.append("no two passes on one line: no relative error")
    lines.append("positions are those of the log, not of a reference system ten times as accurate")
    return lines


def format_report(content: dict[str, Any]) -> list[str]:
    """Return a report as lines."""
    heads = ("mean", "sd", "rms", "95 %", "max")
    keys = ("mean_m", "sd_m", "rms_m", "p95_m", "max_m")
    title = "".join(head.rjust(8) for head in heads)
    lines = [
        f"{content['standard']}, {content['point']}; errors in cm, every 10 cm of the line",
        "",
        f"{'pass':<8}{'from':>8}{'length':>9}{'speed':>9}{title}",
    ]
    for each in content["passes"]:
        cells = "".join(f"{100.0 * each[key]:8.1f}" for key in keys)
        lines.append(
            f"{each['pass']:<8}{each['begin_s']:>6.0f} s{each['length_m']:>7.1f} m"
            f"{each['speed_mps']:>5.2f} m/s{cells}"
        )
    if content["relative"]:
        lines += ["", f"{'relative':<34}{title}"]
    for each in content["relative"]:
        first, second = each["passes"]
        cells = "".join(f"{100.0 * each[key]:8.1f}" for key in keys)
        name = f"{second} to {first}, {each['apart_s']:.0f} s, {each['term']}"
        lines.append(f"{name:<34}{cells}")
    return [*lines, "", *(f"not as the standard: {line}" for line in content["departures"])]


def to_json(content: dict[str, Any]) -> str:
    """Return a report as JSON."""
    return json.dumps(content, indent=2) + "\n"
