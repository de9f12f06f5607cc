"""Detectors of faults: what they observe, when they give an alarm, what follows from it.

The built-in ones are compiled, `observe_monitors`, and remember all in a flat record. Objects with
names and words are views of it.

The limits of repetitions, steering, motion, wheels and innovations give at most one false alarm in
ten hours together on every shipped scenario, from tuning seeds; those of noise, hitch and position
are set by hand above what fault-free drives reached, those of drift as a trade of stops for a check
against the way until a drift is found. How often they are wrong is in the table
of false alarms of docs/appendix/faults.md. An allowance is half of the shift of a residual that is
to be detected (Montgomery, Introduction to Statistical Quality Control, ch. 9): a steering angle
2.5 deg off its command, a speed 0.6 m/s, of motion 0.7 m/s off; assumed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from ..jit import cached_njit, record
from ..layout import ALARM, ESTIMATE, FLOAT, INNOVATION, SAMPLE, measurements_of
from ..models.augmented_state import SensorIndex, VehicleParameter, vehicle_parameters
from ..types import Command, Estimate, FloatArray, Measurement, Sensor, WarmingUp
from ..vehicle import MAX_DEAD_TIME_S, Vehicle


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

    def of(self, sensor: Sensor) -> Sequence[Measurement]:
        """Return the samples of one sensor in the order of arrival."""
        return [sample for sample in self.samples if sample.sensor == sensor]


@dataclass(frozen=True, slots=True)
class Alarm:
    """A detector's statement that something is wrong."""

    detector: str  # its name
    reason: str  # for log and driver
    reaction: Reaction
    unused: frozenset[Sensor] = frozenset()  # sensors whose samples are not to be used


@dataclass
class Detector:
    """A statistic that grows with a fault, and the limit at which it is one."""

    name: str
    limit: float
    statistic: float = 0.0  # present value, 0 or above
    residual: float = math.nan  # latest value of what the statistic is made from

    def observe(self, observation: Observation) -> None:
        """Take in the data of a tick; they are not changed."""
        raise NotImplementedError

    def alarm(self) -> Alarm:
        """Return the alarm for the present statistic."""
        raise NotImplementedError


class DetectorIndex(IntEnum):
    """Number of the first of each kind of built-in detectors."""

    REPETITIONS = 0  # by `SensorIndex`, but those of IMUs
    STEERING = 6  # front, trailer
    STANDSTILL = 8  # front, trailer
    MOTION = 10
    WHEELS = 11
    INNOVATIONS = 12  # of GNSS tractor, GNSS trailer, hitch, encoder
    HITCH = 16  # against the motion of both bodies
    POSITION = 17  # against dead reckoning
    DRIFT = 18  # of both receivers
    PROTECTION = 19  # level: of the position, while a sensor is not used


_COUNT: Final = 20  # detectors
_GO_ON, _SLOW, _STOP_ON_PATH = map(float, (Reaction.GO_ON, Reaction.SLOW, Reaction.STOP_ON_PATH))
_ENDS: Final = 0.5  # share of its limit below which a statistic ends an alarm
_SATURATION: Final = 1.5  # limits at which a sum saturates: an alarm ends soon after its cause

_REPETITIONS: Final = 2.5  # bit-identical readings in succession; assumed
# A sensor of coarse resolution repeats readings in good health; it is not judged. Assumed.
_LEAST_READINGS: Final = 50
_LARGEST_SHARE: Final = 1 / 500  # of repetitions among the readings of a sensor that is judged

# A reading without noise: its second difference is below a share of the usual one. Ones with noise
# count back; the limit is a multiple of the largest sum so far. Assumed.
_QUIET_SHARE: Final = 1.0 / 16.0  # of the mean square
_COUNTS_BACK: Final = 4.0
_TIMES: Final = 4.0
_LEAST_STEPS: Final = 2.0  # second differences over the resolution where noise makes the readings
_LEAST_RUN: Final = 10.0
_LEARNT: Final = 250.0  # readings before the first judgement
_MOST_LEARNT: Final = 2000.0

_SETTLED_S: Final = 8.0  # from the start on, in which the filter settles
_HITCH_MEAN: Final = 7.0  # mean of the hitch's whitened innovations in a second, standard normal
_HITCH_CURVE: Final = math.radians(0.25)  # of a sensor in order beside its offset; assumed
_HITCH_SLIP: Final = 0.032  # [rad] side slip of tractor less that of the trailer, without slopes
# From dead reckoning: on ground without bumps, and at a learnt factor of roughness of 1
_POSITION_M: Final = 0.25, 0.12
_POSITION_S: Final = 10.0  # memory of dead reckoning
_UNSTATED: Final = 3.0  # times the limit of an estimator that states no side slip; assumed
# Of the drift: apparent drift over the speed, and change of the wheel slip beside that on slopes;
# mean of the former, short and usual mean of the latter.
_DRIFT: Final = 0.010, 0.08
_DRIFT_S: Final = 3.0, 1.5, 30.0
_PATTERN: Final = 0.65, 0.35  # shares of side slip, and of wheel slip, which a rut leaves alone
_ROUGHER: Final = 0.05  # by which its limit grows with the learnt factor of roughness
_SLOPE: Final = 2.0  # and with wheel slip beyond that of a drift
_JUDGED_S: Final = 20.0  # from the start on
_PASSED: Final = 2.0, 8.0, 900.0  # by which a check raises both, at most; fades in s; assumed
_STOOD_S: Final = 1.6, 4.0, 20.0  # to come to rest, least and longest check; assumed
_STOOD_MPS: Final = 0.012  # of GNSS at rest, and deviations of the white noise within it; assumed
_STOOD_SIGMAS: Final = 5.0
_FAILED: Final = 2.0  # checks in succession that confirm a drift: a vehicle may creep in one
_ROUGH_S: Final = 30.0  # mean of the learnt roughness
_MOVING: Final = 0.1  # [m/s]
_RESTS: Final = 0.05  # likewise
_SPUN_S: Final = 20.0  # that a vehicle takes to stand; assumed
_LEVEL: Final = 1.2, math.sqrt(2.0 * math.log(1e5))  # [m]; deviations at a risk of 1e-5 a tick
_SURE_M: Final = 0.2  # four standard deviations of a position that is known

_INNOVATION: Final = (7.8, 7.8, 8.3, 5.0)  # GNSS, GNSS, hitch, encoder; standard normal equivalents
_SPAN_S: Final = 1.0  # of positions, and of the innovations that are summed up
# Largest contribution of a sample: a single outlier, which the gate rejects, gives no alarm.
_MOST_SQUARE: Final = 25.0

_MOTION: Final = 0.75, 0.35  # limit, allowance [m/s]
_WHEELS: Final = 1.10, 0.30
_LEAST_S: Final = 0.6  # between the first and the last position of a span
_FASTEST_MPS: Final = 5.0  # of a vehicle; assumed
_LARGEST_ERROR_M: Final = 0.5  # of a position that is no outlier; assumed
# Of second differences of positions, from which their noise is estimated.
_LEAST_DIFFERENCES: Final = 20
_DIFFERENCES: Final = 200  # 20 s of both axes at 5 Hz
_MEDIAN_TO_SD: Final = 1.4826 / math.sqrt(6.0)  # x(k+1) - 2 x(k) + x(k-1) of white noise
_HISTORY_S: Final = 3.0  # age of the oldest position that speeds are compared with
_SIGMAS: Final = 3.0
_STANDS: Final = 0.5  # share of the encoder's speed below which a vehicle makes no way

