"""Reaction to alarms: go on, slow down, or stop until the cause has ended."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .detector import Alarm, Reaction

_STANDING: Final = 0.05  # [m/s] largest speed of a vehicle that stands
_QUIET_S: Final = 2.0  # without an alarm before a vehicle that stands drives on; assumed
# Where the cause shows only while the vehicle drives, as with spinning wheels, it must not stop and
# start for ever.
_RESTARTS: Final = 1
_FORGOTTEN_S: Final = 60.0  # of driving after which the restarts count anew; assumed


class Reactions:
    """Turns alarms into what the supervisor does, and holds a stop until the vehicle may drive on.

    After a stop the vehicle stands until no alarm has asked for one for 2 s. It starts once again;
    the second stop within a minute of driving is for good.
    """

    def __init__(self) -> None:
        self._stopped = ""  # reason of the stop that is held
        self._way = Reaction.STOP  # of that stop
        self._last_s = -math.inf  # time of the last alarm that asked for a stop
        self._restarts = 0

    def decide(self, alarms: Sequence[Alarm], speed: float, time_s: float) -> tuple[Reaction, str]:
        """Return the strongest reaction and its reasons.

        Args:
            alarms: that stand now.
            speed: estimated [m/s].
            time_s: present time.
        """
        stops = [alarm for alarm in alarms if alarm.reaction >= Reaction.STOP_ON_PATH]
        if stops:
            strongest = max(alarm.reaction for alarm in stops)
            if not self._stopped and time_s - self._last_s > _FORGOTTEN_S:
                self._restarts = 0
            self._way = max(self._way, strongest) if self._stopped else strongest
            self._stopped, self._last_s = self._stopped or stops[0].reason, time_s
        elif self._stopped:
            rests = abs(speed) <= _STANDING and time_s - self._last_s >= _QUIET_S
            if rests and self._restarts < _RESTARTS:
                self._stopped, self._restarts = "", self._restarts + 1
        if self._stopped:
            return self._way, self._stopped
        reaction = max((alarm.reaction for alarm in alarms), default=Reaction.GO_ON)
        return reaction, "; ".join(alarm.reason for alarm in alarms)
