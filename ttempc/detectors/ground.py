"""Drift of a receiver told from the ground: slopes, slip and ruts move a vehicle, a drift does not.

With the position p of a receiver and its dead reckoning D by encoder and heading, r = p - D grows
with the distance by slopes and slips, and with the time by a drift w.
"""

import math
from enum import IntEnum
from typing import Final

import numpy as np

from ..types import FloatArray
from .board import Record
from .history import kernel


class Way(IntEnum):
    """Columns of what a body has travelled, each a vector east and north [m]."""

    TRAVELLED = 0  # dead reckoning by encoder and heading
    SIDE_EAST = 1  # side slip of a slope that falls east; fixed in the map
    SIDE_NORTH = 2
    CLIMB_EAST = 3  # wheel slip of a slope that rises east; fixed in the map
    CLIMB_NORTH = 4
    SIDE = 5  # side slip that turns with the body: a bias of its heading
    CLIMB = 6  # wheel slip that turns with the body: a wrong radius
    ROLL = 7  # side slip in proportion to the measured roll
    PITCH = 8  # wheel slip in proportion to the measured pitch
    TURN_SIDE = 9  # displacement to the side in proportion to the turn: a lever arm
    TURN_CLIMB = 10  # wheel slip in proportion to the yaw rate
    CURVE_SIDE = 11  # side slip in proportion to the lateral acceleration
    GAIN = 12  # wheel slip in proportion to the acceleration: a delay along the heading
    FASTER = 13  # wheel slip in proportion to the speed above its usual one


WAYS: Final = len(Way)
SLIPS: Final = WAYS - 1  # coefficients of the columns behind `TRAVELLED`
_SIZE: Final = 2 + SLIPS
_KEPT: Final = 12  # ticks of which the way is kept, for samples that arrive late

ONSETS: Final = 24
"""Number of moments at which a drift may have begun, see `observe_drift`."""


class Change(IntEnum):
    """What may have begun at an onset."""

    EAST = 0  # the receiver drifts east [m/s]
    NORTH = 1
    ENCODER = 2  # it, or the slip of the wheels that it counts, is off by a share


CHANGES: Final = len(Change)

_SETTLES_S: Final = 12.0  # from a receiver's first position to an onset that it tells of

_ONSET: Final = np.dtype(
    [
        ("tells", "f8"),  # whether the receiver had settled when the change began
        ("signature", "f8", (_SIZE, CHANGES)),  # effect of a unit change on the error of the state
        ("information", "f8", (CHANGES, CHANGES)),  # about the change [1 over its unit squared]
        ("evidence", "f8", CHANGES),  # for the change [1 over its unit]
    ]
)
"""What a receiver tells of the hypothesis that a drift or an error of the encoder began at one
moment."""

GROUND: Final = np.dtype(
    [
        (
            "ways",
            "f8",
            (_KEPT, 1 + 2 * WAYS),
        ),  # time, sums of the vectors of `Way`
        ("last", "f8", 1 + 2 * WAYS),  # the same at the last position, NaN time: none yet
        ("speed_mps", "f8"),  # of the encoder, mean of half a second
        ("usual_mps", "f8"),  # of the encoder, mean of minutes
        ("slipped", "f8", 2),  # sum of what the coefficients say of the way [m]
        ("offset", "f8", 2),  # of the last position from dead reckoning less that [m]
        ("state", "f8", _SIZE),  # r [m], then the coefficients of slips
        ("covariance", "f8", (_SIZE, _SIZE)),
        ("misfit", "f8"),  # mean normalised squared innovation of an axis
        ("steps", "f8"),  # in that mean
        ("settled_s", "f8"),  # since the first position
        ("onsets", _ONSET, ONSETS),
    ]
)
"""Memory of one receiver."""

# Standard deviations of the coefficients at the start, by `Way` behind `TRAVELLED`: where an IMU
# measures the slope, and where it does not. Tuned on drives of tuning seeds.
_IN_TURNS: Final = (0.05, 0.10, 0.10, 0.15, 0.03)  # from `TURN_SIDE` on
_WITH_SLOPE: Final = (0.012, 0.012, 0.012, 0.012, 0.03, 0.05, 0.4, 0.4, *_IN_TURNS)
_WITHOUT_SLOPE: Final = (0.06, 0.06, 0.06, 0.06, 0.03, 0.05, 0.0, 0.0, *_IN_TURNS)
_BIAS_WALK: Final = 5e-4  # of the biases of heading and radius [1/sqrt(m)]
_WALK: Final = 1e-4  # of the other coefficients [1/sqrt(m)]
_SPEED_S: Final = 0.5  # of the mean speed whose change is the acceleration
_USUAL_SPEED_S: Final = 60.0  # of the usual speed
_ALONG_M: Final = 0.020  # random walk of dead reckoning along the heading [m/sqrt(s)]: encoder
_ACROSS: Final = 0.005  # the same across [m/sqrt(m)]: side slip on bumps
_WHITE_M: Final = 0.035  # of a position, what bumps move it included
_USUAL: Final = 400.0  # steps in the mean misfit
_LARGEST_MISFIT: Final = 8.0  # that one step adds
_LONGEST_STEP_S: Final = 2.0


