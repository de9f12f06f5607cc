"""Encoder against GNSS, and planned motion against GNSS: two speeds compared over a second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from ...types import Sensor
from .detector import Alarm, Cusum, Observation, Reaction
from .limits import MOTION, MOTION_ALLOWANCE, WHEELS, WHEELS_ALLOWANCE
from .planned_speed import KEPT_S, PlannedSpeed
from .speed_over_ground import GroundSpeed, SpeedOverGround

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

    def warm_up(self) -> None:
        """Compile what a comparison needs."""
        self._ground.warm_up()

    def _compare(self, history: Iterable[tuple[float, float]], ground: GroundSpeed) -> None:
        """Add the difference of the mean of a `history` of times and speeds over the span."""
        mean = _mean(history, ground)
        if not math.isnan(mean):
            self._speeds = mean, ground.mps
            residual = self._speeds[0] - ground.mps
            self._cusum.add(_beyond_noise(residual, ground, self._allowance))


class WheelMonitor(_SpeedMonitor):
    """Compares the speed of the driven wheels with that over ground.

    The residual is the difference of both mean speeds of a second. Above: the wheels spin, or the
    encoder reads too much. Below: it reads too little, or backward. The encoder is the one that is
    wrong where the speed over ground is nearer to the planned one.

    Args:
        ground: speed over ground, if other monitors use it too.
        plan: planned speed, likewise.
    """

    name = "wheels"
    limit = WHEELS

    def __init__(
        self, ground: SpeedOverGround | None = None, plan: PlannedSpeed | None = None
    ) -> None:
        super().__init__(WHEELS_ALLOWANCE, WHEELS, ground)
        self._plan = plan or PlannedSpeed()
        self._encoder: deque[tuple[float, float]] = deque()
        self._planned = math.nan  # over the span of the last comparison [m/s]

    def observe(self, observation: Observation) -> None:
        """Compare the speeds of the last second where there is a new position."""
        planned = self._plan.history(observation)
        sign = -1.0 if observation.vehicle.reverse else 1.0
        for sample in observation.of(Sensor.ENCODER):
            if math.isfinite(sample.value[0]):
                self._encoder.append((sample.time_s, sign * sample.value[0]))
        while self._encoder and self._encoder[0][0] < observation.time_s - KEPT_S:
            self._encoder.popleft()
        ground = self._ground.speed(observation.samples)
        if ground is not None:
            self._planned = _mean(planned, ground)
            self._compare(self._encoder, ground)

    def alarm(self) -> Alarm:
        """Return the alarm: of a wrong encoder, or of wheels that make no or too little way."""
        wheels, speed = self._speeds
        reason = f"wheels turn at {wheels:.2f} m/s, GNSS moves at {speed:.2f} m/s"
        if abs(speed - self._planned) < abs(wheels - self._planned):
            reason += f", planned {self._planned:.2f} m/s: encoder not used"
            return Alarm(self.name, reason, Reaction.GO_ON, unused=frozenset({Sensor.ENCODER}))
        spins = speed < _STANDS * wheels
        return Alarm(self.name, reason, Reaction.STOP_ON_PATH if spins else Reaction.SLOW)


class MotionMonitor(_SpeedMonitor):
    """Compares the speed that the hydrostat's commands ask for with that over ground.

    Args:
        ground: speed over ground, if other monitors use it too.
        plan: planned speed, likewise.
    """

    name = "motion"
    limit = MOTION

    def __init__(
        self, ground: SpeedOverGround | None = None, plan: PlannedSpeed | None = None
    ) -> None:
        super().__init__(MOTION_ALLOWANCE, MOTION, ground)
        self._plan = plan or PlannedSpeed()

    def observe(self, observation: Observation) -> None:
        """Continue the plan and compare it with the motion where there is a new position."""
        planned = self._plan.history(observation)
        ground = self._ground.speed(observation.samples)
        if ground is not None:
            self._compare(planned, ground)

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that does not move as commanded stops."""
        planned, speed = self._speeds
        return Alarm(
            self.name,
            f"planned speed {planned:.2f} m/s, GNSS moves at {speed:.2f} m/s",
            Reaction.STOP_ON_PATH,
        )


def _mean(history: Iterable[tuple[float, float]], ground: GroundSpeed) -> float:
    """Return the mean of the speeds of a `history` of times and speeds in a span, NaN if none."""
    values = [value for time_s, value in history if ground.begin_s <= time_s <= ground.end_s]
    return sum(values) / len(values) if values else math.nan


def _beyond_noise(residual: float, ground: GroundSpeed, allowance: float) -> float:
    """Return a residual [m/s] less what the noise of the receivers explains beyond the allowance.

    The allowance holds for three standard deviations of the speed, as with a noise of the positions
    of 10 cm. With more noise the residual is that much smaller, so that it gives no alarm.
    """
    explained = max(0.0, _SIGMAS * ground.sd_mps - allowance)
    return math.copysign(max(0.0, abs(residual) - explained), residual)
