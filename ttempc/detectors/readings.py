"""Detector of a sensor that repeats its readings, or has lost its noise; one for each sensor."""

import math
from typing import Final

import numpy as np

from ..layout import SampleColumn
from ..sensors import SENSOR_KINDS, SensorKind
from ..types import FloatArray
from .board import ENDS, Record, TickData, has_alarm
from .history import cusum, kernel

NOISE: Final = np.dtype(
    [
        ("last", "f8"),  # the latest reading of all
        ("before_last", "f8"),
        ("second_differences", "f8"),  # their mean square, in good health
        ("steps", "f8"),  # the mean square of the differences
        ("resolution", "f8"),  # smallest difference that is not 0
        ("learnt", "f8"),  # number of readings in the means, see `_MOST_LEARNT`
        ("run", "f8"),  # cumulative sum of readings without noise
        ("run_peak", "f8"),  # its largest value since it was 0
        ("longest_run", "f8"),  # its largest value in good health
        ("ratio", "f8"),  # the sum over its limit
    ]
)
"""Memory of the noise of an angle sensor; readings in its unit."""

READINGS: Final = np.dtype(
    [
        ("time_s", "f8"),  # of the latest reading
        ("reading", "f8", 3),  # its components, 0 where it has fewer
        ("repeated", "f8"),  # readings in succession that equal the one before
        ("readings", "f8"),  # number of all in good health
        ("repetitions", "f8"),  # number of repetitions among them
        ("noise", NOISE),  # of an angle sensor
    ]
)
"""Memory of the readings of a sensor."""

# A sensor of coarse resolution repeats readings in good health; it is not judged. Assumed.
_LEAST_READINGS: Final = 50
_LARGEST_SHARE: Final = 1 / 500  # of repetitions among the readings of a sensor that is judged

# Numbers of the judgement of the noise of an angle sensor, all assumed.
_LOST_NOISE_SHARE: Final = 1.0 / 16.0  # of the mean square: a quarter of the usual size
_COUNTS_BACK: Final = 4.0  # of a reading with noise
_TIMES: Final = 4.0  # limit over the largest sum in good health
_LEAST_STEPS: Final = 2.0  # second differences over the resolution where noise makes the readings
_LEAST_RUN: Final = 10.0  # the least largest sum in good health, as a limit
_LEAST_LEARNT: Final = 250.0  # readings before the first judgement
_MOST_LEARNT: Final = 2000.0  # readings after which the means forget


