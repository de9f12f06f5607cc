"""Detector of a common drift of both receivers."""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn
from ..types import Disturbance, FloatArray, MapDisturbance, State
from .board import Record, TickData, has_alarm
from .history import kernel
from .standstill import check_standstill
from .table import DetectorIndex

DRIFT: Final = np.dtype(
    [
        ("accepted", "f8", 2),  # apparent drift over the speed that a slope explains: east, north
        ("flat", "f8", 2),  # mean apparent drift over its bound, as on a flat field
        ("changed", "f8", 2),  # the mean of its change from the accepted one over the bound
        ("slip_short", "f8"),  # mean wheel slip beside that on slopes, NaN: none yet
        ("slip_usual", "f8"),  # its mean over a longer time
        ("inflation", "f8"),  # factor of the bounds after a check that was passed
    ]
)
"""Memory of the detector."""

# A pure drift w at the speed v shows side slip w / v and wheel slip -w / v: both shares add to 1.
_SIDE_SHARE: Final = 0.65  # of side slip in the apparent drift
_WHEEL_SHARE: Final = 0.35  # of wheel slip, which a rut leaves alone
_BOUND: Final = 0.010  # of the apparent drift over the speed
_ROUGHER: Final = 0.05  # by which the bound grows with the learnt factor of roughness
_SLOPE: Final = 2.0  # by which it grows with wheel slip beyond that of a drift
_SLIP_BOUND: Final = 0.08  # of the change of wheel slip beside that on slopes
_DRIFT_S: Final = 3.0  # of the mean apparent drift
_SHORT_S: Final = 1.5  # of the short mean of wheel slip
_USUAL_S: Final = 30.0  # of its usual mean
_JUDGED_S: Final = 20.0  # from the start on
_MOVING_MPS: Final = 0.1
_LONGEST_TICK_S: Final = 1.0
_PASSED: Final = 2.0  # factor by which a check that was passed raises the bounds; assumed
_MOST_INFLATION: Final = 8.0  # assumed
_INFLATION_S: Final = 900.0  # in which the factor fades; assumed


