"""Speed that the hydrostat's commands ask for, by the vehicle model."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from ...types import Input
from .detector import Observation
from .speed_over_ground import SPAN_S

KEPT_S: Final = 3.0
"""Age of the oldest position that speeds are compared with [s]: positions may come late."""


class PlannedSpeed:
    """K hp after the dead time and the lag of the hydrostat, at every tick."""

    def __init__(self) -> None:
        self._sent: deque[tuple[float, float]] = deque()  # end of a command [s], its value
        self._plan: deque[tuple[float, float]] = deque()  # time [s], speed [m/s]

    def history(self, observation: Observation) -> Sequence[tuple[float, float]]:
        """Return times [s] and speeds [m/s], without a sign, up to the tick of the observation.

        Several monitors may ask at one tick.
        """
        now, vehicle = observation.time_s, observation.vehicle
        if observation.command is None or (self._plan and self._plan[-1][0] >= now):
            return self._plan
        self._sent.append((now, float(observation.command.as_array()[Input.HP])))
        before, speed = self._plan[-1] if self._plan else (now, math.nan)
        while len(self._sent) > 1 and self._sent[0][0] < now - vehicle.dead_time_hp - 1e-9:
            self._sent.popleft()
        target = vehicle.speed_gain * abs(self._sent[0][1])
        if math.isnan(speed):
            speed = target
        share = 1.0 - math.exp((before - now) / vehicle.speed_time_constant)
        speed += share * (target - speed)
        self._plan.append((now, speed))
        while self._plan[0][0] < now - KEPT_S - SPAN_S:
            self._plan.popleft()
        return self._plan
