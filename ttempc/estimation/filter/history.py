"""Memory of the filter for samples that come late: snapshots, samples and commands of the past.

Snapshots stand in a ring, oldest first. They are made some 0.15 s apart; a sample between
two of them takes the filter back to the earlier one.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ...jit import cached_njit, record
from ...layout import SAMPLE, SampleColumn
from ...models.augmented_state import VehicleParameter
from ...sensors import SENSOR_COUNT, SENSOR_KINDS, SENSOR_LENGTHS, SensorKind
from ...types import FloatArray
from .predict import COMMAND_SIZE, END, INPUTS
from .records import SNAPSHOT, SNAPSHOT_SIZE

HISTORY: Final = np.dtype(
    [
        ("oldest", "i8"),  # index of the oldest snapshot in the ring
        ("snapshots", "i8"),  # number of snapshots in use
        ("samples", "i8"),  # number of samples in use
        ("commands", "i8"),  # number of commands in use
        ("resumes", "i8"),  # whether the last row of snapshots has what a restart takes over
        ("now_s", "f8"),  # time of the last update, or NaN
    ]
)
"""Record of how full the arrays of a `FilterMemory` are."""

BUFFERED_SAMPLE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("sensor", "f8"),  # number of the sensor, see `SensorIndex`
        ("entries", "f8", 3),  # as in `SampleColumn`; positions are those of the axle points
        ("accepted", "f8"),  # 1 if the filter used it
        ("arrival", "f8"),  # row in which it came at this update; else below 0, see `_OLD`
    ]
)
"""Record of a sample in memory; the first `SAMPLE` entries are those of a row of samples."""

BUFFERED_SIZE: Final = BUFFERED_SAMPLE.itemsize // 8

_EARLIER: Final = -1.0  # `arrival` of a sample that came at an earlier update
_OLD: Final = -2.0  # of one that no late sample can make the filter process again
_SNAPSHOTS: Final = 17  # rows of the arrays at the start; all of them grow
_SAMPLES: Final = 512
_COMMANDS: Final = 32


class FilterMemory(NamedTuple):
    """State of a filter as arrays that are changed in place; a copy of them is a copy of it."""

    history: FloatArray  # how full the other arrays are, a record `HISTORY`
    snapshots: FloatArray  # ring of `SNAPSHOT`, and a last row for the prediction to now
    samples: FloatArray  # rows `BUFFERED_SAMPLE`, by time, then by `_order`
    commands: FloatArray  # rows (n, `COMMAND_SIZE`), oldest first


def new_memory() -> FilterMemory:
    """Return the memory of a filter that has not started."""
    history = np.zeros(HISTORY.itemsize // 8)
    history.view(HISTORY)["now_s"] = math.nan
    return FilterMemory(
        history,
        snapshots=np.empty((_SNAPSHOTS, SNAPSHOT_SIZE)),
        samples=np.empty((_SAMPLES, BUFFERED_SIZE)),
        commands=np.zeros((_COMMANDS, COMMAND_SIZE)),
    )


def with_space(memory: FilterMemory, rows: int) -> FilterMemory:
    """Return a memory with space for `rows` new samples and a command: a full array doubles.

    The ring of snapshots begins at its first row then.
    """
    history, snapshots, samples, commands = memory
    h = history.view(HISTORY)[0]
    more = max(16, rows + 1)
    ring = len(snapshots) - 1
    if h["snapshots"] + more > ring:
        order = (h["oldest"] + np.arange(ring)) % ring
        larger = np.empty((2 * ring + more + 1, SNAPSHOT_SIZE))
        larger[:ring] = snapshots[order]
        larger[-1] = snapshots[-1]
        h["oldest"] = 0
        snapshots = larger
    if h["samples"] + rows > len(samples):
        samples = np.concatenate([samples, np.empty((len(samples) + rows, BUFFERED_SIZE))])
    if h["commands"] + 1 > len(commands):
        commands = np.concatenate([commands, np.empty_like(commands)])
    return FilterMemory(history, snapshots, samples, commands)


@cached_njit(error_model="numpy")
def snapshot_at(memory: FilterMemory, number: int) -> FloatArray:
    """Return the snapshot of a number, counted from the oldest one, as a flat `SNAPSHOT`."""
    h = record(memory.history, HISTORY)
    return memory.snapshots[(h.oldest + number) % (len(memory.snapshots) - 1)]


@cached_njit(error_model="numpy")
def newest_snapshot(memory: FilterMemory) -> FloatArray:
    """Return the newest snapshot, a flat `SNAPSHOT`; there must be one."""
    h = record(memory.history, HISTORY)
    return snapshot_at(memory, h.snapshots - 1)


@cached_njit(error_model="numpy")
def spare_snapshot(memory: FilterMemory) -> FloatArray:
    """Return the row outside the ring: the prediction to now, or the state kept over a gap."""
    return memory.snapshots[len(memory.snapshots) - 1]


@cached_njit(error_model="numpy")
def copy_row(source: FloatArray, target: FloatArray) -> None:
    """Copy a row of any length."""
    for i in range(len(target)):
        target[i] = source[i]


@cached_njit(error_model="numpy")
def append_command(memory: FilterMemory, now_s: float, command: FloatArray) -> None:
    """Append the command of the period that ends at `now_s`, or replace it at a repeated update."""
    h = record(memory.history, HISTORY)
    if h.commands == 0 or memory.commands[h.commands - 1, END] != now_s:
        h.commands += 1
    row = memory.commands[h.commands - 1]
    row[END] = now_s
    for j in range(COMMAND_SIZE - 1):
        row[1 + j] = command[j]


@cached_njit(error_model="numpy")
def _order(sensor: int) -> int:
    """Return the order of a sensor among samples of one time: IMUs first, then by number.

    The roll of an IMU moves the axle points that the receivers then measure.
    """
    if SENSOR_KINDS[sensor] == SensorKind.INERTIAL:
        return sensor - SENSOR_COUNT
    return sensor


@cached_njit(error_model="numpy")
def place_of(memory: FilterMemory, time_s: float, sensor: int) -> int:
    """Return the row in the buffer of samples before which a sample belongs."""
    h = record(memory.history, HISTORY)
    at = h.samples
    while at > 0:
        before = record(memory.samples[at - 1], BUFFERED_SAMPLE)
        first = _order(int(before.sensor)) <= _order(sensor)
        if before.time_s < time_s or (before.time_s == time_s and first):
            break
        at -= 1
    return at


@cached_njit(error_model="numpy")
def is_repeated(memory: FilterMemory, at: int, time_s: float, sensor: int) -> bool:
    """Whether the sample before row `at` of the buffer has this time and sensor."""
    if at == 0:
        return False
    before = record(memory.samples[at - 1], BUFFERED_SAMPLE)
    return before.time_s == time_s and before.sensor == sensor


@cached_njit(error_model="numpy")
def insert_sample(memory: FilterMemory, at: int, row: FloatArray, arrival: int) -> None:
    """Insert a row of samples, see `SampleColumn`, at row `at` of the buffer."""
    h = record(memory.history, HISTORY)
    for k in range(h.samples, at, -1):
        copy_row(memory.samples[k - 1], memory.samples[k])
    h.samples += 1
    for j in range(SAMPLE):
        memory.samples[at, j] = row[j]
    s = record(memory.samples[at], BUFFERED_SAMPLE)
    s.accepted = 0.0
    s.arrival = arrival


@cached_njit(error_model="numpy")
def nearest_inertial(memory: FilterMemory, imu: int, time_s: float) -> int:
    """Return the row in the buffer of the sample of an IMU nearest in time, -1 without one."""
    h = record(memory.history, HISTORY)
    nearest = -1
    gap_s = math.inf
    for k in range(h.samples):
        s = record(memory.samples[k], BUFFERED_SAMPLE)
        if s.sensor == imu and abs(s.time_s - time_s) < gap_s:
            nearest = k
            gap_s = abs(s.time_s - time_s)
    return nearest


@cached_njit(error_model="numpy")
def is_finite(row: FloatArray) -> bool:
    """Whether all entries of a row of samples that its sensor has are finite."""
    total = 0.0  # not finite if one of its terms is not
    for j in range(SENSOR_LENGTHS[int(row[SampleColumn.SENSOR])]):
        total += row[SampleColumn.FIRST + j] * 0.0
    return total == 0.0


@cached_njit(error_model="numpy")
def is_inertial(row: FloatArray) -> bool:
    """Whether a row of samples is of an IMU."""
    return SENSOR_KINDS[int(row[SampleColumn.SENSOR])] == SensorKind.INERTIAL


@cached_njit(error_model="numpy")
def forget_snapshots(memory: FilterMemory, oldest_s: float) -> None:
    """Drop every snapshot that another one before `oldest_s` follows."""
    h = record(memory.history, HISTORY)
    while h.snapshots > 1:
        following = record(snapshot_at(memory, 1), SNAPSHOT)
        if not following.time_s < oldest_s:
            break
        h.oldest = (h.oldest + 1) % (len(memory.snapshots) - 1)
        h.snapshots -= 1


@cached_njit(error_model="numpy")
def forget_samples(memory: FilterMemory, oldest_s: float, present: FloatArray) -> None:
    """Mark every sample as of an earlier update, and drop those before `oldest_s`.

    They are dropped many at a time. Until the start, the newest of each sensor stays. `present`
    (sensors,) is written: 1 for each sensor of which there is a sample, else 0.
    """
    h = record(memory.history, HISTORY)
    for sensor in range(SENSOR_COUNT):
        present[sensor] = 0.0
    for k in range(h.samples - 1, -1, -1):
        s = record(memory.samples[k], BUFFERED_SAMPLE)
        sensor = int(s.sensor)
        is_newest = h.snapshots == 0 and present[sensor] == 0.0
        s.arrival = _EARLIER if is_newest or s.time_s >= oldest_s else _OLD
        present[sensor] = 1.0
    if h.samples == 0:
        return
    quarter = record(memory.samples[h.samples // 4], BUFFERED_SAMPLE)
    if h.snapshots > 0 and quarter.arrival == _EARLIER:
        return
    count = 0
    for k in range(h.samples):
        s = record(memory.samples[k], BUFFERED_SAMPLE)
        if s.arrival == _EARLIER:
            copy_row(memory.samples[k], memory.samples[count])
            count += 1
    h.samples = count


@cached_njit(error_model="numpy")
def forget_commands(memory: FilterMemory, parameters: FloatArray, oldest_s: float) -> None:
    """Drop the commands that act no more after `oldest_s`, the longest dead time counted."""
    h = record(memory.history, HISTORY)
    longest_s = 0.0
    for j in range(INPUTS):
        longest_s = max(longest_s, parameters[VehicleParameter.DEAD_TIME_T + j])
    count = 0
    for k in range(h.commands):
        if memory.commands[k, END] >= oldest_s - longest_s:
            copy_row(memory.commands[k], memory.commands[count])
            count += 1
    h.commands = count