_ALLOWANCE: Final = math.radians(1.25)  # of steering
_STEERING: Final = 0.060  # [rad] of any valve
_STANDSTILL: Final = 0.035  # [rad] of one that stands still
_COLD: Final = 0.6  # least share of the flow that a valve has, as with cold oil; assumed
# Dead time beyond that of the model, not learnt yet: three periods of the paper; assumed.
_UNKNOWN_S: Final = 0.6
_INTERVAL_S: Final = 0.1  # of dead times that share a residual
_INTERVALS: Final = math.ceil((MAX_DEAD_TIME_S + _UNKNOWN_S) / _INTERVAL_S - 1e-9)
_REFUTED_S: Final = 60.0  # for which an interval is out once its sum has passed the limit; assumed
_TICKS: Final = 3  # in which a valve that stands has not moved; assumed
_STEP_S: Final = 0.02  # of the model's integration: an eighth of the paper's shortest lag
_KEPT_S: Final = 1.0  # of the response, for samples that come late
_MOST_STEPS: Final = 500  # of them in a tick: a gap of more than 10 s has longer ones
_CHANGES: Final = 24  # of samples, of which the noise is estimated: a second of the paper's sensors
_QUIET: Final = math.radians(1.0) / math.sqrt(5.0)  # sd of a mean of five of the paper's samples
# The root mean square of the residuals, that of play and overlap of a valve, is one over a time; at
# the start, and at most; all assumed.
_PLAY_S: Final = 20.0
_PLAY_AT_START: Final = math.radians(0.75)
_MOST_PLAY: Final = math.radians(1.0)

