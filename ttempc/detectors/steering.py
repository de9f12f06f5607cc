"""Detectors of a steering valve that does not follow its command; two for each valve."""

from .board import Record
from .history import kernel
from .table import DetectorIndex
from .valve import moves


@kernel
def observe_steering(valve: Record, board: Record, axis: int) -> None:
    """Take the least of the sums of all possible dead times, see `compare_valve`.

    With the mean angle a of a tick and the range [l_d, h_d] that the response covers in an interval
    d of dead times, the residual and the statistic g [rad] are

        r_d = (a - clip(a, l_d, h_d)) / scale,   g = min over d of max(g+_d, g-_d),

    with `cusum` sums at an allowance of 1.25 deg. A stuck, slow or misled valve agrees with no dead
    time. The limit of 0.060 rad is by drives without faults, see `table.py`.

    Args:
        valve: record `VALVE`.
        board: record `BOARD`.
        axis: 0 of the front steering, 1 of the trailer's.
    """
    index = DetectorIndex.STEERING_FRONT + axis
    board.statistic[index] = valve.least_of_all.sum
    board.residual[index] = valve.least_of_all.residual


@kernel
def observe_standstill(valve: Record, board: Record, axis: int) -> None:
    """Take the least of the sums of the dead times that the valve has not refuted yet.

    It is as of `observe_steering`, without the intervals that the valve has contradicted in the
    last minute, and 0 while the angle moves. So it is earlier for a stuck valve; commands that are
    late or lost for a moment show as well. The limit of 0.035 rad is by drives without faults.

    Args:
        valve: record `VALVE`.
        board: record `BOARD`.
        axis: 0 of the front steering, 1 of the trailer's.
    """
    index = DetectorIndex.STANDSTILL_FRONT + axis
    board.statistic[index] = 0.0 if moves(valve) else valve.least.sum
    board.residual[index] = valve.least.residual
