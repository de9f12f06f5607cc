"""Detectors of faults: what they observe, when they give an alarm, what follows from it.

The limits are those at which all detectors together give at most one false alarm in ten hours on
every shipped scenario, or above, from tuning seeds; both steering angles, and both receivers, have
the larger one of the two. An allowance is half of the shift of a residual that is to be detected,
as usual for a cumulative sum (Montgomery, Introduction to Statistical Quality Control, ch. 9). The
shifts are assumed: a steering angle 2.5 deg off its command, and a speed that is 0.6 m/s, in the
case of motion 0.7 m/s, off.
"""

import math
from bisect import bisect_left, bisect_right, insort
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from ..jit import cached_njit
from ..types import Command, Estimate, FloatArray, Input, Measurement, Sensor
from ..vehicle import Vehicle

STEERING_ALLOWANCE: Final = math.radians(1.25)
STEERING: Final = 0.035  # [rad] of a valve that stands still
STEERING_STOP: Final = 0.060  # [rad] of any valve
WHEELS_ALLOWANCE: Final = 0.30  # [m/s]
WHEELS: Final = 1.10  # [m/s]
MOTION_ALLOWANCE: Final = 0.35  # [m/s]
MOTION: Final = 0.75  # [m/s]
REPETITIONS: Final = 2.5  # bit-identical readings in succession; assumed
INNOVATION: Final = {  # standard normal equivalents
    Sensor.GNSS_TRACTOR: 7.8,
    Sensor.GNSS_TRAILER: 7.8,
    Sensor.HITCH: 8.3,
    Sensor.ENCODER: 5.0,
}
_ENDS: Final = 0.5  # share of its limit below which a statistic ends an alarm
_SATURATION: Final = 1.5  # limits at which a sum saturates: an alarm ends soon after its cause


class Reaction(IntEnum):
    """Reaction of the supervisor to an alarm, the mildest first."""

    GO_ON = 0  # degraded: the reason is reported
    SLOW = 1  # half speed
    STOP_ON_PATH = 2  # stop, and steer along the path for as long as the vehicle rolls
    STOP = 3  # stop and hold the steering