# A history is an array (1 + entries, 3) of a time [s] and two numbers each, in the order of
# arrival; row 0 has their count. Room is for GNSS and control at 100 Hz and an encoder at 200 Hz;
# beyond them the oldest entries are lost, and the spans shorter.
MONITORS: Final = np.dtype(
    [
        ("limit", "f8", _COUNT),
        ("statistic", "f8", _COUNT),
        ("residual", "f8", _COUNT),  # latest value of what the statistic is made from, or NaN
        ("alarms", "f8", (_COUNT, ALARM)),  # that stand
        ("present", "f8", (_COUNT, ALARM)),  # the alarm that each would give
        ("unused", "f8", len(SensorIndex)),  # 1: an alarm rules the sensor out for the next tick
        # Latest reading: time, repetitions since the last new one, value; all readings in good
        # health, repetitions among them
        ("reading", "f8", (DetectorIndex.STEERING, 7)),
        # By angle: last value, the one before, mean square of the second differences, their number,
        # sum of those without noise, largest such sum in good health, largest since it was 0,
        # mean square of the differences, smallest one: the resolution
        ("noise", "f8", (3, 9)),
        ("quiet", "f8", 3),  # that sum over its limit
        ("positions", "f8", (2, 1 + 102, 3)),  # x, y [m] of a second, by receiver
        ("differences", "f8", _DIFFERENCES),  # unsigned, of second order [m]: a ring
        ("difference_count", "f8"),  # of all so far
        ("position_sd", "f8"),  # of their white noise [m]
        ("sent", "f8", (1, 1 + 202, 3)),  # end and hydrostat position of each command
        ("plan", "f8", (1, 1 + 402, 3)),  # speed [m/s] without a sign
        ("encoder", "f8", (1, 1 + 602, 3)),  # speed [m/s], forward in the gear
        ("speed_sums", "f8", (2, 2)),  # of motion and wheels: above, below
        # By axis, front and trailer:
        # [rad] of the model without a dead time, and with the least flow
        ("response", "f8", (2, 1 + 402, 3)),
        ("valve", "f8", 2),  # [rad], its state
        ("angle", "f8", 2),  # [rad]
        ("slow", "f8", (2, 2)),  # [rad] both with the least flow
        ("mean", "f8", (2, _TICKS)),  # of the samples of the last ticks [rad]
        ("moved", "f8", 2),  # range of these means
        ("sample", "f8", 2),  # the last one [rad]
        ("changes", "f8", (2, _CHANGES)),  # squares, between recent samples: a ring
        ("change_count", "f8", 2),  # of all so far
        ("scale", "f8", 2),  # of noise and play, by which residuals are divided
        ("mean_square", "f8", 2),  # of the residual
        ("compared_s", "f8", 2),  # time of the last comparison, or of the first sample
        # Sums above and below; residual; time at which a sum was above the limit; whether refuted
        ("intervals", "f8", (2, _INTERVALS, 5)),
        ("interval_count", "f8", 2),
        # Largest sum and residual of the least of all intervals; of those that are not refuted
        ("least", "f8", (2, 2, 2)),
        ("steered_s", "f8"),  # last tick of the steering monitors
        ("innovations", "f8", (4, 1 + 102, 3)),  # sum of squares and entries of each tick
        ("whitened", "f8", (1, 1 + 102, 3)),  # sum of the hitch's innovations, their number
        ("pose", "f8", 6),  # of the last estimate: time, x, y, yaw, speed, sd of the position
        ("offset", "f8", 2),  # of the position from dead reckoning [m]
        ("accepted", "f8", 2),  # apparent drift over the speed that a slope explains
        ("drift", "f8", (2, 2)),  # mean over its limit; of its change from the accepted one
        ("rough", "f8"),  # mean of the learnt factor of roughness
        ("slips", "f8", 2),  # wheel slip beside that on slopes: means, short and usual
        ("passed", "f8"),  # factor of the limits of a drift after checks
        ("rests_s", "f8"),  # since when the vehicle is at rest in a check, NaN: not yet
        # From there on: samples, sums of time, its square, x, x * time, y, y * time
        ("stood", "f8", 7),
        ("stood_at", "f8", (2, 2)),  # first position [m] of each receiver
        ("drifts", "f8"),  # times that GNSS moved while the vehicle stood
        ("spun_s", "f8"),  # last time at which the wheels may have spun
        ("workspace", "f8", 102 * 101 // 2),  # slopes of a second; means of the response
    ]
)
"""What the built-in detectors remember, a flat array of `MONITORS.itemsize // 8` entries."""


def new_monitors() -> FloatArray:
    """Return the record of the built-in detectors before their first tick, flat."""
    flat = np.zeros(MONITORS.itemsize // 8)
    s = flat.view(MONITORS)[0]
    s["limit"], s["present"][:, 0], s["alarms"][:, 0] = _LIMITS, _REACTIONS, -1.0
    s["reading"][:, 0] = s["steered_s"] = s["spun_s"] = -math.inf
    s["residual"][DetectorIndex.STEERING :] = s["least"][..., 1] = math.nan
    s["valve"] = s["angle"] = s["sample"] = s["reading"][:, 2:5] = math.nan
    s["pose"] = s["noise"][:, :2] = s["slips"] = s["rests_s"] = math.nan
    s["rough"] = s["passed"] = 1.0
    s["noise"][:, 8] = s["position_sd"] = math.inf
    s["mean"] = s["moved"] = math.inf  # of a valve that has not stood yet
    s["scale"], s["mean_square"] = 1.0, _PLAY_AT_START**2
    return flat


# Nothing is allocated in these kernels: without counting references they compile faster.
_compiled: Final = cached_njit(nogil=True, error_model="numpy", _nrt=False, no_rewrites=True)


@_compiled
def _remember(
    history: FloatArray, oldest_s: float, time_s: float, first: float, second: float
) -> int:
    """Drop the entries before the first one from `oldest_s` on; add one unless its time is NaN.

    Returns the number of entries.
    """
    count, dropped, adds = int(history[0, 0]), 0, time_s == time_s
    while dropped < count and history[1 + dropped, 0] < oldest_s:
        dropped += 1
    if adds and not dropped and count == len(history) - 1:
        dropped = 1
    if dropped:
        count -= dropped
        for n in range(1, count + 1):
            for column in range(3):
                history[n, column] = history[n + dropped, column]
    if adds:
        count += 1
        history[count, 0], history[count, 1], history[count, 2] = time_s, first, second
    history[0, 0] = count
    return count


@_compiled
def _mean(history: FloatArray, begin_s: float, end_s: float) -> float:
    """Return the mean of the first numbers of a history in a span, NaN if there are none."""
    total, count = 0.0, 0
    for n in range(1, 1 + int(history[0, 0])):
        if begin_s <= history[n, 0] <= end_s:
            total += history[n, 1]
            count += 1
    return total / count if count else math.nan


@_compiled
def _median(values: FloatArray, count: int) -> float:
    """Return the median of `count` values, whose order changes: selection after Hoare (1961)."""
    low, high, middle = 0, count - 1, count // 2
    while low < high:
        pivot, left, right = values[(low + high) // 2], low, high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while values[right] > pivot:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left, right = left + 1, right - 1
        low = left if right < middle else low
        high = right if middle < left else high
    if count % 2:
        return values[middle]
    below = values[0]
    for n in range(1, middle):
        below = max(below, values[n])
    return (below + values[middle]) / 2.0


@_compiled
def _quiet(noise: FloatArray, value: float) -> float:
    """Return the sum of readings without noise over its limit, after another one."""
    bend, step = (value - 2.0 * noise[0] + noise[1]) ** 2, abs(value - noise[0])
    noise[1], noise[0] = noise[0], value
    if not math.isfinite(bend):
        return 0.0
    most = max(_LEAST_RUN, _TIMES * noise[5])
    judged = noise[3] >= _LEARNT
    change = 1.0 if bend <= _QUIET_SHARE * noise[2] else -_COUNTS_BACK
    noise[4] = min(max(0.0, noise[4] + change), _SATURATION * most)
    if not judged or noise[4] <= _LEAST_RUN:
        noise[3] = min(noise[3] + 1.0, _MOST_LEARNT)
        noise[2] += (bend - noise[2]) / noise[3]
        noise[7] += (step * step - noise[7]) / noise[3]
    if step > 0.0:
        noise[8] = min(noise[8], step)
    noise[6] = max(noise[6], noise[4])
    if noise[4] == 0.0:
        if not judged or noise[6] <= most:
            noise[5] = max(noise[5], noise[6])
        noise[6] = 0.0
    judged = judged and noise[2] >= noise[7] and noise[2] >= (_LEAST_STEPS * noise[8]) ** 2
    return noise[4] / most if judged else 0.0


@_compiled
def _observe_estimate(
    monitors: FloatArray,
    now: float,
    estimate: FloatArray,
    innovations: FloatArray,
) -> None:
    """Compare the estimate with what a vehicle can do: hitch angle, position."""
    s, e = record(monitors, MONITORS), record(estimate, ESTIMATE)
    statistic, residuals, alarms, x = s.statistic, s.residual, s.alarms, e.state
    # Where a receiver or a steering angle contradicts the estimate, the hitch need not be wrong.
    total, entries, known, curve = 0.0, 0.0, True, 0.0
    for index in range(DetectorIndex.STEERING, DetectorIndex.MOTION):
        known = known and alarms[index, 0] < 0.0
    for index in range(DetectorIndex.INNOVATIONS, DetectorIndex.INNOVATIONS + 2):
        known = known and alarms[index, 0] < 0.0
    for row in range(len(innovations)):
        sensor = int(innovations[row, 0])
        if sensor == SensorIndex.HITCH and math.isfinite(innovations[row, 4]):
            total += innovations[row, 4]
            entries += 1.0
            curve = _HITCH_CURVE * math.exp(-0.5 * innovations[row, 6])
        elif SensorIndex.STEERING_TRACTOR <= sensor < SensorIndex.HITCH:
            known = known and (innovations[row, 2] == 0.0 or innovations[row, 3] > 0.0)
    kept = s.whitened[0]
    if not known:
        kept[0, 0], entries = 0.0, 0.0
    count = _remember(kept, now - _SPAN_S + 1e-6, now if entries else math.nan, total, entries)
    total, entries = 0.0, 0.0
    for row in range(1, 1 + count):
        total += kept[row, 1]
        entries += kept[row, 2]
    statistic[DetectorIndex.HITCH] = 0.0
    gear, slip = math.copysign(1.0, x[6]), e.disturbance[0] - e.disturbance[1]
    gx, gy = gear * e.map_disturbance[0], gear * e.map_disturbance[1]
    slip -= gy * (math.cos(x[2]) - math.cos(x[3])) - gx * (math.sin(x[2]) - math.sin(x[3]))
    if now >= _SETTLED_S and slip == slip:
        ratio = abs(slip) / (_HITCH_SLIP * (1.0 + (_SETTLED_S / now) ** 2))
        if entries:
            size = _HITCH_MEAN / math.sqrt(entries) + (curve if curve == curve else 0.0)
            ratio = max(ratio, abs(total) / entries / size)
        statistic[DetectorIndex.HITCH] = residuals[DetectorIndex.HITCH] = ratio
    if alarms[DetectorIndex.HITCH, 0] >= 0.0:  # for good
        statistic[DetectorIndex.HITCH] = max(1.0, statistic[DetectorIndex.HITCH])

    held, span_s, last = alarms[DetectorIndex.POSITION, 0] >= 0.0, now - s.pose[0], s.pose
    yaw, speed, slip = 0.5 * (x[2] + last[3]), 0.5 * (x[6] + last[4]), e.disturbance[0]
    way = speed * span_s
    dx = x[0] - last[1] - way * (math.cos(yaw) - slip * math.sin(yaw))
    dy = x[1] - last[2] - way * (math.sin(yaw) + slip * math.cos(yaw))
    spins = alarms[DetectorIndex.WHEELS, 0] > _GO_ON or alarms[DetectorIndex.MOTION, 0] >= 0.0
    if spins and np.sum(s.speed_sums[:, 0]) > np.sum(s.speed_sums[:, 1]):
        # Wheels that spin make less way, no more than all of it. GNSS that is faster jumps.
        s.spun_s = now
        back = -math.copysign(1.0, way) * (dx * math.cos(yaw) + dy * math.sin(yaw))
        back = math.copysign(min(max(0.0, back), abs(way)), way)
        dx, dy = dx + back * math.cos(yaw), dy + back * math.sin(yaw)
    if span_s > 0.0 and math.isfinite(dx + dy):
        if span_s <= 1.0:
            size = math.hypot(dx, dy)
            sure = max(0.0, size - max(0.0, 4.0 * last[5] - _SURE_M)) / max(size, 1e-9)
            share = 1.0 if held else sure
            fade = 1.0 if held else math.exp(-span_s / _POSITION_S)
            s.offset[0] = fade * s.offset[0] + share * dx
            s.offset[1] = fade * s.offset[1] + share * dy
        elif not held:
            s.offset[0] = s.offset[1] = 0.0
    if math.isfinite(x[0] + x[1] + x[2] + x[6]):
        last[0], last[1], last[2], last[3], last[4] = now, x[0], x[1], x[2], x[6]
        last[5] = math.sqrt(max(0.0, e.covariance[0, 0], e.covariance[1, 1]))
    # The factor follows a fault as it follows a rough field, so that its mean is taken.
    if e.noise_factors[0] >= 0.0 and 0.0 < span_s <= 1.0 and not held:
        s.rough += min(1.0, span_s / _ROUGH_S) * (e.noise_factors[0] - s.rough)
    rough, size = s.rough, math.hypot(s.offset[0], s.offset[1])
    residuals[DetectorIndex.POSITION] = s.present[DetectorIndex.POSITION, 1] = size
    bound = _POSITION_M[0] + _POSITION_M[1] * math.sqrt(rough)
    bound *= _UNSTATED if slip == 0.0 and e.disturbance[1] == 0.0 else 1.0
    ratio = (2.0 if held else 1.0) * size / bound  # what is left of a jump is not believed, either
    ratio = 0.0 if e.covariance[0, 0] + e.covariance[1, 1] == 0.0 else ratio  # of the truth
    statistic[DetectorIndex.POSITION] = ratio if now >= _SETTLED_S else 0.0
    # The position is Rayleigh distributed at most, along the worse axis of its covariance.
    xx, yy, excluded = e.covariance[0, 0], e.covariance[1, 1], held
    variance = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), e.covariance[0, 1])
    level = bound + (size if held else 0.0) + _LEVEL[1] * math.sqrt(max(0.0, variance))
    for index in range(DetectorIndex.STEERING):
        excluded |= alarms[index, 0] >= 0.0
    excluded |= alarms[DetectorIndex.HITCH, 0] >= 0.0
    excluded |= alarms[DetectorIndex.WHEELS, 0] == _GO_ON
    residuals[DetectorIndex.PROTECTION] = s.present[DetectorIndex.PROTECTION, 1] = level
    statistic[DetectorIndex.PROTECTION] = level if excluded and level == level else 0.0

    # A drift of w adds side and wheel slips of w and -w over the speed, fixed in the map.
    limit, checks = s.limit[DetectorIndex.DRIFT], alarms[DetectorIndex.DRIFT, 0] >= 0.0
    slips, most = s.slips, s.passed
    sx, sy, cx, cy = e.map_disturbance
    dx, dy = _PATTERN[0] * sx - _PATTERN[1] * cx, _PATTERN[0] * sy - _PATTERN[1] * cy
    if now < _JUDGED_S and math.isfinite(dx + dy):
        s.accepted[0], s.accepted[1] = dx, dy  # the slope of the start
    side = math.hypot(sx, sy)
    excess = max(0.0, -(sx * cx + sy * cy) / max(side, 1e-9) - side)
    size = _DRIFT[0] * max(1.0, 1.0 + _ROUGHER * (rough - 1.0)) + _SLOPE * excess
    wheel = e.disturbance[4] - gear * (cx * math.cos(x[2]) + cy * math.sin(x[2]))
    statistic[DetectorIndex.DRIFT] = limit if checks else 0.0  # until it has passed
    if 0.0 < span_s <= 1.0 and math.isfinite(size + wheel) and not checks:
        s.passed = most = 1.0 + (most - 1.0) * math.exp(-span_s / _PASSED[2])
        if abs(x[6]) > _MOVING and now >= _JUDGED_S:
            for n in range(2):  # on a flat field; from the accepted one
                share = min(1.0, span_s / _DRIFT_S[0])
                s.drift[n, 0] += share * ((dx - n * s.accepted[0]) / size - s.drift[n, 0])
                s.drift[n, 1] += share * ((dy - n * s.accepted[1]) / size - s.drift[n, 1])
                old = slips[n] if slips[n] == slips[n] else wheel
                slips[n] = old + min(1.0, span_s / _DRIFT_S[1 + n]) * (wheel - old)
        (east, north), (other_east, other_north) = s.drift
        ratio = min(math.hypot(east, north), math.hypot(other_east, other_north))
        if slips[0] == slips[0]:
            ratio = max(ratio, abs(slips[0] - slips[1]) / _DRIFT[1])
        statistic[DetectorIndex.DRIFT] = ratio / most
        if ratio > most * limit:
            s.present[DetectorIndex.DRIFT, 1] = 100.0 * abs(x[6]) * math.hypot(dx, dy)
    elif checks and s.drifts < _FAILED:
        if not abs(x[6]) <= _RESTS or math.isnan(s.rests_s):
            s.rests_s, s.stood[:], s.stood_at[:] = now, 0.0, math.nan
        # Both receivers have one velocity, by least squares.
        n, t, tt, px, ptx, py, pty = s.stood
        n, long_s = max(n, 1.0), now - s.rests_s - _STOOD_S[0]
        spread = max(tt - t * t / n, 1e-9)
        found = math.hypot(ptx - t * px / n, pty - t * py / n) / spread
        noise = _STOOD_SIGMAS * s.position_sd / math.sqrt(spread)
        if long_s >= (_STOOD_S[1] if noise <= _STOOD_MPS else _STOOD_S[2]):
            s.rests_s = math.nan
            s.drifts = s.drifts + 1.0 if found > max(_STOOD_MPS, noise) else 0.0
            alarms[DetectorIndex.DRIFT, 1] = 100.0 * found
            alarms[DetectorIndex.DRIFT, 2] = 1.0 if s.drifts >= _FAILED else 0.0
            if s.drifts == 0.0:
                statistic[DetectorIndex.DRIFT] = 0.0
                s.drift[:] = 0.0
                s.accepted[0], s.accepted[1] = dx, dy
                slips[0] = slips[1] = math.nan
                s.passed = min(_PASSED[0] * most, _PASSED[1])
    residuals[DetectorIndex.DRIFT] = statistic[DetectorIndex.DRIFT]


@_compiled
def _observe_speeds(
    parameters: FloatArray,
    monitors: FloatArray,
    rows: FloatArray,
    now: float,
    command: FloatArray,
) -> None:
    s = record(monitors, MONITORS)
    limit, statistic, residuals, unused = s.limit, s.statistic, s.residual, s.unused
    sent, differences, work, new = command[0] == command[0], s.differences, s.workspace, False

    for sensor in range(DetectorIndex.STEERING):
        kept = s.reading[sensor]
        judged = kept[5] >= _LEAST_READINGS and kept[6] <= _LARGEST_SHARE * kept[5]
        for row in range(len(rows)):
            if rows[row, 1] != sensor or not kept[0] < rows[row, 0] < math.inf:
                continue
            kept[0], same = rows[row, 0], True
            if SensorIndex.STEERING_TRACTOR <= sensor <= SensorIndex.HITCH:
                s.quiet[sensor - 2] = _quiet(s.noise[sensor - 2], rows[row, 2])
            for n in range(2, 5):
                same = same and kept[n] == rows[row, n]
                kept[n] = rows[row, n]
            if same:
                kept[1] += 1.0
                continue
            if not judged or kept[1] <= limit[sensor]:
                kept[5] += kept[1]
                kept[6] += kept[1]
            kept[5] += 1.0
            kept[1] = 0.0
            judged = kept[5] >= _LEAST_READINGS and kept[6] <= _LARGEST_SHARE * kept[5]
        repeated = kept[1] if judged else 0.0
        if SensorIndex.STEERING_TRACTOR <= sensor <= SensorIndex.HITCH:
            repeated = max(repeated, limit[sensor] * s.quiet[sensor - 2])
        statistic[sensor] = residuals[sensor] = repeated
        lasts = s.alarms[sensor, 0] >= 0.0 and repeated >= _ENDS * limit[sensor]
        unused[sensor] = 1.0 if lasts or repeated > limit[sensor] else 0.0

    for row in range(len(rows)):
        sensor, time_s, x, y = int(rows[row, 1]), rows[row, 0], rows[row, 2], rows[row, 3]
        if unused[sensor] > 0.0 or not math.isfinite(time_s + x + y):
            continue
        if sensor == SensorIndex.ENCODER:
            forward = -x if parameters[VehicleParameter.REVERSE] else x
            _remember(s.encoder[0], -math.inf, time_s, forward, 0.0)
        if sensor > SensorIndex.GNSS_TRAILER:
            continue
        kept = s.positions[sensor]
        if rows[row, 4] == FLOAT:  # nor are fixes before and after it of one solution
            kept[0, 0] = 0.0
            continue
        count = _remember(kept, time_s - _SPAN_S - 1e-6, math.nan, 0.0, 0.0)
        if count:
            span_s = time_s - kept[count, 0]
            way = math.hypot(x - kept[count, 1], y - kept[count, 2])
            if span_s <= 0.0 or way > _FASTEST_MPS * span_s + _LARGEST_ERROR_M:
                continue
        new = True
        if time_s >= s.rests_s + _STOOD_S[0]:
            past_s, origin = time_s - s.rests_s - _STOOD_S[0], s.stood_at[sensor]
            if origin[0] != origin[0]:
                origin[0], origin[1] = x, y
            dx, dy = x - origin[0], y - origin[1]
            terms = (1.0, past_s, past_s**2, dx, dx * past_s, dy, dy * past_s)
            for n in range(7):
                s.stood[n] += terms[n]
        count = _remember(kept, -math.inf, time_s, x, y)
        for axis in range(1, 3 if count > 2 else 1):
            bend = abs(kept[count, axis] - 2.0 * kept[count - 1, axis] + kept[count - 2, axis])
            differences[int(s.difference_count) % _DIFFERENCES] = bend
            s.difference_count += 1.0
    _remember(s.encoder[0], now - _HISTORY_S, math.nan, 0.0, 0.0)

    plan = s.plan[0]
    count = int(plan[0, 0])
    before = plan[count, 0] if count else -math.inf
    if sent and before < now:
        oldest = now - parameters[VehicleParameter.DEAD_TIME_HP] - 1e-9
        _remember(s.sent[0], oldest, now, command[2], 0.0)
        tau = parameters[VehicleParameter.SPEED_TIME_CONSTANT]
        target = parameters[VehicleParameter.SPEED_GAIN] * abs(s.sent[0, 1, 1])
        speed = plan[count, 1] if count and plan[count, 1] == plan[count, 1] else target
        speed += (1.0 - math.exp((before - now) / tau)) * (target - speed)
        _remember(plan, now - _HISTORY_S - _SPAN_S, now, speed, 0.0)

    begin_s, end_s, ground, inverse, spans = math.inf, -math.inf, 0.0, 0.0, 0
    for receiver in range(2 if new else 0):
        kept, other = s.positions[receiver], s.positions[1 - receiver]
        count, others = int(kept[0, 0]), int(other[0, 0])
        last_s = kept[count, 0]
        if not count or last_s - kept[1, 0] < _LEAST_S:
            continue
        if others and last_s <= other[others, 0] - _LEAST_S:
            continue
        spans += 1
        begin_s, end_s = min(begin_s, kept[1, 0]), max(end_s, last_s)
        square, centre = 0.0, 0.0
        for axis in range(1, 3):
            pair = 0
            for later in range(2, count + 1):
                for earlier in range(1, later):
                    way = kept[later, axis] - kept[earlier, axis]
                    work[pair] = way / (kept[later, 0] - kept[earlier, 0])
                    pair += 1
            square += _median(work, count * (count - 1) // 2) ** 2
        ground += math.sqrt(square)
        for n in range(1, count + 1):
            centre += kept[n, 0]
        square = 0.0
        for n in range(1, count + 1):
            square += (kept[n, 0] - centre / count) ** 2
        inverse += 1.0 / square
    if spans:
        ground /= spans
        sd, count = 0.0, min(int(s.difference_count), _DIFFERENCES)
        if count >= _LEAST_DIFFERENCES:
            for n in range(count):
                work[n] = differences[n]
            s.position_sd = _MEDIAN_TO_SD * _median(work, count)
            sd = s.position_sd * math.sqrt(inverse) / spans
        planned = _mean(plan, begin_s, end_s)
        for which in range(2):
            index, sums = DetectorIndex.MOTION + which, s.speed_sums[which]
            mean = _mean(s.encoder[0], begin_s, end_s) if which else planned
            most, allowance = _WHEELS if which else _MOTION
            present = s.present[index]
            present[3] = planned
            if mean == mean:
                present[1], present[2] = mean, ground
                excess = abs(mean - ground) - max(0.0, _SIGMAS * sd - allowance)
                residual = math.copysign(max(0.0, excess), mean - ground)
                sums[0] = min(max(0.0, sums[0] + residual - allowance), _SATURATION * most)
                sums[1] = min(max(0.0, sums[1] - residual - allowance), _SATURATION * most)
                statistic[index], residuals[index] = max(sums[0], sums[1]), residual
            if which:
                # The encoder is the one that is wrong where the speed over ground is nearer to the
                # planned one; else the wheels make no or too little way.
                present[0] = _STOP_ON_PATH if present[2] < _STANDS * present[1] else _SLOW
                if abs(present[2] - planned) < abs(present[1] - planned):
                    present[0] = _GO_ON


@_compiled
def _observe_steering(
    parameters: FloatArray,
    monitors: FloatArray,
    rows: FloatArray,
    now: float,
    command: FloatArray,
    innovations: FloatArray,
) -> None:
    s = record(monitors, MONITORS)
    limit, statistic, residuals, unused = s.limit, s.statistic, s.residual, s.unused
    alarms, sent = s.alarms, command[0] == command[0]
    axes = 2 if now > s.steered_s else 0
    s.steered_s = max(now, s.steered_s)
    for axis in range(axes):
        response, dead_time = s.response[axis], parameters[VehicleParameter.DEAD_TIME_T + axis]
        valve, angle, scale, slow = s.valve[axis], s.angle[axis], s.scale[axis], s.slow[axis]
        count = int(response[0, 0])
        if sent and count:
            at, oldest = response[count, 0], now - dead_time - _UNKNOWN_S - _KEPT_S
            steps = min(max(1, math.ceil((now - at) / _STEP_S - 1e-9)), _MOST_STEPS)
            step = (now - at) / steps
            lags = step / parameters[VehicleParameter.STEERING_LAG_T + axis]
            share, less = 1.0 - math.exp(-lags), 1.0 - math.exp(-_COLD * lags)
            reach = parameters[VehicleParameter.STEERING_RATE_T + axis] * step
            for n in range(steps):
                valve = min(max(command[axis], valve - reach), valve + reach)
                angle += share * (valve - angle)
                slow[0] += min(max(command[axis] - slow[0], -_COLD * reach), _COLD * reach)
                slow[1] += less * (slow[0] - slow[1])
                count = _remember(response, oldest, at + (n + 1) * step, angle, slow[1])
            s.valve[axis], s.angle[axis] = valve, angle

        mean, number, earliest, latest = 0.0, 0, math.inf, -math.inf
        sensor, changes = SensorIndex.STEERING_TRACTOR + axis, s.changes[axis]
        for row in range(len(rows) if unused[sensor] == 0.0 else 0):
            time_s, value = rows[row, 0], rows[row, 2]
            if rows[row, 1] != sensor or not math.isfinite(time_s + value):
                continue
            mean += value
            number += 1
            earliest, latest = min(earliest, time_s), max(latest, time_s)
            change = value - s.sample[axis]
            if change == change:
                changes[int(s.change_count[axis]) % _CHANGES] = change * change
                s.change_count[axis] += 1.0
            s.sample[axis] = value if angle == angle else math.nan
        if not number:
            continue
        mean /= number
        if angle != angle:
            s.valve[axis] = s.angle[axis] = slow[0] = slow[1] = mean
            _remember(response, -math.inf, now, mean, mean)
            s.compared_s[axis] = now
            continue
        means, low, high = s.mean[axis], mean, mean
        for n in range(1, _TICKS):
            low, high = min(low, means[n]), max(high, means[n])
            means[n - 1] = means[n]
        means[_TICKS - 1], s.moved[axis] = mean, high - low

        intervals = min(_INTERVALS, math.ceil((dead_time + _UNKNOWN_S) / _INTERVAL_S - 1e-9))
        first, last, known = count + 1, count, True
        for n in range(intervals + 1):
            delay = n * _INTERVAL_S
            while first > 1 and response[first - 1, 0] >= earliest - delay - _STEP_S:
                first -= 1
            while last > 0 and response[last, 0] > latest - delay:
                last -= 1
            known = known and response[1, 0] <= earliest - delay and first <= last
            for which in range(2):
                total = 0.0
                for entry in range(first, last + 1):
                    total += response[entry, 1 + which]
                mean = total / (last + 1 - first) if first <= last else math.nan
                s.workspace[n + which * (_INTERVALS + 1)] = mean
        if not known:
            continue
        sums = s.intervals[axis]
        for n in range(int(s.interval_count[axis]), intervals):
            sums[n, 0] = sums[n, 1] = sums[n, 4] = 0.0
            sums[n, 3] = -math.inf
        s.interval_count[axis] = intervals
        total, count = 0.0, min(int(s.change_count[axis]), _CHANGES)
        for n in range(count):
            total += changes[n]
        noise = math.sqrt(total / (2.0 * max(1, count) * number))
        play = 2.0 * math.sqrt(s.mean_square[axis]) / _ALLOWANCE
        s.scale[axis] = scale = max(1.0, play, noise / _QUIET)
        for n in range(intervals):
            low, high = s.workspace[n], s.workspace[n + 1]
            late, later = s.workspace[n + _INTERVALS + 1], s.workspace[n + _INTERVALS + 2]
            low, high = min(low, high, late, later), max(low, high, late, later)
            residual = mean - min(max(mean, low), high)
            sums[n, 2] = residual = residual / scale
            for side in range(2):
                total = sums[n, side] + residual - _ALLOWANCE
                sums[n, side] = min(max(0.0, total), _SATURATION * _STEERING)
                residual = -residual
        for part in range(3):  # the least of all; of those that are possible, before and after
            possible = False
            for n in range(intervals):
                possible = possible or (part > 0 and sums[n, 4] == 0.0)
            best, residual = math.inf, math.nan
            for n in range(intervals):
                most = max(sums[n, 0], sums[n, 1])
                nearer = most < best or (most == best and abs(sums[n, 2]) < abs(residual))
                if nearer and not (possible and sums[n, 4] > 0.0):
                    best, residual = most, sums[n, 2]
            least = s.least[axis, min(part, 1)]
            least[0], least[1] = best, residual
            mistaken = s.least[axis, 0, 0] <= _STANDSTILL < best
            mistaken = mistaken and s.moved[axis] >= _ALLOWANCE * scale
            for n in range(intervals if part == 1 else 0):
                if best <= _STANDSTILL < max(sums[n, 0], sums[n, 1]):
                    sums[n, 3] = now
                if mistaken:
                    sums[n, 3] = -math.inf
                sums[n, 4] = 1.0 if now - sums[n, 3] < _REFUTED_S else 0.0
        square = min(scale * abs(s.least[axis, 1, 1]), _MOST_PLAY) ** 2
        weight = min(1.0, (now - s.compared_s[axis]) / _PLAY_S)
        s.mean_square[axis] += weight * (square - s.mean_square[axis])
        s.compared_s[axis] = now
    for axis in range(2):
        moves = s.moved[axis] >= _ALLOWANCE * s.scale[axis]
        for which in range(2):
            index, least = DetectorIndex.STEERING + 2 * which + axis, s.least[axis, which]
            statistic[index], residuals[index] = least[0], least[1]
            if which and moves:
                statistic[index] = 0.0

    for n in range(4):
        kept, index, sensor = s.innovations[n], DetectorIndex.INNOVATIONS + n, n + n // 2 * 2
        total, entries = 0.0, 0.0
        for row in range(len(innovations)):
            if innovations[row, 0] == sensor and math.isfinite(innovations[row, 1]):
                total += min(innovations[row, 1], _MOST_SQUARE)
                entries += innovations[row, 2]
        time_s = now if entries else math.nan
        count = _remember(kept, now - _SPAN_S + 1e-6, time_s, total, entries)
        square, entries = 0.0, 0.0
        for row in range(1, 1 + count):
            square += kept[row, 1]
            entries += kept[row, 2]
        statistic[index], residuals[index] = 0.0, math.nan
        if entries:
            spread = 2.0 / (9.0 * entries)
            equivalent = ((square / entries) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
            statistic[index] = residuals[index] = max(0.0, equivalent)

    # Motion lasts as long as both receivers contradict the estimate, as those that are swapped.
    both = min(alarms[DetectorIndex.INNOVATIONS, 0], alarms[DetectorIndex.INNOVATIONS + 1, 0])
    if both >= 0.0 and alarms[DetectorIndex.MOTION, 0] >= 0.0:
        statistic[DetectorIndex.MOTION] = max(_MOTION[0], statistic[DetectorIndex.MOTION])
    for index in range(_COUNT):
        if statistic[index] > limit[index]:
            for n in range(ALARM if alarms[index, 0] < 0.0 else 0):
                alarms[index, n] = s.present[index, n]
        elif statistic[index] < _ENDS * limit[index]:
            alarms[index, 0] = -1.0
    if alarms[DetectorIndex.WHEELS, 0] == _GO_ON:
        unused[SensorIndex.ENCODER] = 1.0
    if alarms[DetectorIndex.HITCH, 0] >= 0.0:
        unused[SensorIndex.HITCH] = unused[SensorIndex.IMU_TRACTOR] = 1.0
        unused[SensorIndex.IMU_TRAILER] = 1.0
    # Until the vehicle stands. Where the wheels may spin, dead reckoning is worse.
    fooled = alarms[DetectorIndex.POSITION, 0] >= 0.0 and now - s.spun_s > _SPUN_S
    for sensor in range(2 if fooled and abs(s.pose[4]) > _MOVING else 0):
        unused[sensor] = 1.0


def observe_monitors(
    parameters: FloatArray,
    monitors: FloatArray,
    rows: FloatArray,
    now: float,
    command: FloatArray,
    estimate: FloatArray,
    innovations: FloatArray,
) -> None:
    """Advance all built-in detectors by a tick, in place.

    An alarm begins where a statistic exceeds its limit and ends where it falls below half of it.

    Repetitions: the noise of a sensor that works changes every reading. The samples of a sensor are
    not used while it repeats itself; the first other reading ends the alarm. Samples under an old
    time stamp do not count. The statistic of a sensor that repeats readings in good health is 0.
    An angle sensor has a sum beside, which a resolution does not switch off: a second difference
    below a quarter of its usual size adds 1, any other takes 4 off. The limit is four times the
    largest sum in good health. A sensor whose readings change by steps of its resolution, or with
    the angle rather than by noise, has none.

    Motion, wheels: the speed that the hydrostat's commands ask for, and that of the encoder, in the
    mean of a second against the speed over ground in it. That is the slope of the positions over
    time by Theil and Sen (Sen 1968, JASA 63): each axis has the median of the slopes between all
    pairs, which a single outlier does not move; both receivers have their mean, without a sign. A
    position farther from the last one than a vehicle goes is left out, for a second at most, as is
    one of a time before it. The allowance holds for three standard deviations of the speed, as with
    a noise of the positions of 10 cm. More noise makes the residual smaller and gives no alarm.

    Sums are cumulative ones to both sides (Page 1954, Biometrika 41). They grow where the mean
    residual r is above the allowance k, half of the shift to be detected:

        g+ = max(0, g+ + r - k),   g- = max(0, g- - r - k).

    Steering: a measured angle against the response of the model to the commands, which has the rate
    limit and the lag learnt so far. The dead time may not be learnt yet, or wrongly: each interval
    of possible ones has a residual of its own, the distance of the mean sample of a tick from what
    the response has covered in it, at full or at the least flow, and a sum. A healthy valve agrees
    with one of the intervals for good, a stuck valve with none: the statistic is the least of the
    sums [rad]. An interval that the valve contradicts while it follows another is refuted for a
    minute, or until the valve moves as it says and as no other. Standstill, as of a stuck valve,
    counts the others alone, and is 0 while the angle moves, so that it is earlier; commands that
    are late or lost for a moment show as well. The allowance grows with the noise of the mean,
    where it is above that of the paper's sensor, and is at least twice the root mean square of the
    residuals of a valve with play.

    Innovations: the sum S of the normalised squared innovations of a sensor over a second. For a
    consistent filter it is chi-square with n degrees of freedom, the entries of all samples. The
    statistic is its standard normal equivalent (Wilson and Hilferty 1931), 0 below its mean,

        ((S / n)^(1/3) - (1 - 2 / (9 n))) / sqrt(2 / (9 n)).

    Hitch: the larger of two ratios to their limits. The sum of the whitened innovations of a second
    over the root of their number is standard normal, beside the curve of a sensor; it does not
    count while GNSS or a steering angle contradicts the estimate. The side slip that turns with the
    tractor, less that of the trailer, is near 0 on any slope, but not with a wrong hitch angle. The
    sensor and the IMUs, which may be what lies, are not used again before `resume`.

    Position: the length of the sum of what the estimate moves beside dead reckoning by speed, yaw
    and side slip, with a memory of 10 s and, once it is an alarm, of any length, so that a jump is
    not believed because it lasts. What an estimate corrects of the error that it stated before, as
    after an outage, does not count. The limit grows with the learnt roughness.

    Protection level: a bound of the horizontal error of the tractor point [m], the residual of this
    detector: what dead reckoning lets pass, and the error that a covariance with the larger
    variance v exceeds with probability p, sqrt(-2 v ln p) (as the horizontal protection level of
    RTCA DO-229, there for one axis). It holds without GNSS, and without a sensor that is left out;
    where both receivers lie alike (jump, drift, float) the error may be larger: the table of
    docs/appendix/reliability.md. The statistic is 0 as long as all sensors are used.

    Drift: at a common drift w of both receivers and a speed v the filter finds a side slip of w / v
    and a wheel slip of -w / v, fixed in the map; a slope has such slips, too, and ruts the former.
    Where a weighted difference of both leaves 0 and the accepted one, by more on a slope that wheel
    slip shows, or wheel slip its usual one, the vehicle stops, and GNSS is watched at rest for as
    long as its noise takes. If it moves twice in succession it drifts, and the vehicle stands until
    `resume`. Else the slips are accepted and the vehicle drives on; the limits grow for some
    minutes. Not with a tool in the soil.

    Args:
        parameters: of the vehicle, see `VehicleParameter`.
        monitors: flat record `MONITORS`; changes.
        rows: samples (n, `SAMPLE`) that arrived since the tick before, in the order of arrival.
        now: time of the tick [s].
        command: of the period before (3,), NaN where there was none.
        estimate: record `ESTIMATE` of this tick.
        innovations: of the samples of this tick (n, `INNOVATION`).
    """
    _observe_speeds(parameters, monitors, rows, now, command)
    _observe_estimate(monitors, now, estimate, innovations)
    _observe_steering(parameters, monitors, rows, now, command, innovations)


_ANGLES: Final = "front steering angle", "trailer steering angle"
_OTHERS: Final = "GNSS of the tractor", "GNSS of the trailer", "hitch angle", "encoder"
_VALVES: Final = "front steering", "trailer steering"
# By detector: name, limit, reaction, reason. A valve that stands still slows the vehicle down until
# it is known whether it is stuck. One that is slow steers better than one that is held. The
# steering angles have detectors of their own, since a dead time that was not learnt yet makes their
# innovations large. Innovations of the others grow with a fault of the sensor, and as much with
# wrong lengths or an assumed noise that is too small: the vehicle goes on, and learns.
_TABLE = [
    (f"readings of the {what}", _REPETITIONS, _GO_ON, f"{what} repeats one reading: not used")
    for what in (*_OTHERS[:2], *_ANGLES, *_OTHERS[2:])
]
_TABLE += [
    (what, _STEERING, _STOP_ON_PATH, f"{what} does not follow its command") for what in _VALVES
]
_TABLE += [
    (f"{what} at standstill", _STANDSTILL, _SLOW, f"{what} stands still against its command")
    for what in _VALVES
]
_TABLE += [
    ("motion", _MOTION[0], _STOP_ON_PATH, "planned speed {:.2f} m/s, GNSS moves at {:.2f} m/s"),
    ("wheels", _WHEELS[0], _SLOW, "wheels turn at {:.2f} m/s, GNSS moves at {:.2f} m/s"),
]
_TABLE += [
    (f"innovations of the {what}", limit, _GO_ON, f"{what} contradicts the estimate")
    for what, limit in zip(_OTHERS, _INNOVATION, strict=True)
]
_TABLE += [
    ("hitch", 1.0, _GO_ON, "hitch angle contradicts the motion of both bodies: not used"),
    ("position", 1.0, _STOP_ON_PATH, "position is {:.1f} m off dead reckoning"),
    ("drift", 1.0, _STOP_ON_PATH, "check whether GNSS drifts, as by {:.0f} cm/s"),
    ("protection level", _LEVEL[0], _SLOW, "position known to {:.1f} m without a sensor"),
]
_NAMES, _LIMITS, _REACTIONS, _REASONS = zip(*_TABLE, strict=True)


_SENSORS: Final = tuple(Sensor)  # in the order of `SensorIndex`


class Monitors:
    """Runs the built-in detectors, then those of a user; keeps alarms until their causes end.

    An alarm begins where a statistic exceeds its limit and ends where it falls below half of it.
    The detectors of a user see no samples that an alarm of a built-in one rules out.
    """

    def __init__(self, own: Sequence[Detector] = (), *, built_in: bool = True) -> None:
        self._own, self._count = tuple(own), _COUNT if built_in else 0
        self.record = new_monitors()  # `MONITORS`
        self._own_alarms = np.tile([-1.0, 0.0, 0.0, 0.0], (len(own), 1))
        self._told: dict[int, Alarm] = {}  # those of a user's detectors, by row
        self._vehicle: Vehicle | None = None  # of the parameters
        self._parameters = np.empty(0)  # in the order of `VehicleParameter`

    def warm_up(self) -> None:
        """Compile or load what `observe` needs; changes no later result."""
        estimate, innovations = np.zeros(ESTIMATE.itemsize // 8), np.empty((0, INNOVATION))
        tick = np.empty((0, SAMPLE)), 0.0, np.full(3, math.nan), estimate, innovations
        observe_monitors(vehicle_parameters(Vehicle()), self.record.copy(), *tick)
        for detector in self._own:
            if isinstance(detector, WarmingUp):
                detector.warm_up()

    def observe(
        self,
        rows: FloatArray,
        now: float,
        sent: FloatArray,
        estimate: FloatArray,
        innovations: FloatArray,
        vehicle: Vehicle,
        view: Callable[[], Estimate],
    ) -> FloatArray:
        """Take in the data of a tick; return rows of `ALARM` entries, one for each detector.

        Args:
            rows: samples (n, `SAMPLE`) that arrived since the tick before, of sensors that work.
            now: time of the tick, from the first one [s].
            sent: command of the period before (3,), NaN at the first tick.
            estimate: record `ESTIMATE`.
            innovations: its rows (n, `INNOVATION`).
            vehicle: present model parameters.
            view: makes the estimate, for detectors of a user.
        """
        if self._count:
            if vehicle is not self._vehicle:
                self._vehicle, self._parameters = vehicle, vehicle_parameters(vehicle)
                # A tool in the soil has a side slip of its own.
                limit = math.inf if vehicle.tool_behind else _LIMITS[DetectorIndex.DRIFT]
                self.record.view(MONITORS)["limit"][0, DetectorIndex.DRIFT] = limit
            tick = rows, now, sent, estimate, innovations
            observe_monitors(self._parameters, self.record, *tick)
        if self._own:
            command = None if math.isnan(sent[0]) else Command(*sent.tolist())
            ruled_out = np.flatnonzero(self.record.view(MONITORS)[0]["unused"])
            samples = measurements_of(rows[~np.isin(rows[:, 1], ruled_out)])
            seen = Observation(now, samples, command, view(), vehicle)
            for index, detector in enumerate(self._own):
                detector.observe(seen)
                row = self._own_alarms[index]
                if detector.statistic > detector.limit and row[0] < 0.0:
                    alarm = self._told[index] = detector.alarm()
                    row[0] = alarm.reaction
                elif detector.statistic < _ENDS * detector.limit:
                    row[0] = -1.0
        return self.rows

    @property
    def rows(self) -> FloatArray:
        """Alarms that stand, rows of `ALARM` entries by detector."""
        built_in = self.record.view(MONITORS)[0]["alarms"][: self._count]
        return np.concatenate([built_in, self._own_alarms]) if self._own else built_in

    def resume(self, map_disturbance: FloatArray) -> None:
        """Take an estimate with these `MapDisturbance` (4,) for true and every sensor for sound."""
        s = self.record.view(MONITORS)[0]
        s["pose"] = s["slips"] = math.nan
        s["offset"] = s["whitened"] = s["drift"] = s["drifts"] = 0.0
        s["accepted"] = _PATTERN[0] * map_disturbance[:2] - _PATTERN[1] * map_disturbance[2:]
        s["alarms"][DetectorIndex.HITCH :] = -1.0, 0.0, 0.0, 0.0

    def forget_pose(self) -> None:
        """Begin dead reckoning at the next estimate: that of another estimator is no jump."""
        self.record.view(MONITORS)["pose"][0, 0] = math.nan

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """All detectors; the built-in ones, by `DetectorIndex`, as they are now."""
        s, count = self.record.view(MONITORS)[0], self._count
        columns = (s[name].tolist() for name in ("limit", "statistic", "residual"))
        known = zip(_NAMES[:count], *columns, strict=False)
        return (*(Detector(*item) for item in known), *self._own)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The alarms that stand, by detector."""
        return tuple(self._alarm(i, r) for i, r in enumerate(self.rows.tolist()) if r[0] >= 0.0)

    def reason(self, index: int, numbers: FloatArray) -> str:
        """Return the words of an alarm of `observe` from its row and its three numbers."""
        return self._alarm(index, [Reaction.SLOW, *numbers]).reason

    def usable(self, rows: FloatArray) -> FloatArray:
        """Return the samples without those of sensors that an alarm rules out."""
        if not (self.rows[:, 0] >= 0.0).any():
            return rows
        unused = np.flatnonzero(self.record.view(MONITORS)[0]["unused"]).tolist()
        told = (self._told[i] for i, row in enumerate(self._own_alarms) if row[0] >= 0.0)
        unused += [_SENSORS.index(sensor) for alarm in told for sensor in alarm.unused]
        return rows[~np.isin(rows[:, 1], unused)] if unused else rows

    def _alarm(self, index: int, row: Sequence[float]) -> Alarm:
        if index >= self._count:
            return self._told[index - self._count]
        reaction, *numbers = row
        reason, unused = _REASONS[index].format(*numbers), frozenset[Sensor]()
        if index < DetectorIndex.STEERING:
            unused = frozenset({_SENSORS[index]})
        elif index == DetectorIndex.HITCH:
            unused = frozenset({Sensor.HITCH, Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER})
        elif index == DetectorIndex.POSITION:  # until the vehicle stands
            unused = frozenset({Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER})
        elif index == DetectorIndex.DRIFT and numbers[1] > 0.0:
            reason = f"GNSS drifts by {numbers[0]:.1f} cm/s while the vehicle stands"
        elif index == DetectorIndex.WHEELS and reaction == _GO_ON:
            reason += f", planned {numbers[2]:.2f} m/s: encoder not used"
            unused = frozenset({Sensor.ENCODER})
        return Alarm(_NAMES[index], reason, Reaction(int(reaction)), unused)