def new_drift() -> FloatArray:
    """Return a record `DRIFT` before the first estimate, flat."""
    flat = np.zeros(DRIFT.itemsize // 8)
    memory = flat.view(DRIFT)[0]
    memory["slip_short"] = math.nan
    memory["slip_usual"] = math.nan
    memory["inflation"] = 1.0
    return flat


def apparent_drift(map_disturbance: FloatArray) -> FloatArray:
    """Return the drift over the speed, east and north, that a `MapDisturbance` (4,) looks like."""
    side = map_disturbance[: MapDisturbance.CLIMB_X]
    climb = map_disturbance[MapDisturbance.CLIMB_X :]
    return _SIDE_SHARE * side - _WHEEL_SHARE * climb


@kernel
def observe_drift(
    memory: Record,
    standstill: Record,
    board: Record,
    data: TickData,
    roughness: float,
    position_sd: float,
) -> None:
    """Look for a drift in the slips of the estimate, then check it at rest.

    At a common drift w of both receivers and a speed v the filter finds a side slip of w / v and a
    wheel slip of -w / v, fixed in the map. A slope has such slips, too, and ruts have the former.
    The statistic is the larger of two ratios over a factor of inflation:

    - `_drift_ratio`: a weighted difference of both slips, against 0 and against the accepted one;
    - `_slip_ratio`: the wheel slip beside that on slopes, against its usual mean.

    Above the limit of 1 the vehicle stops, and `check_standstill` watches GNSS at rest for as long
    as its noise takes. If GNSS moves it drifts. Else the slips are accepted, the vehicle drives on,
    and the factor doubles (8 at most) and fades in 15 minutes. A tool in the soil has slips of its
    own: the limit is infinite then.

    Args:
        memory: record `DRIFT`.
        standstill: record `STANDSTILL`.
        board: record `BOARD`.
        data: of the tick.
        roughness: mean of the learnt factor of roughness.
        position_sd: of the white noise of the positions [m].
    """
    index = DetectorIndex.DRIFT
    slips = data.estimate.map_disturbance
    side_x = slips[MapDisturbance.SIDE_X]
    side_y = slips[MapDisturbance.SIDE_Y]
    climb_x = slips[MapDisturbance.CLIMB_X]
    climb_y = slips[MapDisturbance.CLIMB_Y]
    east = _SIDE_SHARE * side_x - _WHEEL_SHARE * climb_x
    north = _SIDE_SHARE * side_y - _WHEEL_SHARE * climb_y
    if data.now < _JUDGED_S and math.isfinite(east + north):
        _accept(memory, east, north)  # the slope at the start

    # Of a drift, wheel slip is as large as side slip, with the other sign. More is a slope.
    side = math.hypot(side_x, side_y)
    wheel_slip_against_side = -(side_x * climb_x + side_y * climb_y) / max(side, 1e-9)
    bound = _BOUND * max(1.0, 1.0 + _ROUGHER * (roughness - 1.0))
    bound += _SLOPE * max(0.0, wheel_slip_against_side - side)
    slip = _slip_beside_slopes(data)

    statistic = 0.0
    if has_alarm(board, index):
        statistic = board.limit[index]  # the alarm neither begins anew nor ends before the check
        if check_standstill(standstill, board, data, position_sd):
            statistic = 0.0
            _pass(memory, east, north)
    elif 0.0 < data.span_s <= _LONGEST_TICK_S and math.isfinite(bound + slip):
        fading = math.exp(-data.span_s / _INFLATION_S)
        memory.inflation = 1.0 + (memory.inflation - 1.0) * fading
        if abs(data.estimate.state[State.V]) > _MOVING_MPS and data.now >= _JUDGED_S:
            _average(memory, data.span_s, east, north, bound)
            _average_slip(memory, data.span_s, slip)
        ratio = max(_drift_ratio(memory), _slip_ratio(memory))
        statistic = ratio / memory.inflation
        if ratio > memory.inflation * board.limit[index]:
            speed = abs(data.estimate.state[State.V])
            board.proposed[index, AlarmColumn.FIRST] = 100.0 * speed * math.hypot(east, north)
    board.statistic[index] = statistic
    board.residual[index] = statistic


@kernel
def _slip_beside_slopes(data: TickData) -> float:
    """Return the wheel slip without the part that is fixed in the map."""
    state = data.estimate.state
    slips = data.estimate.map_disturbance
    gear = math.copysign(1.0, state[State.V])
    climb = slips[MapDisturbance.CLIMB_X] * math.cos(state[State.PSI_T])
    climb += slips[MapDisturbance.CLIMB_Y] * math.sin(state[State.PSI_T])
    return data.estimate.disturbance[Disturbance.WHEEL] - gear * climb


@kernel
def _average(memory: Record, span_s: float, east: float, north: float, bound: float) -> None:
    """Take the apparent drift into its means: as on a flat field, and from the accepted one."""
    share = min(1.0, span_s / _DRIFT_S)
    memory.flat[0] += share * (east / bound - memory.flat[0])
    memory.flat[1] += share * (north / bound - memory.flat[1])
    memory.changed[0] += share * ((east - memory.accepted[0]) / bound - memory.changed[0])
    memory.changed[1] += share * ((north - memory.accepted[1]) / bound - memory.changed[1])


@kernel
def _average_slip(memory: Record, span_s: float, slip: float) -> None:
    """Take the wheel slip beside that on slopes into its short and its usual mean."""
    if math.isnan(memory.slip_short):
        memory.slip_short = slip
    if math.isnan(memory.slip_usual):
        memory.slip_usual = slip
    memory.slip_short += min(1.0, span_s / _SHORT_S) * (slip - memory.slip_short)
    memory.slip_usual += min(1.0, span_s / _USUAL_S) * (slip - memory.slip_usual)


@kernel
def _drift_ratio(memory: Record) -> float:
    """Return the apparent drift over its bound: that on a flat field, or the change if smaller."""
    flat = math.hypot(memory.flat[0], memory.flat[1])
    return min(flat, math.hypot(memory.changed[0], memory.changed[1]))


@kernel
def _slip_ratio(memory: Record) -> float:
    """Return the change of the wheel slip from its usual mean over its bound, 0 at first."""
    if math.isnan(memory.slip_short):
        return 0.0
    return abs(memory.slip_short - memory.slip_usual) / _SLIP_BOUND


@kernel
def _accept(memory: Record, east: float, north: float) -> None:
    """Take an apparent drift for that of a slope."""
    memory.accepted[0] = east
    memory.accepted[1] = north


@kernel
def _pass(memory: Record, east: float, north: float) -> None:
    """Accept the slips after a check that was passed, and raise the bounds."""
    _accept(memory, east, north)
    memory.flat[:] = 0.0
    memory.changed[:] = 0.0
    memory.slip_short = math.nan
    memory.slip_usual = math.nan
    memory.inflation = min(_PASSED * memory.inflation, _MOST_INFLATION)
