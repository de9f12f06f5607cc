"""Detector of a hitch angle that contradicts the motion of both bodies."""

import math
from typing import Final

import numpy as np

from ..layout import InnovationColumn
from ..sensors import SensorIndex
from ..types import Disturbance, MapDisturbance, State
from .board import Record, TickData, has_alarm
from .gyro import blame_gyros
from .history import forget, kernel, remember, sums
from .table import DetectorIndex

_ENTRIES: Final = 102  # of a second: control at 100 Hz

HITCH: Final = np.dtype(
    [
        # History of the sums of a tick's whitened innovations, and their numbers
        ("innovations", "f8", (1 + _ENTRIES, 3)),
        ("since_s", "f8"),  # time from which on the filter settles: the start, or that of a gyro
    ]
)
"""Memory of the detector."""

SETTLED_S: Final = 8.0
"""Time in which the filter settles [s], from the start on or without a gyro."""
_SPAN_S: Final = 1.0  # of the innovations that are summed up
_SAME_TIME_S: Final = 1e-6
_MEAN_BOUND: Final = 7.0  # deviations of the mean innovation of a second; by hand
_CURVE: Final = math.radians(0.25)  # [rad] of a sensor in order beside its offset; assumed
_SLIP_BOUND: Final = 0.032  # [rad] side slip of the tractor less that of the trailer; by hand


@kernel
def observe_hitch(memory: Record, board: Record, data: TickData, gyros: Record) -> None:
    """Compare the hitch angle with the estimate, and the side slips of both bodies.

    The statistic is the larger of two ratios to bounds.

    - Innovations: whitened ones e are standard normal. Of n in a second, with the curve c of a
      sensor in order over the standard deviation of the innovation,

          |sum e| / n / (7 / sqrt(n) + c).

      They do not count while GNSS or a steering angle contradicts the estimate, which would be
      wrong then, not the hitch angle.
    - Slip: a wrong hitch angle turns the estimated trailer against its motion. The side slip of the
      tractor less that of the trailer, without the parts that are fixed in the map, is near 0 on
      any slope,

          |alpha_t - alpha_i| / (0.032 (1 + (8 s / t)^2)),

      with a bound that is larger while the filter settles.

    Both bounds are set by hand above what drives without a fault reached. A gyro that lies makes
    the same contradictions. Where one contradicts the wheels, the alarm is that of the gyro, and
    the filter settles anew, without it. Else it is that of the hitch angle and stands until
    `resume`: neither its sensor nor the IMUs, of which a gyro may still be what lies, are used
    again.

    Args:
        memory: record `HITCH`.
        board: record `BOARD`.
        data: of the tick.
        gyros: records `GYRO` of tractor and trailer, after this tick.
    """
    index = DetectorIndex.HITCH
    curve = _take_innovations(memory, board, data)
    total, entries = sums(memory.innovations)

    statistic = 0.0
    settling_s = data.now - memory.since_s
    slip = _slip_between_bodies(data)
    if settling_s >= SETTLED_S and not math.isnan(slip):
        settling = 1.0 + (SETTLED_S / settling_s) ** 2
        statistic = abs(slip) / (_SLIP_BOUND * settling)
        if entries:
            bound = _MEAN_BOUND / math.sqrt(entries) + curve
            statistic = max(statistic, abs(total) / entries / bound)
        board.residual[index] = statistic
    if has_alarm(board, index):  # an alarm does not end by itself
        statistic = max(1.0, statistic)
    elif statistic > board.limit[index] and blame_gyros(gyros, board):
        memory.since_s = data.now
        statistic = 0.0
    board.statistic[index] = statistic


@kernel
def _take_innovations(memory: Record, board: Record, data: TickData) -> float:
    """Add the whitened innovations of the hitch angle; return a sensor's curve in deviations."""
    total = 0.0
    entries = 0.0
    curve = 0.0
    trusted = _others_agree(board, data)
    for row in range(len(data.innovations)):
        innovation = data.innovations[row]
        sensor = int(innovation[InnovationColumn.SENSOR])
        whitened = innovation[InnovationColumn.WHITENED_FIRST]
        if sensor == SensorIndex.HITCH and math.isfinite(whitened):
            total += whitened
            entries += 1.0
            # The determinant of one entry is the variance of the innovation.
            curve = _CURVE * math.exp(-0.5 * innovation[InnovationColumn.LOG_DETERMINANT])

    if not trusted:
        forget(memory.innovations)
        entries = 0.0
    oldest_s = data.now - _SPAN_S + _SAME_TIME_S
    remember(memory.innovations, oldest_s, data.now if entries else math.nan, total, entries)
    return 0.0 if math.isnan(curve) else curve


@kernel
def _others_agree(board: Record, data: TickData) -> bool:
    """Return whether neither a receiver nor a steering angle contradicts the estimate."""
    agree = not has_alarm(board, DetectorIndex.INNOVATIONS_GNSS_TRACTOR)
    agree = agree and not has_alarm(board, DetectorIndex.INNOVATIONS_GNSS_TRAILER)
    for index in range(DetectorIndex.STEERING_FRONT, DetectorIndex.MOTION):
        agree = agree and not has_alarm(board, index)
    for row in range(len(data.innovations)):
        innovation = data.innovations[row]
        sensor = int(innovation[InnovationColumn.SENSOR])
        if sensor == SensorIndex.STEERING_TRACTOR or sensor == SensorIndex.STEERING_TRAILER:
            none = innovation[InnovationColumn.DIMENSION] == 0.0
            agree = agree and (none or innovation[InnovationColumn.ACCEPTED] > 0.0)
    return agree


@kernel
def _slip_between_bodies(data: TickData) -> float:
    """Return the side slip of the tractor less that of the trailer, without slopes [rad].

    A slope has the slips (g_x, g_y) in the map, of which a body at the heading psi has
    g_y cos(psi) - g_x sin(psi), with the other sign in reverse.
    """
    state = data.estimate.state
    disturbance = data.estimate.disturbance
    slopes = data.estimate.map_disturbance
    psi_t = state[State.PSI_T]
    psi_i = state[State.PSI_I]
    gear = math.copysign(1.0, state[State.V])
    g_x = gear * slopes[MapDisturbance.SIDE_X]
    g_y = gear * slopes[MapDisturbance.SIDE_Y]
    slip = disturbance[Disturbance.SLIP_T] - disturbance[Disturbance.SLIP_I]
    return slip - (
        g_y * (math.cos(psi_t) - math.cos(psi_i)) - g_x * (math.sin(psi_t) - math.sin(psi_i))
    )
