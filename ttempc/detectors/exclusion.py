"""Exclusion of sensors by the alarms of detectors."""

from ..layout import AlarmColumn
from ..sensors import IMU_OF_BODY, SensorIndex
from .board import WARN, Record, has_alarm
from .history import kernel
from .position import excludes_gnss
from .table import DetectorIndex


@kernel
def exclude_sensors(
    board: Record, position: Record, last: Record, confirmed: bool, now: float
) -> None:
    """Exclude the sensors that alarms are about, beside those that repeat their readings.

    - wheels: the encoder, where it is what is wrong;
    - hitch: its sensor and both IMUs, of which a gyro may be what lies;
    - gyros: the IMU of that body;
    - position: both IMUs where velocities of GNSS confirm the positions, since like sensors may
      fail alike; else both receivers, while the vehicle rolls;
    - steps, second limits of drift and velocity: both receivers, while the vehicle rolls.

    The filter gets no sample of an excluded sensor from the next tick on; detectors still see them.

    Args:
        board: record `BOARD` after the alarms of the tick.
        position: record `POSITION`.
        last: record `LAST_ESTIMATE` of this tick.
        confirmed: whether measured velocities of GNSS confirm the positions.
        now: time of the tick [s].
    """
    if board.alarms[DetectorIndex.WHEELS, AlarmColumn.REACTION] == WARN:
        board.excluded[SensorIndex.ENCODER] = 1.0
    if has_alarm(board, DetectorIndex.HITCH):
        board.excluded[SensorIndex.HITCH] = 1.0
        board.excluded[SensorIndex.IMU_TRACTOR] = 1.0
        board.excluded[SensorIndex.IMU_TRAILER] = 1.0
    for body in range(2):
        if has_alarm(board, DetectorIndex.GYRO_TRACTOR + body):
            board.excluded[IMU_OF_BODY[body]] = 1.0
    if confirmed and has_alarm(board, DetectorIndex.POSITION):
        board.excluded[SensorIndex.IMU_TRACTOR] = 1.0
        board.excluded[SensorIndex.IMU_TRAILER] = 1.0
    if excludes_gnss(position, last, board, confirmed, now):
        board.excluded[SensorIndex.GNSS_TRACTOR] = 1.0
        board.excluded[SensorIndex.GNSS_TRAILER] = 1.0
