"""Detectors of a vehicle that does not move as commanded, of wheels that spin, of a hydrostat.

All compare speeds with that over ground in the mean of a second, see `speeds.py`.
"""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn
from .board import WARN, Record
from .history import cusum, kernel
from .interface import Reaction
from .table import DetectorIndex

SPEED_SUMS: Final = np.dtype([("above", "f8"), ("below", "f8")])
"""Cumulative sums [m/s] of a speed above and below that over ground."""
HYDROSTAT: Final = np.dtype([("sum", "f8")])
"""Cumulative sum [m/s] of how much nearer the ground's speed is to the wheels' than to the plan."""

_MOTION_ALLOWANCE: Final = 0.35  # [m/s], half of a shift of 0.7; assumed
_DROOP: Final = 0.2
"""Share of the planned speed by which a vehicle may be slower or faster: a hydrostat has less speed
under load. At 3.5 m/s up a slope of 0.1 rad `farm4500` loses 0.17."""
_WHEELS_ALLOWANCE: Final = 0.30  # [m/s], half of a shift of 0.6; assumed
# [m/s]; 40 drives without a fault came to 0.26 for a moment, at 1.4 m/s (seeds 4001 to 4430)
_HYDROSTAT_ALLOWANCE: Final = 0.20
_SIGMAS: Final = 3.0  # of the speed over ground that an allowance holds for
_STANDS: Final = 0.5  # share of the encoder's speed below which a vehicle spins its wheels; assumed
_SLOW: Final = float(Reaction.SLOW)
_STOP_ON_PATH: Final = float(Reaction.STOP_ON_PATH)


@kernel
def observe_motion(memory: Record, speeds: Record, board: Record) -> None:
    """Compare the planned speed with that over ground, see `_compare`.

    The vehicle does not obey its hydrostat, or GNSS does not show its motion. The planned speed has
    an error of its own that grows with it, which the allowance holds for.

    Args:
        memory: record `SPEED_SUMS`.
        speeds: record `SPEEDS`.
        board: record `BOARD`.
    """
    index = DetectorIndex.MOTION
    if speeds.known:
        allowance = max(_MOTION_ALLOWANCE, _DROOP * speeds.planned_mps)
        _compare(memory, speeds, board, index, speeds.planned_mps, allowance)


@kernel
def observe_wheels(memory: Record, speeds: Record, board: Record) -> None:
    """Compare the speed of the encoder with that over ground, see `_compare`.

    The encoder is wrong where the speed over ground is nearer to the planned one: the vehicle
    drives on without it. Else the wheels slip, by which the vehicle goes slower, or make less than
    half of their distance, by which it stops.

    Args:
        memory: record `SPEED_SUMS`.
        speeds: record `SPEEDS`.
        board: record `BOARD`.
    """
    index = DetectorIndex.WHEELS
    wheels = speeds.wheels_mps
    ground = speeds.ground_mps
    if not speeds.known or math.isnan(wheels):
        return
    _compare(memory, speeds, board, index, wheels, _WHEELS_ALLOWANCE)
    reaction = _STOP_ON_PATH if ground < _STANDS * wheels else _SLOW
    if abs(ground - speeds.planned_mps) < abs(wheels - speeds.planned_mps):
        reaction = WARN
    board.proposed[index, AlarmColumn.REACTION] = reaction


@kernel
def observe_hydrostat(memory: Record, speeds: Record, board: Record) -> None:
    """Ask whether wheels and ground agree on another speed than the planned one.

    With the planned speed p, that of the wheels u and that over ground g, the cumulative sum of

        r = |p - g| - |u - g|

    grows where the vehicle rolls as its wheels say, and not as its hydrostat was told: one that is
    stuck, cut, or of another gear. Receivers or an encoder that are wrong are nearer to no plan.
    The filter gets no command of the hydrostat then. It would believe it more than the wheels, and
    GNSS less than both.

    Args:
        memory: record `HYDROSTAT`.
        speeds: record `SPEEDS`.
        board: record `BOARD`.
    """
    index = DetectorIndex.HYDROSTAT
    planned = speeds.planned_mps
    wheels = speeds.wheels_mps
    if not speeds.known or math.isnan(planned + wheels):
        return
    nearer = abs(planned - speeds.ground_mps) - abs(wheels - speeds.ground_mps)
    allowance = max(_HYDROSTAT_ALLOWANCE, _DROOP * planned)
    memory.sum = cusum(memory.sum, nearer, allowance, board.limit[index])
    board.statistic[index] = memory.sum
    board.residual[index] = nearer
    board.proposed[index, AlarmColumn.FIRST] = planned
    board.proposed[index, AlarmColumn.SECOND] = wheels


@kernel
def _compare(
    memory: Record, speeds: Record, board: Record, index: int, speed: float, allowance: float
) -> None:
    """Add the residual of a speed v against that over ground, w, to cumulative sums.

    With the standard deviation s of w and the allowance k,

        r = sign(v - w) max(0, |v - w| - max(0, 3 s - k)),

    so that the allowance holds for three standard deviations, as with a noise of the positions of
    10 cm; more noise makes the residual smaller and gives no alarm. The statistic is the larger of
    the sums to both sides, see `cusum`. Nothing changes where v is not known.
    """
    if math.isnan(speed):
        return
    difference = speed - speeds.ground_mps
    noise = max(0.0, _SIGMAS * speeds.ground_sd_mps - allowance)
    residual = math.copysign(max(0.0, abs(difference) - noise), difference)

    memory.above = cusum(memory.above, residual, allowance, board.limit[index])
    memory.below = cusum(memory.below, -residual, allowance, board.limit[index])
    board.statistic[index] = max(memory.above, memory.below)
    board.residual[index] = residual
    board.proposed[index, AlarmColumn.FIRST] = speed
    board.proposed[index, AlarmColumn.SECOND] = speeds.ground_mps
    board.proposed[index, AlarmColumn.THIRD] = speeds.planned_mps


@kernel
def wheels_spin(motion: Record, wheels: Record) -> bool:
    """Return whether wheels and commands are faster than the ground, rather than slower."""
    return motion.above + wheels.above > motion.below + wheels.below


@kernel
def hold_motion(board: Record) -> None:
    """Keep an alarm of motion while both receivers contradict the estimate.

    Receivers that are swapped show no motion in the wrong direction for long.
    """
    both = min(
        board.alarms[DetectorIndex.INNOVATIONS_GNSS_TRACTOR, AlarmColumn.REACTION],
        board.alarms[DetectorIndex.INNOVATIONS_GNSS_TRAILER, AlarmColumn.REACTION],
    )
    if both >= 0.0 and board.alarms[DetectorIndex.MOTION, AlarmColumn.REACTION] >= 0.0:
        limit = board.limit[DetectorIndex.MOTION]
        board.statistic[DetectorIndex.MOTION] = max(limit, board.statistic[DetectorIndex.MOTION])
