"""Encoder against GNSS, and planned motion against GNSS: two speeds compared over a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from ...types import Input, Sensor
from .detector import Alarm, Cusum, Observation, Reaction
from .limits import MOTION, MOTION_ALLOWANCE, WHEELS, WHEELS_ALLOWANCE
from .speed_over_ground import SPAN_S, GroundSpeed, SpeedOverGround

_KEPT_S: Final = 3.0  # of speeds, for positions that come late
_SIGMAS: Final = 3.0
_STANDS: Final = 0.5  # share of the encoder's speed below which a vehicle makes no way


class _SpeedMonitor:
    """Cumulative sum of the difference of a speed from that over ground.

    Args:
        allowance: of the sum, and of the noise of the speed over ground [m/s].
        limit: of the sum [m/s].
        ground: speed over ground, if other monitors use it too.
    """

    def __init__(self, allowance: float, limit: float, ground: SpeedOverGround | None) -> None:
        self._allowance = allowance
        self._cusum = Cusum(allowance, limit)
        self._ground = ground or SpeedOverGround()
        self._speeds = 0.0, 0.0  # compared at last: the speed in question, over ground [m/s]

    @property
    def statistic(self) -> float:
        """Larger sum of the residuals [m/s]."""
        return self._cusum.largest

    @property
    def residual(self) -> float:
        """Latest residual [m/s]."""
        return self._cusum.residual

    def _compare(self, history: Iterable[tuple[float, float]], ground: GroundSpeed) -> None:
        """Add the difference of the mean of a `history` of times and speeds over the span."""
        values = [value for time_s, value in history if ground.begin_s <= time_s <= ground.end_s]
        if values:
            self._speeds = abs(sum(values)) / len(values), ground.mps
            residual = self._speeds[0] - ground.mps
            self._cusum.add(_beyond_noise(residual, ground, self._allowance))


class WheelMonitor(_SpeedMonitor):
    """Compares the speed of the driven wheels with that over ground.

    The residual is the difference of both mean speeds of a second. Above: the wheels spin, or the
    receivers repeat a position. Below: the encoder reads too little.

    Args:
        ground: speed over ground, if other monitors use it too.
    """

    name = "wheels"
    limit = WHEELS

    def __init__(self, ground: SpeedOverGround | None = None) -> None:
        super().__init__(WHEELS_ALLOWANCE, WHEELS, ground)
        self._encoder: deque[tuple[float, float]] = deque()

    def observe(self, observation: Observation) -> None:
        """Compare the speeds of the last second where there is a new position."""
        for sample in observation.samples:
            if sample.sensor is Sensor.ENCODER and math.isfinite(sample.value[0]):
                self._encoder.append((sample.time_s, sample.value[0]))
        while self._encoder and self._encoder[0][0] < observation.time_s - _KEPT_S:
            self._encoder.popleft()
        ground = self._ground.speed(observation.samples)
        if ground is not None:
            self._compare(self._encoder, ground)

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that makes no way stops, one with a wrong encoder goes on."""
        wheels, speed = self._speeds
        spins = speed < _STANDS * wheels
        return Alarm(
            self.name,
            f"wheels turn at {wheels:.2f} m/s, GNSS moves at {speed:.2f} m/s",
            Reaction.STOP_ON_PATH if spins else Reaction.SLOW,
        )


class MotionMonitor(_SpeedMonitor):
    """Compares the speed that the hydrostat's commands ask for with that over ground.

    The planned speed is that of the vehicle model: K hp after the dead time and the lag of the
    hydrostat, as its mean over the second of the positions.

    Args:
        ground: speed over ground, if other monitors use it too.
    """

    name = "motion"
    limit = MOTION

    def __init__(self, ground: SpeedOverGround | None = None) -> None:
        super().__init__(MOTION_ALLOWANCE, MOTION, ground)
        self._sent: deque[tuple[float, float]] = deque()  # end of a command [s], its value
        self._plan: deque[tuple[float, float]] = deque()  # time [s], speed [m/s]

    def observe(self, observation: Observation) -> None:
        """Continue the plan and compare it with the motion where there is a new position."""
        now, vehicle = observation.time_s, observation.vehicle
        if observation.command is not None:
            self._sent.append((now, float(observation.command.as_array()[Input.HP])))
            before, speed = self._plan[-1] if self._plan else (now, math.nan)
            while len(self._sent) > 1 and self._sent[0][0] < now - vehicle.dead_time_hp - 1e-9:
                self._sent.popleft()
            target = vehicle.speed_gain * abs(self._sent[0][1])
            if math.isnan(speed):
                speed = target
            speed += (1.0 - math.exp((before - now) / vehicle.speed_time_constant)) * (
                target - speed
            )
            self._plan.append((now, speed))
            while self._plan[0][0] < now - _KEPT_S - SPAN_S:
                self._plan.popleft()
        ground = self._ground.speed(observation.samples)
        if ground is not None:
            self._compare(self._plan, ground)

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that does not move as commanded stops."""
        planned, speed = self._speeds
        return Alarm(
            self.name,
            f"planned speed {planned:.2f} m/s, GNSS moves at {speed:.2f} m/s",
            Reaction.STOP_ON_PATH,
        )


def _beyond_noise(residual: float, ground: GroundSpeed, allowance: float) -> float:
    """Return a residual [m/s] less what the noise of the receivers explains beyond the allowance.

    The allowance holds for three standard deviations of the speed, as with a noise of the positions
    of 10 cm. With more noise the residual is that much smaller, so that it gives no alarm.
    """
    explained = max(0.0, _SIGMAS * ground.sd_mps - allowance)
    return math.copysign(max(0.0, abs(residual) - explained), residual)