@dataclass(frozen=True, slots=True)
class Observation:
    """Data of one control tick that a detector may use."""

    time_s: float  # of the tick, from the first one
    samples: Sequence[Measurement]  # that arrived since the tick before, of sensors that work
    command: Command | None  # of the period before; None at the first tick
    estimate: Estimate
    vehicle: Vehicle  # present model parameters
    _of_sensor: dict[Sensor, list[Measurement]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        for sample in self.samples:
            self._of_sensor.setdefault(sample.sensor, []).append(sample)

    def of(self, sensor: Sensor) -> Sequence[Measurement]:
        """Return the samples of one sensor in the order of arrival."""
        return self._of_sensor.get(sensor, ())


@dataclass(frozen=True, slots=True)
class Alarm:
    """A detector's statement that something is wrong."""

    detector: str  # its name
    reason: str  # for log and driver
    reaction: Reaction
    unused: frozenset[Sensor] = frozenset()  # sensors whose samples are not to be used


class Detector:
    """A statistic that grows with a fault, and the limit at which it is one."""

    def __init__(self, name: str, limit: float) -> None:
        self.name, self.limit = name, limit
        self.statistic = 0.0  # present value, 0 or above
        self.residual = math.nan  # latest value of what the statistic is made from

    def observe(self, observation: Observation) -> None:
        """Take in the data of a tick; they are not changed."""
        raise NotImplementedError

    def alarm(self) -> Alarm:
        """Return the alarm for the present statistic."""
        raise NotImplementedError


class Monitors:
    """Runs detectors and keeps their alarms until the causes end.

    An alarm begins where a statistic exceeds its limit and ends where it falls below half of it.
    A detector does not see the samples that are not to be used by an alarm of one before it.
    """

    def __init__(self, detectors: Sequence[Detector]) -> None:
        self.detectors = tuple(detectors)
        self._active: dict[str, Alarm] = {}  # by detector

    def observe(self, observation: Observation) -> tuple[Alarm, ...]:
        """Return the alarms that stand after the data of a tick."""
        for detector in self.detectors:
            detector.observe(observation)
            statistic = detector.statistic
            if statistic > detector.limit:
                self._active.setdefault(detector.name, detector.alarm())
            elif not self._active:
                continue
            elif statistic < _ENDS * detector.limit:
                self._active.pop(detector.name, None)
            alarm = self._active.get(detector.name)
            if alarm is not None and alarm.unused:
                samples = _without(observation.samples, alarm.unused)
                observation = replace(observation, samples=samples)
        return tuple(self._active.values())

    def usable(self, samples: Sequence[Measurement]) -> Sequence[Measurement]:
        """Return the samples without those of sensors that an alarm rules out."""
        for alarm in self._active.values():
            if alarm.unused:
                samples = _without(samples, alarm.unused)
        return samples


def _without(samples: Sequence[Measurement], unused: frozenset[Sensor]) -> list[Measurement]:
    return [sample for sample in samples if sample.sensor not in unused]


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
        self._kind = Reaction.STOP  # of that stop
        self._last_s = -math.inf  # time of the last alarm that asked for a stop
        self._restarts = 0

    def decide(self, alarms: Sequence[Alarm], speed: float, time_s: float) -> tuple[Reaction, str]:
        """Return the strongest reaction to the alarms that stand at a time, and its reasons.

        `speed` is the estimated one [m/s].
        """
        stops = [alarm for alarm in alarms if alarm.reaction >= Reaction.STOP_ON_PATH]
        if stops:
            strongest = max(alarm.reaction for alarm in stops)
            if not self._stopped and time_s - self._last_s > _FORGOTTEN_S:
                self._restarts = 0
            self._kind = max(self._kind, strongest) if self._stopped else strongest
            self._stopped, self._last_s = self._stopped or stops[0].reason, time_s
        elif self._stopped:
            rests = abs(speed) <= _STANDING and time_s - self._last_s >= _QUIET_S
            if rests and self._restarts < _RESTARTS:
                self._stopped, self._restarts = "", self._restarts + 1
        if self._stopped:
            return self._kind, self._stopped
        reaction = max((alarm.reaction for alarm in alarms), default=Reaction.GO_ON)
        return reaction, "; ".join(alarm.reason for alarm in alarms)


class Cusum:
    """Cumulative sums of a residual to both sides (Page 1954, Biometrika 41).

        g+ = max(0, g+ + r - k),   g- = max(0, g- - r - k)

    They grow where the mean residual is above the allowance k, half of the shift to be detected.
    """

    def __init__(self, allowance: float, limit: float) -> None:
        self._allowance, self._most = allowance, _SATURATION * limit
        self.above = self.below = 0.0  # g+, g-
        self.residual = math.nan  # of the last tick

    def add(self, residual: float) -> None:
        self.residual = residual
        self.above = min(max(0.0, self.above + residual - self._allowance), self._most)
        self.below = min(max(0.0, self.below - residual - self._allowance), self._most)

    @property
    def largest(self) -> float:
        return max(self.above, self.below)


_SPAN_S: Final = 1.0
# Largest contribution of a sample: a single outlier, which the gate rejects, gives no alarm.
_MOST_SQUARE: Final = 25.0


class InnovationMonitor(Detector):
    """Sums up the normalised squared innovations of one sensor over a second.

    For a consistent filter the sum is chi-square with n degrees of freedom, the entries of all
    samples. The statistic is its standard normal equivalent (Wilson and Hilferty 1931),

        ((S / n)^(1/3) - (1 - 2 / (9 n))) / sqrt(2 / (9 n)),

    0 where it is below its mean. A refused sample, of a false time for example, does not count.
    """

    def __init__(self, what: str, sensor: Sensor) -> None:
        super().__init__(f"innovations of the {what}", INNOVATION[sensor])
        self._sensor, self._what = sensor, what
        self._ticks: deque[tuple[float, float, int]] = deque()  # time [s], sum of squares, entries

    def observe(self, observation: Observation) -> None:
        now, sensor, total, n = observation.time_s, self._sensor, 0.0, 0
        for item in observation.estimate.innovations:
            if item.sensor is sensor and math.isfinite(item.normalised_squared):
                total += min(item.normalised_squared, _MOST_SQUARE)
                n += item.dimension
        if n:
            self._ticks.append((now, total, n))
        while self._ticks and self._ticks[0][0] < now - _SPAN_S + 1e-6:
            self._ticks.popleft()
        self.statistic, self.residual = 0.0, math.nan
        if self._ticks:
            n = sum([entries for _, _, entries in self._ticks])
            mean, spread = sum([square for _, square, _ in self._ticks]) / n, 2.0 / (9.0 * n)
            equivalent = (mean ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
            self.statistic = self.residual = max(0.0, equivalent)

    def alarm(self) -> Alarm:
        return Alarm(self.name, f"{self._what} contradicts the estimate", Reaction.GO_ON)


# A sensor of coarse resolution repeats readings in good health; it is not judged. Assumed.
_LEAST_READINGS: Final = 50
_LARGEST_SHARE: Final = 1 / 500  # of repetitions among the readings of a sensor that is judged


class RepetitionMonitor(Detector):
    """Counts the bit-identical readings of one sensor in succession.

    The noise of a sensor that works changes every reading. Its samples are not used while it
    repeats itself; the first other reading ends the alarm. Samples under an old time stamp do not
    count. The statistic of a sensor that repeats readings in good health is 0.
    """

    def __init__(self, what: str, sensor: Sensor) -> None:
        super().__init__(f"readings of the {what}", REPETITIONS)
        self._what, self._sensor = what, sensor
        self._last: tuple[float, tuple[float, ...]] = (-math.inf, ())  # time [s], value
        self._run = 0  # repetitions since the last new value
        self._readings = self._repetitions = 0  # in good health

    def _count(self) -> float:
        judged = (
            self._readings >= _LEAST_READINGS
            and self._repetitions <= _LARGEST_SHARE * self._readings
        )
        return float(self._run) if judged else 0.0

    def observe(self, observation: Observation) -> None:
        for sample in observation.of(self._sensor):
            if sample.time_s <= self._last[0]:
                continue
            if sample.value == self._last[1]:
                self._run += 1
            else:
                if self._run and self._count() <= self.limit:
                    self._repetitions += self._run
                    self._readings += self._run
                self._readings += 1
                self._run = 0
            self._last = sample.time_s, sample.value
        self.statistic = self.residual = self._count()

    def alarm(self) -> Alarm:
        reason = f"{self._what} repeats one reading: not used"
        return Alarm(self.name, reason, Reaction.GO_ON, unused=frozenset({self._sensor}))


_LEAST_S: Final = 0.6  # between the first and the last position of a span
_FASTEST_MPS: Final = 5.0  # of a vehicle; assumed
_LARGEST_ERROR_M: Final = 0.5  # of a position that is no outlier; assumed
_RECEIVERS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
# Of second differences of positions, from which their noise is estimated.
_LEAST_DIFFERENCES: Final = 20
_MOST_DIFFERENCES: Final = 200  # 20 s of both axes at 5 Hz
_MEDIAN_TO_SD: Final = 1.4826 / math.sqrt(6.0)  # x(k+1) - 2 x(k) + x(k-1) of white noise
_HISTORY_S: Final = 3.0  # age of the oldest position that speeds are compared with
_SIGMAS: Final = 3.0
_STANDS: Final = 0.5  # share of the encoder's speed below which a vehicle makes no way


class GroundSpeed(NamedTuple):
    """Speed over ground over a span of time."""

    mps: float
    begin_s: float
    end_s: float
    sd_mps: float  # by the scatter of the positions of the last 20 s; 0 before there are enough


class SpeedOverGround:
    """Slope of the positions of a second over time, by Theil and Sen (Sen 1968, JASA 63).

    Each axis has the median of the slopes between all pairs of positions, which a single outlier
    does not move. A position farther from the last one than a vehicle goes is left out, for a
    second at most. The result is the mean of the receivers that have sent enough positions, without
    a sign; positions of a time before the last one are left out.
    """

    def __init__(self) -> None:
        self._positions = {sensor: deque[tuple[float, float, float]]() for sensor in _RECEIVERS}
        self._differences = deque[float]()  # second ones, unsigned [m]
        self._ordered: list[float] = []  # the same by size
        self._seen: Sequence[Measurement] | None = None  # samples of the last call
        self._last: GroundSpeed | None = None  # its result

    def speed(self, samples: Sequence[Measurement]) -> GroundSpeed | None:
        """Take in samples; return the speed of the span that ends with the newest.

        None where no receiver has sent positions over 0.6 s, or none of them is new. Several
        monitors may ask with the same samples.
        """
        if samples is not self._seen:
            self._seen, self._last = samples, self._speed(samples)
        return self._last

    def _speed(self, samples: Sequence[Measurement]) -> GroundSpeed | None:
        new = False
        for sample in samples:
            kept = self._positions.get(sample.sensor)
            if kept is None or not all(map(math.isfinite, sample.value)):
                continue
            while kept and kept[0][0] < sample.time_s - _SPAN_S - 1e-6:
                kept.popleft()
            if not kept or _is_plausible(kept[-1], sample):
                new = True
                kept.append((sample.time_s, sample.value[0], sample.value[1]))
                if len(kept) > 2:
                    (_, x0, y0), (_, x1, y1), (_, x2, y2) = kept[-3], kept[-2], kept[-1]
                    self._add_difference(abs(x2 - 2.0 * x1 + x0))
                    self._add_difference(abs(y2 - 2.0 * y1 + y0))
        newest = max((kept[-1][0] for kept in self._positions.values() if kept), default=0.0)
        spans = [
            kept
            for kept in self._positions.values()
            if kept and kept[-1][0] - kept[0][0] >= _LEAST_S and kept[-1][0] > newest - _LEAST_S
        ]
        if not new or not spans:
            return None
        speeds = [math.hypot(*median_slopes(np.array(kept))) for kept in spans]
        begin_s, end_s = min(kept[0][0] for kept in spans), max(kept[-1][0] for kept in spans)
        return GroundSpeed(sum(speeds) / len(speeds), begin_s, end_s, self._sd_mps(spans))

    def _add_difference(self, difference: float) -> None:
        self._differences.append(difference)
        insort(self._ordered, difference)
        if len(self._ordered) > _MOST_DIFFERENCES:
            del self._ordered[bisect_left(self._ordered, self._differences.popleft())]

    def _sd_mps(self, spans: Sequence[Sequence[tuple[float, float, float]]]) -> float:
        """Return the standard deviation of a speed by least squares, for white noise [m/s]."""
        count = len(self._ordered)
        if count < _LEAST_DIFFERENCES:
            return 0.0
        middle = self._ordered[(count - 1) // 2] + self._ordered[count // 2]
        inverse = 0.0  # of the squares of the times about their mean
        for kept in spans:
            times = [time_s for time_s, _, _ in kept]
            mean = sum(times) / len(times)
            inverse += 1.0 / sum([(time_s - mean) ** 2 for time_s in times])
        return _MEDIAN_TO_SD * 0.5 * middle * math.sqrt(inverse) / len(spans)


def _is_plausible(last: tuple[float, float, float], sample: Measurement) -> bool:
    span_s = sample.time_s - last[0]
    way = math.hypot(sample.value[0] - last[1], sample.value[1] - last[2])
    return span_s > 0.0 and way <= _FASTEST_MPS * span_s + _LARGEST_ERROR_M


@cached_njit()
def median_slopes(positions: FloatArray) -> tuple[float, float]:
    """Return the medians of the slopes of x and y between all pairs of rows t, x, y (n, 3)."""
    count = len(positions)
    slopes = np.empty((2, count * (count - 1) // 2))
    pair = 0
    for later in range(count):
        for earlier in range(later):
            span_s = positions[later, 0] - positions[earlier, 0]
            for axis in range(2):
                way = positions[later, 1 + axis] - positions[earlier, 1 + axis]
                slopes[axis, pair] = way / span_s
            pair += 1
    slopes[0].sort()
    slopes[1].sort()
    lower, upper = (pair - 1) // 2, pair // 2
    if lower == upper:
        return slopes[0, lower], slopes[1, lower]
    return (
        (slopes[0, lower] + slopes[0, upper]) / 2.0,
        (slopes[1, lower] + slopes[1, upper]) / 2.0,
    )


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
        while self._plan[0][0] < now - _HISTORY_S - _SPAN_S:
            self._plan.popleft()
        return self._plan


class _SpeedMonitor(Detector):
    """Cumulative sum of the difference of a speed from that over ground, both means of a second.

    The allowance holds for three standard deviations of the speed over ground, as with a noise of
    the positions of 10 cm. With more noise the residual is that much smaller and gives no alarm.
    """

    def __init__(
        self,
        name: str,
        allowance: float,
        limit: float,
        ground: SpeedOverGround,
        plan: PlannedSpeed,
    ) -> None:
        super().__init__(name, limit)
        self._allowance, self._cusum = allowance, Cusum(allowance, limit)
        self._ground, self._plan = ground, plan
        self._speeds = 0.0, 0.0  # compared at last: the speed in question, over ground [m/s]

    def warm_up(self) -> None:
        median_slopes(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))

    def _compare(self, history: Iterable[tuple[float, float]], ground: GroundSpeed) -> None:
        """Add the difference of the mean of a `history` of times and speeds over the span."""
        mean = _mean(history, ground)
        if not math.isnan(mean):
            self._speeds = mean, ground.mps
            residual = self._speeds[0] - ground.mps
            explained = max(0.0, _SIGMAS * ground.sd_mps - self._allowance)
            self._cusum.add(math.copysign(max(0.0, abs(residual) - explained), residual))
            self.statistic, self.residual = self._cusum.largest, self._cusum.residual


class WheelMonitor(_SpeedMonitor):
    """Compares the speed of the driven wheels with that over ground.

    Above: the wheels spin, or the encoder reads too much. Below: it reads too little, or backward.
    The encoder is the one that is wrong where the speed over ground is nearer to the planned one.
    """

    def __init__(self, ground: SpeedOverGround, plan: PlannedSpeed) -> None:
        super().__init__("wheels", WHEELS_ALLOWANCE, WHEELS, ground, plan)
        self._encoder: deque[tuple[float, float]] = deque()
        self._planned = math.nan  # over the span of the last comparison [m/s]

    def observe(self, observation: Observation) -> None:
        planned = self._plan.history(observation)
        sign = -1.0 if observation.vehicle.reverse else 1.0
        for sample in observation.of(Sensor.ENCODER):
            if math.isfinite(sample.value[0]):
                self._encoder.append((sample.time_s, sign * sample.value[0]))
        while self._encoder and self._encoder[0][0] < observation.time_s - _HISTORY_S:
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
    """Compares the speed that the hydrostat's commands ask for with that over ground."""

    def __init__(self, ground: SpeedOverGround, plan: PlannedSpeed) -> None:
        super().__init__("motion", MOTION_ALLOWANCE, MOTION, ground, plan)

    def observe(self, observation: Observation) -> None:
        planned = self._plan.history(observation)
        ground = self._ground.speed(observation.samples)
        if ground is not None:
            self._compare(planned, ground)

    def alarm(self) -> Alarm:
        """Return the alarm: a vehicle that does not move as commanded stops."""
        planned, speed = self._speeds
        reason = f"planned speed {planned:.2f} m/s, GNSS moves at {speed:.2f} m/s"
        return Alarm(self.name, reason, Reaction.STOP_ON_PATH)


def _mean(history: Iterable[tuple[float, float]], ground: GroundSpeed) -> float:
    """Return the mean of the speeds of a `history` of times and speeds in a span, NaN if none."""
    values = [value for time_s, value in history if ground.begin_s <= time_s <= ground.end_s]
    return sum(values) / len(values) if values else math.nan


# Dead time beyond that of the model, not learnt yet: three periods of the paper; assumed.
_UNKNOWN_S: Final = 0.6
_INTERVAL_S: Final = 0.1  # of dead times that share a residual
_REFUTED_S: Final = 60.0  # for which an interval is out once its sum has passed the limit; assumed
_STANDING_TICKS: Final = 3  # in which a valve that stands has not moved; assumed
_STEP_S: Final = 0.02  # of the model's integration: an eighth of the paper's shortest lag
_KEPT_S: Final = 1.0  # of the response, for samples that come late
_SCATTER: Final = 25  # samples of which the noise is estimated: a second of the paper's sensors
_QUIET: Final = math.radians(1.0) / math.sqrt(5.0)  # sd of a mean of five of the paper's samples
# The root mean square of the residuals, that of play and overlap of a valve, is one over a time; at
# the start, and at most; all assumed.
_PLAY_S: Final = 20.0
_PLAY_AT_START: Final = math.radians(0.75)
_MOST_PLAY: Final = math.radians(1.0)
_STEERING_SENSORS: Final = {
    Input.DELTA_T: Sensor.STEERING_TRACTOR,
    Input.DELTA_I: Sensor.STEERING_TRAILER,
}
_NAMES: Final = {Input.DELTA_T: "front steering", Input.DELTA_I: "trailer steering"}


@dataclass(slots=True)
class _Interval:
    """Dead times that share a residual."""

    sum: Cusum = field(default_factory=lambda: Cusum(STEERING_ALLOWANCE, STEERING_STOP))
    refuted_s: float = -math.inf  # time at which its sum was above the limit
    refuted: bool = False


class SteeringResponse:
    """Compares one measured steering angle with the response of the model to the commands.

    The model has the rate limit and the lag learnt so far. The dead time may not be learnt yet, or
    wrongly: each interval of possible ones has a residual of its own, the distance of the mean
    sample of a tick from what the response has covered in it, and a `Cusum` that sums it up. A
    healthy valve agrees with one of the intervals for good, a stuck valve with none. One that the
    valve contradicts while it follows another is refuted for a minute, or until the valve moves as
    it says and as no other. The allowance grows with the noise of that mean, where it is above that
    of the paper's sensor, and is at least twice the root mean square of the residuals of a valve
    with play.
    """

    def __init__(self, axis: Input) -> None:
        self._front = axis is Input.DELTA_T
        self._sensor = _STEERING_SENSORS[axis]
        self._seen_s = -math.inf  # time of the last observation
        self._intervals = [_Interval()]
        # The least of the sums of all intervals; that of the intervals that are not refuted, of all
        # if there are none: the last one is gone where a shorter dead time was learnt.
        self.least = self.least_possible = self._intervals[0].sum
        self._means = deque[float](maxlen=_STANDING_TICKS)  # of the samples of the last ticks [rad]
        self._times: list[float] = []  # of the response [s]
        self._angles: list[float] = []  # the response at these times [rad]
        self._valve = self._angle = math.nan
        self._sample = math.nan  # the last one [rad]
        self._changes = deque[float](maxlen=_SCATTER - 1)  # squares, between recent samples
        self._mean_square = _PLAY_AT_START**2  # of the residual
        self._compared_s = math.nan  # time of the last comparison, or of the first sample
        self._scale = 1.0  # of noise and play, by which residuals are divided

    @property
    def stands(self) -> bool:
        """Whether the measured angle has not moved in the last ticks."""
        means = self._means
        return (
            len(means) == _STANDING_TICKS
            and max(means) - min(means) < STEERING_ALLOWANCE * self._scale
        )

    def observe(self, observation: Observation) -> None:
        """Advance the model by the last command and compare it with the samples, once a tick."""
        if observation.time_s <= self._seen_s:
            return
        self._seen_s = observation.time_s
        if observation.command is not None:
            self._advance(observation.time_s, observation.command, observation.vehicle)
        of_sensor = observation.of(self._sensor)
        samples = [sample for sample in of_sensor if math.isfinite(sample.value[0])]
        if not samples:
            return
        values = [sample.value[0] for sample in samples]
        mean = sum(values) / len(values)
        if math.isnan(self._angle):
            self._valve = self._angle = mean
            self._times.append(observation.time_s)
            self._angles.append(mean)
            self._compared_s = observation.time_s
            return
        self._means.append(mean)
        for value in values:
            change = value - self._sample
            if not math.isnan(change):
                self._changes.append(change * change)
            self._sample = value
        sampled = [sample.time_s for sample in samples]
        longest = self._dead_time(observation.vehicle) + _UNKNOWN_S
        count = math.ceil(longest / _INTERVAL_S - 1e-9)
        delays = [n * _INTERVAL_S for n in range(count + 1)]
        means = [self._response(min(sampled) - s, max(sampled) - s) for s in delays]
        if math.isnan(sum(means)):
            return
        while len(self._intervals) < count:
            self._intervals.append(_Interval())
        del self._intervals[count:]
        play = 2.0 * math.sqrt(self._mean_square) / STEERING_ALLOWANCE
        self._scale = max(1.0, play, self._noise(len(values)) / _QUIET)
        for interval, (one, other) in zip(self._intervals, pairwise(means), strict=True):
            residual = mean - min(max(mean, min(one, other)), max(one, other))
            interval.sum.add(residual / self._scale)
        self._refute(observation.time_s)
        elapsed = observation.time_s - self._compared_s
        square = min(self._scale * abs(self.least_possible.residual), _MOST_PLAY) ** 2
        self._mean_square += min(1.0, elapsed / _PLAY_S) * (square - self._mean_square)
        self._compared_s = observation.time_s

    def _refute(self, time_s: float) -> None:
        self.least, self.least_possible = _least(self._intervals), self._possible()
        follows = self.least_possible.largest <= STEERING
        mistaken = not follows and self.least.largest <= STEERING and not self.stands
        for item in self._intervals:
            if follows and item.sum.largest > STEERING:
                item.refuted_s = time_s
            if mistaken:
                item.refuted_s = -math.inf
            item.refuted = time_s - item.refuted_s < _REFUTED_S
        self.least_possible = self._possible()

    def _possible(self) -> Cusum:
        return _least([item for item in self._intervals if not item.refuted] or self._intervals)

    def _response(self, begin_s: float, end_s: float) -> float:
        """Return the mean response of a time, NaN where it is not kept or lies in the future."""
        begin, end = bisect_left(self._times, begin_s - _STEP_S), bisect_right(self._times, end_s)
        if begin_s < self._times[0] or end <= begin:
            return math.nan
        return sum(self._angles[begin:end]) / (end - begin)

    def _noise(self, count: int) -> float:
        """Return the sd of the mean of `count` samples, from the differences of recent ones."""
        return math.sqrt(sum(self._changes) / (2.0 * max(1, len(self._changes)) * count))

    def _dead_time(self, vehicle: Vehicle) -> float:
        return vehicle.dead_time_t if self._front else vehicle.dead_time_i

    def _advance(self, time_s: float, command: Command, vehicle: Vehicle) -> None:
        """Continue the response without a dead time to `time_s` under the last `command`."""
        if not self._times:
            return
        now, valve, angle = self._times[-1], self._valve, self._angle
        target = command.delta_t if self._front else command.delta_i
        lag = vehicle.steering_lag_t if self._front else vehicle.steering_lag_i
        rate = vehicle.steering_rate_t if self._front else vehicle.steering_rate_i
        steps = max(1, math.ceil((time_s - now) / _STEP_S - 1e-9))
        step = (time_s - now) / steps
        share, reach = 1.0 - math.exp(-step / lag), rate * step
        for n in range(steps):
            valve = min(max(target, valve - reach), valve + reach)
            angle += share * (valve - angle)
            self._times.append(now + (n + 1) * step)
            self._angles.append(angle)
        self._valve, self._angle = valve, angle
        dropped = bisect_left(self._times, time_s - self._dead_time(vehicle) - _UNKNOWN_S - _KEPT_S)
        del self._times[:dropped], self._angles[:dropped]


def _least(intervals: Sequence[_Interval]) -> Cusum:
    sums = [item.sum for item in intervals]
    return min(sums, key=lambda item: (item.largest, abs(item.residual)))


class SteeringMonitor(Detector):
    """Notices a valve that does not follow its command, whatever its dead time.

    The statistic is the least of the sums of residuals [rad].
    """

    def __init__(self, axis: Input, response: SteeringResponse) -> None:
        super().__init__(_NAMES[axis], STEERING_STOP)
        self._what, self._response = _NAMES[axis], response

    def observe(self, observation: Observation) -> None:
        self._response.observe(observation)
        least = self._response.least
        self.statistic, self.residual = least.largest, least.residual

    def alarm(self) -> Alarm:
        return Alarm(self.name, f"{self._what} does not follow its command", Reaction.STOP)


class StandstillMonitor(SteeringMonitor):
    """Notices steering that stands still while its command asks for motion, as with a stuck valve.

    Only dead times that the valve has not contradicted so far count, so that it is earlier than
    `SteeringMonitor`: the statistic is the least of their sums [rad], 0 while the angle moves.
    Commands that are late or lost for a moment show as well.
    """

    def __init__(self, axis: Input, response: SteeringResponse) -> None:
        super().__init__(axis, response)
        self.name, self.limit = f"{self._what} at standstill", STEERING

    def observe(self, observation: Observation) -> None:
        self._response.observe(observation)
        least = self._response.least_possible
        self.statistic = least.largest if self._response.stands else 0.0
        self.residual = least.residual

    def alarm(self) -> Alarm:
        """Return the alarm: the vehicle slows down until it is known whether the valve is stuck."""
        return Alarm(self.name, f"{self._what} stands still against its command", Reaction.SLOW)


_SENSORS: Final = {
    Sensor.GNSS_TRACTOR: "GNSS of the tractor",
    Sensor.GNSS_TRAILER: "GNSS of the trailer",
    Sensor.STEERING_TRACTOR: "front steering angle",
    Sensor.STEERING_TRAILER: "trailer steering angle",
    Sensor.HITCH: "hitch angle",
    Sensor.ENCODER: "encoder",
}


def detectors() -> tuple[Detector, ...]:
    """Return new detectors, each before its first tick.

    The steering angles have monitors of their own, since a dead time that was not learnt yet makes
    their innovations large. Innovations of the others grow with a fault of the sensor, and as much
    with wrong lengths or an assumed noise that is too small: the vehicle goes on, and learns.
    """
    ground, plan = SpeedOverGround(), PlannedSpeed()
    responses = [(axis, SteeringResponse(axis)) for axis in (Input.DELTA_T, Input.DELTA_I)]
    return (
        *(RepetitionMonitor(what, sensor) for sensor, what in _SENSORS.items()),
        *(SteeringMonitor(axis, response) for axis, response in responses),
        *(StandstillMonitor(axis, response) for axis, response in responses),
        MotionMonitor(ground, plan),
        WheelMonitor(ground, plan),  # may rule out the encoder, which those above do not use
        *(InnovationMonitor(_SENSORS[sensor], sensor) for sensor in INNOVATION),
    )