def new_readings() -> FloatArray:
    """Return a record `READINGS` of a sensor without a reading, flat."""
    flat = np.zeros(READINGS.itemsize // 8)
    memory = flat.view(READINGS)[0]
    memory["time_s"] = -math.inf
    memory["reading"] = math.nan
    memory["noise"]["last"] = math.nan
    memory["noise"]["before_last"] = math.nan
    memory["noise"]["resolution"] = math.inf
    return flat


@kernel
def observe_readings(memory: Record, board: Record, data: TickData, sensor: int) -> None:
    """Count the repetitions of a sensor; exclude it while it repeats itself.

    The noise of a sensor that works changes every reading. The statistic is the number of readings
    in succession that are bit-identical to the one before, 0 where the sensor also repeats readings
    in good health (more than one in 500). Samples under an old time stamp do not count. The third
    repetition begins an alarm, which is assumed.

    An angle sensor has a second statistic, see `observe_noise`, which a coarse resolution does not
    switch off; the larger one, relative to its limit, counts. The first reading that differs ends
    the alarm, and the samples are used again at once.

    Args:
        memory: record `READINGS` of the sensor.
        board: record `BOARD`; the detector has the index of the sensor.
        data: of the tick.
        sensor: `SensorIndex`, none of an IMU.
    """
    limit = board.limit[sensor]
    is_angle = SENSOR_KINDS[sensor] == SensorKind.ANGLE

    for row in range(len(data.rows)):
        sample = data.rows[row]
        if sample[SampleColumn.SENSOR] != sensor:
            continue
        if memory.time_s < sample[SampleColumn.TIME_S] < math.inf:
            memory.time_s = sample[SampleColumn.TIME_S]
            if is_angle:
                observe_noise(memory.noise, sample[SampleColumn.FIRST])
            _count(memory, sample, limit)

    statistic = memory.repeated if _is_judged(memory) else 0.0
    if is_angle:
        statistic = max(statistic, limit * memory.noise.ratio)
    board.statistic[sensor] = statistic
    board.residual[sensor] = statistic

    lasts = has_alarm(board, sensor) and statistic >= ENDS * limit
    if lasts or statistic > limit:
        board.excluded[sensor] = 1.0


@kernel
def _is_judged(memory: Record) -> bool:
    """Return whether a sensor in good health repeats so few readings that repetitions tell."""
    enough = memory.readings >= _LEAST_READINGS
    return enough and memory.repetitions <= _LARGEST_SHARE * memory.readings


@kernel
def _count(memory: Record, sample: FloatArray, limit: float) -> None:
    """Take in a reading: one more repetition, or the end of them."""
    same = True
    for n in range(3):
        component = sample[SampleColumn.FIRST + n]
        same = same and memory.reading[n] == component
        memory.reading[n] = component
    if same:
        memory.repeated += 1.0
        return

    # Repetitions that were no fault are of the sensor's nature.
    if not _is_judged(memory) or memory.repeated <= limit:
        memory.readings += memory.repeated
        memory.repetitions += memory.repeated
    memory.readings += 1.0
    memory.repeated = 0.0


@kernel
def observe_noise(memory: Record, reading: float) -> None:
    """Compare the second difference of the readings of an angle sensor with its usual size.

    With readings x and the mean square m of their second differences in good health,

        d = (x(k) - 2 x(k-1) + x(k-2))^2,   g <- max(0, g + (1 if d <= m / 16 else -4)).

    White noise leaves d below m / 16 with a probability of 0.2, so that g stays near 0 where there
    is noise, and grows by 1 a reading where it is lost, as of a sensor that is stuck behind a
    converter with a little noise of its own. The limit is four times the largest g in good health,
    and 10 at least. There is no judgement in the first 250 readings, and none of a sensor whose
    readings change by steps of its resolution, or with the angle rather than by noise.

    Args:
        memory: record `NOISE`; `ratio` is g over its limit, 0 without a judgement.
        reading: of the sensor [rad].
    """
    second_difference = (reading - 2.0 * memory.last + memory.before_last) ** 2
    step = abs(reading - memory.last)
    memory.before_last = memory.last
    memory.last = reading
    memory.ratio = 0.0
    if not math.isfinite(second_difference):
        return

    limit = max(_LEAST_RUN, _TIMES * memory.longest_run)
    learnt = memory.learnt >= _LEAST_LEARNT
    is_quiet = second_difference <= _LOST_NOISE_SHARE * memory.second_differences
    memory.run = cusum(memory.run, 1.0 if is_quiet else -_COUNTS_BACK, 0.0, limit)

    # The means follow the sensor in good health, not while it seems to have lost its noise.
    if not learnt or memory.run <= _LEAST_RUN:
        memory.learnt = min(memory.learnt + 1.0, _MOST_LEARNT)
        memory.second_differences += (second_difference - memory.second_differences) / memory.learnt
        memory.steps += (step * step - memory.steps) / memory.learnt
    if step > 0.0:
        memory.resolution = min(memory.resolution, step)

    # A run that has ended below the limit was one of good health.
    memory.run_peak = max(memory.run_peak, memory.run)
    if memory.run == 0.0:
        if not learnt or memory.run_peak <= limit:
            memory.longest_run = max(memory.longest_run, memory.run_peak)
        memory.run_peak = 0.0

    by_noise = memory.second_differences >= memory.steps
    by_noise = by_noise and memory.second_differences >= (_LEAST_STEPS * memory.resolution) ** 2
    if learnt and by_noise:
        memory.ratio = memory.run / limit
