"""Speeds of the vehicle over a second: over ground by GNSS, planned by commands, of the wheels.

Detectors of motion and wheels compare them. Each is the mean over the same span, which is that of
the positions.
"""

import math
from typing import Final

import numpy as np

from ..layout import FLOAT, SampleColumn
from ..models.augmented_state import VehicleParameter
from ..sensors import SENSOR_KINDS, SensorIndex, SensorKind
from ..types import FloatArray, Input, State
from .board import Record, TickData
from .history import Entry, forget, kernel, mean_in_span, median, remember
from .standstill import add_position

_POSITIONS: Final = 102  # of a second: GNSS at 100 Hz
_COMMANDS: Final = 202  # of a dead time: control at 100 Hz
_PLANNED: Final = 402  # of four seconds: control at 100 Hz
_ENCODER: Final = 602  # of three seconds: an encoder at 200 Hz
_DIFFERENCES: Final = 200  # of positions: 20 s of both axes at 5 Hz

SPEEDS: Final = np.dtype(
    [
        ("positions", "f8", (2, 1 + _POSITIONS, 3)),  # histories of x, y [m], by receiver
        ("commands", "f8", (1 + _COMMANDS, 3)),  # history of the end of each and its hydrostat
        ("planned", "f8", (1 + _PLANNED, 3)),  # history of the planned speed [m/s], without a sign
        ("encoder", "f8", (1 + _ENCODER, 3)),  # history of its speed [m/s], forward in the gear
        ("differences", "f8", _DIFFERENCES),  # ring: second ones of positions, unsigned [m]
        ("difference_count", "f8"),  # of all so far
        ("position_sd", "f8"),  # of the white noise of positions [m]
        ("workspace", "f8", _POSITIONS * (_POSITIONS - 1) // 2),  # slopes between all pairs
        # Results of a tick:
        ("known", "f8"),  # 1: there is a new speed over ground
        ("ground_mps", "f8"),  # over ground, without a sign
        ("ground_sd_mps", "f8"),  # standard deviation of that speed
        ("planned_mps", "f8"),  # NaN where no command acted in the span
        ("wheels_mps", "f8"),  # NaN where there is no sample of the encoder in it
    ]
)
"""Memory of speeds. Beyond the room of a history the spans are shorter."""

_SPAN_S: Final = 1.0  # of the positions of a speed
_LEAST_SPAN_S: Final = 0.6  # between the first and the last position
_HISTORY_S: Final = 3.0  # age of the oldest position that speeds are compared with
_SAME_TIME_S: Final = 1e-6
_FASTEST_MPS: Final = 5.0  # of a vehicle; assumed
_LARGEST_ERROR_M: Final = 0.5  # of a position that is no outlier; assumed
_LEAST_DIFFERENCES: Final = 20
_MEDIAN_TO_SD: Final = 1.4826 / math.sqrt(6.0)  # of x(k) - 2 x(k-1) + x(k-2) of white noise


def new_speeds() -> FloatArray:
    """Return a record `SPEEDS` without a sample, flat."""
    flat = np.zeros(SPEEDS.itemsize // 8)
    memory = flat.view(SPEEDS)[0]
    memory["position_sd"] = math.inf
    return flat


@kernel
def measure_speeds(memory: Record, standstill: Record, board: Record, data: TickData) -> None:
    """Take in the samples of a tick and write the speeds.

    Args:
        memory: record `SPEEDS`.
        standstill: record `STANDSTILL`, which sees the same positions.
        board: record `BOARD`, with the sensors that the readings of this tick exclude.
        data: of the tick.
    """
    new = False
    for row in range(len(data.rows)):
        sample = data.rows[row]
        sensor = int(sample[SampleColumn.SENSOR])
        time_s = sample[SampleColumn.TIME_S]
        first = sample[SampleColumn.FIRST]
        second = sample[SampleColumn.SECOND]
        if board.excluded[sensor] > 0.0 or not math.isfinite(time_s + first + second):
            continue
        if sensor == SensorIndex.ENCODER:
            forward = -first if data.parameters[VehicleParameter.REVERSE] else first
            remember(memory.encoder, -math.inf, time_s, forward, 0.0)
        is_position = SENSOR_KINDS[sensor] == SensorKind.POSITION
        if is_position and _take_position(memory, sample, sensor):
            add_position(standstill, sample, sensor)
            new = True
    remember(memory.encoder, data.now - _HISTORY_S, math.nan, 0.0, 0.0)
    _plan_speed(memory, data)

    memory.known = 0.0
    if new:
        _measure_ground(memory)


@kernel
def wheel_speed(data: TickData) -> float:
    """Return the mean speed of the encoder in a tick; that of the estimate without a sample."""
    total = 0.0
    count = 0
    for row in range(len(data.rows)):
        sample = data.rows[row]
        speed = sample[SampleColumn.FIRST]
        if int(sample[SampleColumn.SENSOR]) == SensorIndex.ENCODER and math.isfinite(speed):
            total += speed
            count += 1
    return total / count if count else data.estimate.state[State.V]


@kernel
def _take_position(memory: Record, sample: FloatArray, receiver: int) -> bool:
    """Add a position to its history unless it is an outlier; return whether it was added.

    A position farther from the last one than a vehicle drives is left out, for a second at most, as
    is one of a time before it. A position without integer ambiguities empties the history: fixes
    before and after it are not of one solution.
    """
    history = memory.positions[receiver]
    time_s = sample[SampleColumn.TIME_S]
    x = sample[SampleColumn.FIRST]
    y = sample[SampleColumn.SECOND]
    if sample[SampleColumn.THIRD] == FLOAT:
        forget(history)
        return False

    count = remember(history, time_s - _SPAN_S - _SAME_TIME_S, math.nan, 0.0, 0.0)
    if count:
        span_s = time_s - history[count, Entry.TIME_S]
        distance = math.hypot(x - history[count, Entry.FIRST], y - history[count, Entry.SECOND])
        if span_s <= 0.0 or distance > _FASTEST_MPS * span_s + _LARGEST_ERROR_M:
            return False

    count = remember(history, -math.inf, time_s, x, y)
    if count > 2:
        for axis in range(1, 3):
            second_difference = abs(
                history[count, axis] - 2.0 * history[count - 1, axis] + history[count - 2, axis]
            )
            memory.differences[int(memory.difference_count) % _DIFFERENCES] = second_difference
            memory.difference_count += 1.0
    return True


@kernel
def _plan_speed(memory: Record, data: TickData) -> None:
    """Add the speed that the hydrostat's commands ask for: a lag of first order after a dead time,

    v(k) = v(k-1) + (1 - exp(-T / tau)) (K |hp(k - d)| - v(k-1)).
    """
    planned = memory.planned
    count = int(planned[0, 0])
    before_s = planned[count, Entry.TIME_S] if count else -math.inf
    if math.isnan(data.command[0]) or not before_s < data.now:
        return

    # The oldest command within the dead time is the one that acts.
    oldest_s = data.now - data.parameters[VehicleParameter.DEAD_TIME_HP] - 1e-9
    remember(memory.commands, oldest_s, data.now, data.command[Input.HP], 0.0)
    acting = abs(memory.commands[1, Entry.FIRST])

    tau = data.parameters[VehicleParameter.SPEED_TIME_CONSTANT]
    target = data.parameters[VehicleParameter.SPEED_GAIN] * acting
    speed = target
    if count and not math.isnan(planned[count, Entry.FIRST]):
        speed = planned[count, Entry.FIRST]
    speed += (1.0 - math.exp((before_s - data.now) / tau)) * (target - speed)
    remember(planned, data.now - _HISTORY_S - _SPAN_S, data.now, speed, 0.0)


@kernel
def latest_plan(memory: Record) -> float:
    """Return the planned speed of the latest command [m/s], without a sign; 0 without one."""
    count = int(memory.planned[0, 0])
    return memory.planned[count, Entry.FIRST] if count else 0.0


@kernel
def _measure_ground(memory: Record) -> None:
    """Write the speed over ground of both receivers' mean, and the other speeds in its span."""
    begin_s = math.inf
    end_s = -math.inf
    total = 0.0
    variances = 0.0  # of the speeds, over that of a position [1/s^2]
    receivers = 0
    for receiver in range(2):
        history = memory.positions[receiver]
        other = memory.positions[1 - receiver]
        count = int(history[0, 0])
        others = int(other[0, 0])
        last_s = history[count, Entry.TIME_S]
        if not count or last_s - history[1, Entry.TIME_S] < _LEAST_SPAN_S:
            continue
        if others and last_s <= other[others, Entry.TIME_S] - _LEAST_SPAN_S:
            continue  # this receiver is silent
        receivers += 1
        begin_s = min(begin_s, history[1, Entry.TIME_S])
        end_s = max(end_s, last_s)
        total += _speed(history, memory.workspace)
        variances += 1.0 / _spread(history)
    if not receivers:
        return

    memory.known = 1.0
    memory.ground_mps = total / receivers
    noise = _position_noise(memory)
    memory.ground_sd_mps = noise * math.sqrt(variances) / receivers
    memory.planned_mps = mean_in_span(memory.planned, begin_s, end_s)
    memory.wheels_mps = mean_in_span(memory.encoder, begin_s, end_s)


@kernel
def _speed(history: FloatArray, workspace: FloatArray) -> float:
    """Return the speed of positions [m/s], by the slopes of Theil and Sen of both axes.

    A slope is the median of those between all pairs (Sen 1968, JASA 63, 1379-1389), which a single
    outlier does not move.
    """
    count = int(history[0, 0])
    square = 0.0
    for axis in range(1, 3):
        pair = 0
        for later in range(2, count + 1):
            for earlier in range(1, later):
                distance = history[later, axis] - history[earlier, axis]
                span_s = history[later, Entry.TIME_S] - history[earlier, Entry.TIME_S]
                workspace[pair] = distance / span_s
                pair += 1
        square += median(workspace, count * (count - 1) // 2) ** 2
    return math.sqrt(square)


@kernel
def _spread(history: FloatArray) -> float:
    """Return the sum of the squared distances of the times from their mean [s^2].

    The variance of a slope by least squares is that of a position over this sum.
    """
    count = int(history[0, 0])
    centre = 0.0
    for n in range(1, count + 1):
        centre += history[n, Entry.TIME_S]
    square = 0.0
    for n in range(1, count + 1):
        square += (history[n, Entry.TIME_S] - centre / count) ** 2
    return square


@kernel
def _position_noise(memory: Record) -> float:
    """Return the standard deviation of the white noise of a position [m], 0 where not known yet.

    It is estimated by the median of the magnitude of second differences, in which constant speeds
    cancel.
    """
    count = min(int(memory.difference_count), _DIFFERENCES)
    if count < _LEAST_DIFFERENCES:
        return 0.0
    for n in range(count):
        memory.workspace[n] = memory.differences[n]
    memory.position_sd = _MEDIAN_TO_SD * median(memory.workspace, count)
    return memory.position_sd