def new_ground() -> FloatArray:
    """Return a record `GROUND` before the first position, flat."""
    flat = np.zeros(GROUND.itemsize // 8)
    memory = flat.view(GROUND)[0]
    memory["ways"][:, 0] = math.nan
    memory["last"][0] = math.nan
    memory["misfit"] = 1.0
    return flat


@kernel
def travel(
    memory: Record,
    time_s: float,
    span_s: float,
    distance: float,
    yaw: float,
    turn: float,
    slope: FloatArray,
) -> None:
    """Add the way of a tick.

    Args:
        memory: record `GROUND`.
        time_s: end of the tick.
        span_s: length of the tick [s].
        distance: along the heading by the encoder [m].
        yaw: of the body in the middle of the tick [rad].
        turn: of the body in the tick [rad].
        slope: roll and pitch of the body [rad], (2,).
    """
    ways = memory.ways
    for row in range(_KEPT - 1):
        for column in range(1 + 2 * WAYS):
            ways[row, column] = ways[row + 1, column]
    newest = ways[_KEPT - 1]
    newest[0] = time_s

    # Unit vectors ahead and to the left, and the share of each column in the distance along them
    ahead_x = math.cos(yaw)
    ahead_y = math.sin(yaw)
    left_x = -ahead_y
    left_y = ahead_x
    _add(newest, Way.TRAVELLED, distance, ahead_x, ahead_y)
    _add(newest, Way.SIDE_EAST, distance * left_x, left_x, left_y)
    _add(newest, Way.SIDE_NORTH, distance * left_y, left_x, left_y)
    _add(newest, Way.CLIMB_EAST, distance * ahead_x, ahead_x, ahead_y)
    _add(newest, Way.CLIMB_NORTH, distance * ahead_y, ahead_x, ahead_y)
    _add(newest, Way.SIDE, distance, left_x, left_y)
    _add(newest, Way.CLIMB, distance, ahead_x, ahead_y)
    _add(newest, Way.ROLL, distance * slope[0], left_x, left_y)
    _add(newest, Way.PITCH, distance * slope[1], ahead_x, ahead_y)
    _add(newest, Way.TURN_SIDE, turn, left_x, left_y)
    _add(newest, Way.TURN_CLIMB, distance * abs(turn) / span_s, ahead_x, ahead_y)
    _add(newest, Way.CURVE_SIDE, distance * turn / span_s, left_x, left_y)

    speed = distance / span_s
    before = memory.speed_mps
    memory.speed_mps += min(1.0, span_s / _SPEED_S) * (speed - before)
    memory.usual_mps += span_s / _USUAL_SPEED_S * (speed - memory.usual_mps)
    _add(newest, Way.GAIN, memory.speed_mps - before, ahead_x, ahead_y)
    _add(newest, Way.FASTER, distance * (speed - memory.usual_mps), ahead_x, ahead_y)


@kernel
def _add(row: FloatArray, column: int, length: float, x: float, y: float) -> None:
    """Add a length along a unit vector to a column of `Way`."""
    row[1 + 2 * column] += length * x
    row[2 + 2 * column] += length * y


@kernel
def place(
    memory: Record,
    time_s: float,
    x: float,
    y: float,
    knows_slope: bool,
    way: FloatArray,
) -> bool:
    """Take in a position; return whether it was used.

    Args:
        memory: record `GROUND`.
        time_s: of the position.
        x: east [m].
        y: north [m].
        knows_slope: whether roll and pitch are measured.
        way: workspace as `GROUND.last`.
    """
    if not _interpolate(memory, time_s, way):
        return False
    last = memory.last
    span_s = time_s - last[0]
    if span_s <= 0.0:
        return False
    if not span_s <= _LONGEST_STEP_S:
        _restart(memory, way, x, y, knows_slope)
        return False
    for column in range(len(way)):
        since = way[column] - last[column]
        last[column] = way[column]
        way[column] = since
    memory.settled_s += span_s
    _predict(memory, span_s, way)
    _correct(memory, x - last[1 + 2 * Way.TRAVELLED], y - last[2 + 2 * Way.TRAVELLED])
    return True


@kernel
def _interpolate(memory: Record, time_s: float, way: FloatArray) -> bool:
    """Write the way up to a time; return whether it is known."""
    ways = memory.ways
    newest = _KEPT - 1
    if not ways[0, 0] <= time_s <= ways[newest, 0] + 1e-6:
        return False
    row = newest
    while row > 1 and ways[row - 1, 0] >= time_s:
        row -= 1
    share = (time_s - ways[row - 1, 0]) / max(ways[row, 0] - ways[row - 1, 0], 1e-9)
    for column in range(len(way)):
        before = ways[row - 1, column]
        way[column] = before + share * (ways[row, column] - before)
    way[0] = time_s
    return True


@kernel
def _restart(memory: Record, way: FloatArray, x: float, y: float, knows_slope: bool) -> None:
    """Begin anew at a position."""
    for column in range(len(way)):
        memory.last[column] = way[column]
    memory.state[:] = 0.0
    memory.state[0] = x - way[1 + 2 * Way.TRAVELLED]
    memory.state[1] = y - way[2 + 2 * Way.TRAVELLED]
    memory.slipped[:] = 0.0
    memory.offset[0] = memory.state[0]
    memory.offset[1] = memory.state[1]
    memory.covariance[:] = 0.0
    memory.covariance[0, 0] = _WHITE_M**2
    memory.covariance[1, 1] = _WHITE_M**2
    for n in range(SLIPS):
        sd = _WITH_SLOPE[n] if knows_slope else _WITHOUT_SLOPE[n]
        memory.covariance[2 + n, 2 + n] = sd**2
    for n in range(ONSETS):
        _clear(memory.onsets[n])
    memory.settled_s = 0.0


@kernel
def begin_onset(memory: Record, number: int) -> None:
    """Assume that a change begins now, in place of what was assumed under this number."""
    onset = memory.onsets[number]
    _clear(onset)
    if memory.settled_s >= _SETTLES_S:
        onset.tells = 1.0
        # As a wrong radius: both entries of r, then the coefficients of all ways but `TRAVELLED`
        onset.signature[1 + Way.CLIMB, Change.ENCODER] = 1.0


@kernel
def _clear(onset: Record) -> None:
    """Forget what a receiver told of an onset."""
    onset.tells = 0.0
    onset.signature[:] = 0.0
    onset.information[:] = 0.0
    onset.evidence[:] = 0.0


@kernel
def _predict(memory: Record, span_s: float, way: FloatArray) -> None:
    """Predict state, covariance and onsets by what was travelled since the last position.

    r grows by the columns B of the way times the coefficients k: F = [[1, B], [0, 1]].
    """
    x = memory.state
    p = memory.covariance
    for axis in range(2):
        for n in range(SLIPS):
            slipped = way[3 + 2 * n + axis] * x[2 + n]
            x[axis] += slipped
            memory.slipped[axis] += slipped

    for axis in range(2):
        for column in range(_SIZE):
            total = 0.0
            for n in range(SLIPS):
                total += way[3 + 2 * n + axis] * p[2 + n, column]
            p[axis, column] += total
    for axis in range(2):
        for row in range(_SIZE):
            total = 0.0
            for n in range(SLIPS):
                total += way[3 + 2 * n + axis] * p[row, 2 + n]
            p[row, axis] += total
    _add_noise(memory, span_s, way)

    for number in range(ONSETS):
        onset = memory.onsets[number]
        if onset.tells == 0.0:
            continue
        for axis in range(2):
            onset.signature[axis, axis] += span_s
            for change in range(CHANGES):
                total = 0.0
                for n in range(SLIPS):
                    total += way[3 + 2 * n + axis] * onset.signature[2 + n, change]
                onset.signature[axis, change] += total


@kernel
def _add_noise(memory: Record, span_s: float, way: FloatArray) -> None:
    """Add the noise of dead reckoning along and across its direction, and walks of coefficients.

    That of the encoder grows with the time, what the ground does with the distance.
    """
    p = memory.covariance
    east = way[1 + 2 * Way.TRAVELLED]
    north = way[2 + 2 * Way.TRAVELLED]
    length = math.hypot(east, north)
    if length > 1e-4:  # a vehicle at rest gathers none
        cos = east / length
        sin = north / length
        along = span_s * _ALONG_M**2
        across = length * _ACROSS**2
        p[0, 0] += along * cos**2 + across * sin**2
        p[1, 1] += along * sin**2 + across * cos**2
        mixed = (along - across) * cos * sin
        p[0, 1] += mixed
        p[1, 0] += mixed
    for n in range(SLIPS):
        if p[2 + n, 2 + n] > 0.0:
            is_bias = n in (Way.SIDE - 1, Way.CLIMB - 1)
            p[2 + n, 2 + n] += length * (_BIAS_WALK if is_bias else _WALK) ** 2


@kernel
def _correct(memory: Record, east: float, north: float) -> None:
    """Correct state, covariance and onsets by the difference of position and dead reckoning."""
    x = memory.state
    p = memory.covariance
    memory.offset[0] = east - memory.slipped[0]
    memory.offset[1] = north - memory.slipped[1]
    u = east - x[0]
    v = north - x[1]
    s_00 = p[0, 0] + _WHITE_M**2
    s_11 = p[1, 1] + _WHITE_M**2
    s_01 = p[0, 1]
    determinant = s_00 * s_11 - s_01 * s_01
    i_00 = s_11 / determinant
    i_11 = s_00 / determinant
    i_01 = -s_01 / determinant

    square = 0.5 * (u * u * i_00 + 2.0 * u * v * i_01 + v * v * i_11)
    memory.steps = min(memory.steps + 1.0, _USUAL)
    memory.misfit += (min(square, _LARGEST_MISFIT) - memory.misfit) / memory.steps

    weighted_u = i_00 * u + i_01 * v
    weighted_v = i_01 * u + i_11 * v
    for number in range(ONSETS):
        onset = memory.onsets[number]
        if onset.tells > 0.0:
            _add_evidence(onset, weighted_u, weighted_v, i_00, i_01, i_11)

    # The gain is made of the first two columns of P: r is what is compared
    for row in range(_SIZE):
        x[row] += p[row, 0] * weighted_u + p[row, 1] * weighted_v
    for number in range(ONSETS):
        onset = memory.onsets[number]
        if onset.tells == 0.0:
            continue
        for change in range(CHANGES):
            g_0 = onset.signature[0, change]
            g_1 = onset.signature[1, change]
            weighted_0 = i_00 * g_0 + i_01 * g_1
            weighted_1 = i_01 * g_0 + i_11 * g_1
            for row in range(_SIZE):
                onset.signature[row, change] -= p[row, 0] * weighted_0 + p[row, 1] * weighted_1
    _reduce_covariance(p, i_00, i_01, i_11)


@kernel
def _add_evidence(
    onset: Record, weighted_u: float, weighted_v: float, i_00: float, i_01: float, i_11: float
) -> None:
    """Add the evidence of a weighted innovation and its information about a change."""
    for change in range(CHANGES):
        g_0 = onset.signature[0, change]
        g_1 = onset.signature[1, change]
        onset.evidence[change] += g_0 * weighted_u + g_1 * weighted_v
        for other in range(CHANGES):
            h_0 = onset.signature[0, other]
            h_1 = onset.signature[1, other]
            onset.information[change, other] += g_0 * (i_00 * h_0 + i_01 * h_1)
            onset.information[change, other] += g_1 * (i_01 * h_0 + i_11 * h_1)


@kernel
def _reduce_covariance(p: FloatArray, i_00: float, i_01: float, i_11: float) -> None:
    """Take what a position has told off the covariance: P - P H' S^-1 H P."""
    # Coefficients first, then their covariance with r, then r: each is made of what follows
    for row in range(2, _SIZE):
        weighted_0 = p[row, 0] * i_00 + p[row, 1] * i_01
        weighted_1 = p[row, 0] * i_01 + p[row, 1] * i_11
        for column in range(2, row + 1):
            p[row, column] -= weighted_0 * p[column, 0] + weighted_1 * p[column, 1]
            p[column, row] = p[row, column]
    for row in range(2, _SIZE):
        _reduce_row(p, row, i_00, i_01, i_11)
    _reduce_corner(p, i_00, i_01, i_11)


@kernel
def _reduce_row(p: FloatArray, row: int, i_00: float, i_01: float, i_11: float) -> None:
    """Reduce the covariance of a coefficient with r."""
    weighted_0 = p[row, 0] * i_00 + p[row, 1] * i_01
    weighted_1 = p[row, 0] * i_01 + p[row, 1] * i_11
    p[row, 0] -= weighted_0 * p[0, 0] + weighted_1 * p[1, 0]
    p[row, 1] -= weighted_0 * p[0, 1] + weighted_1 * p[1, 1]
    p[0, row] = p[row, 0]
    p[1, row] = p[row, 1]


@kernel
def _reduce_corner(p: FloatArray, i_00: float, i_01: float, i_11: float) -> None:
    """Reduce the covariance of r itself."""
    a = p[0, 0]
    b = p[0, 1]
    d = p[1, 1]
    p[0, 0] = a - (a * (i_00 * a + i_01 * b) + b * (i_01 * a + i_11 * b))
    p[0, 1] = b - (a * (i_00 * b + i_01 * d) + b * (i_01 * b + i_11 * d))
    p[1, 1] = d - (b * (i_00 * b + i_01 * d) + d * (i_01 * b + i_11 * d))
    p[1, 0] = p[0, 1]
