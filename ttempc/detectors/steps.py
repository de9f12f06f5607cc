"""Detector of steps that both receivers make together: stairs, and a jump that is not large."""

import math
from typing import Final

import numpy as np

from ..layout import AlarmColumn
from ..types import FloatArray
from .board import Record, TickData, has_alarm
from .history import kernel
from .table import DetectorIndex
from .velocity import compares_both, has_new_offset, offset_from_velocity, offset_sd

_KEPT: Final = 8  # positions: 1.4 s at five a second

STEPS: Final = np.dtype(
    [
        ("by_velocity", "f8"),  # 1: offsets are from the velocities of GNSS, 0: dead reckoning
        ("time_s", "f8"),  # of the newest offset from dead reckoning
        ("offsets", "f8", (_KEPT, 2)),  # of both positions [m], newest last
        ("filled", "f8"),  # number of offsets
        ("usual", "f8", 2),  # mean difference of offsets a second apart [m]
        ("wait", "f8"),  # positions until the difference with the peak has left, 0: no peak waits
        ("peak", "f8", 2),  # largest difference since the last step [m]
        ("sum", "f8", 2),  # of the steps [m]
    ]
)
"""Memory of the detector."""

_SETTLES_S: Final = 12.0  # while the coefficients of slips are learnt
_LATEST_S: Final = 0.5  # age of a position whose offset from dead reckoning is used
_MEAN_OF: Final = 3  # offsets in a mean
_PASSES: Final = 5.0  # positions until a step has left the differences
_USUAL: Final = 0.01  # share of a new difference in the usual one
_NOISE_M: Final = 0.045  # of a difference on even ground
_USUAL_SD_M: Final = 0.03  # of the white noise of a position for which this holds
_ROUGH_M: Final = 0.010  # that a roughness of 1 adds
_MANY: Final = 3.0  # sensors that contradict the estimate at a time
_MANY_NOISE: Final = 5.0  # times the noise then; assumed
_MEMORY_S: Final = 180.0  # in which the sum of steps fades; assumed
_FOUND_M: Final = 0.32  # sum of steps from dead reckoning that is a fault; by hand
# Sum of steps from velocities that is one, and how many deviations the noise of a difference counts
# for. They find 70 of 75 drawn stairs, and come to 0.63 of the bound in five hours without a fault;
# 2.5 deviations find all, and white noise of 0.1 m comes to its bound in ten minutes (seeds 9101 to
# 9103, 9202)
_FOUND_BY_VELOCITY_M: Final = 0.12
_SIGMAS: Final = 3.0
_NOISES: Final = 2.0  # times that noise is the bound of receivers noisier than 3 cm
_APART_S: Final = 1.0  # of the means in a difference


@kernel
def observe_steps(
    memory: Record,
    drift: Record,
    velocity: Record,
    board: Record,
    data: TickData,
    roughness: float,
    position_sd: float,
    contradicting: float,
) -> None:
    """Add up the steps that both receivers make within a second.

    Their offset is that from the integral of the velocities which they measure; without these it is
    that from dead reckoning. The difference of the mean offset in the last 0.6 s and a second
    before is taken less its usual value, that of slopes and slips. A step leaves the differences
    after a second; what stays of it then is a rate, such as that of a wrong encoder or of a drift.
    Of each peak s that exceeds the noise n, and of the share p that has stayed,

        S <- exp(-T / 180 s) S + (1 - p) s max(0, 1 - n^2 / |s|^2).

    The statistic is |S| over its bound: stairs in one direction add up, bumps go back. The alarm
    stands until `resume`, since a step that lasts is no less wrong than a new one.

    Args:
        memory: record `STEPS`.
        drift: record `DRIFT`, whose dead reckoning is used.
        velocity: record `VELOCITY`, whose offsets are used where there are any.
        board: record `BOARD`.
        data: of the tick.
        roughness: mean of the learnt factor of roughness.
        position_sd: of the white noise of the positions [m].
        contradicting: number of sensors that contradict the estimate. Steps make both receivers do
            so, and no other sensor: with a third one it is the noise that has grown.
    """
    index = DetectorIndex.STEPS
    if has_alarm(board, index) or not data.span_s > 0.0:
        return
    fading = math.exp(-min(data.span_s, _MEMORY_S) / _MEMORY_S)
    memory.sum[0] *= fading
    memory.sum[1] *= fading

    by_velocity = compares_both(velocity)
    if by_velocity != (memory.by_velocity > 0.0):
        _forget(memory)
        memory.usual[:] = 0.0
        memory.sum[:] = 0.0  # steps of one source are not held to the bound of the other
        memory.by_velocity = 1.0 if by_velocity else 0.0
    bound_m = _FOUND_M
    white = min(position_sd, 1.0) / _USUAL_SD_M
    noise_m = max(1.0, white) * _NOISE_M + _ROUGH_M * math.sqrt(max(roughness, 0.0))
    if by_velocity:
        noise_m = _SIGMAS * offset_sd(velocity, position_sd, _MEAN_OF, _APART_S)
        bound_m = max(_FOUND_BY_VELOCITY_M, _NOISES * noise_m)
    if contradicting >= _MANY:
        noise_m *= _MANY_NOISE

    if data.now < _SETTLES_S:
        _forget(memory)
    elif by_velocity:
        if has_new_offset(velocity):
            x = offset_from_velocity(velocity, 0)
            y = offset_from_velocity(velocity, 1)
            _take_offset(memory, x, y, noise_m)
    else:
        _take_dead_reckoning(memory, drift, data.now, noise_m)
    length = math.hypot(memory.sum[0], memory.sum[1])
    board.statistic[index] = length / bound_m
    board.residual[index] = length
    board.proposed[index, AlarmColumn.FIRST] = length


@kernel
def _forget(memory: Record) -> None:
    """Begin anew with the differences; the sum of steps stays."""
    memory.filled = 0.0
    memory.wait = 0.0
    memory.peak[:] = 0.0


@kernel
def _take_dead_reckoning(memory: Record, drift: Record, now: float, noise_m: float) -> None:
    """Take in the mean offset of both positions from dead reckoning, once for each position."""
    tractor = drift.receivers[0]
    trailer = drift.receivers[1]
    time_s = tractor.last[0]
    if time_s != trailer.last[0] or not time_s > now - _LATEST_S:
        _forget(memory)
    elif time_s != memory.time_s:
        memory.time_s = time_s
        x = 0.5 * (tractor.offset[0] + trailer.offset[0])
        y = 0.5 * (tractor.offset[1] + trailer.offset[1])
        _take_offset(memory, x, y, noise_m)


@kernel
def _take_offset(memory: Record, x: float, y: float, noise_m: float) -> None:
    """Take in an offset, and the peaks of the differences."""
    offsets = memory.offsets
    for row in range(_KEPT - 1):
        offsets[row, 0] = offsets[row + 1, 0]
        offsets[row, 1] = offsets[row + 1, 1]
    offsets[_KEPT - 1, 0] = x
    offsets[_KEPT - 1, 1] = y
    memory.filled = min(memory.filled + 1.0, float(_KEPT))
    if memory.filled < _KEPT:
        return
    if memory.wait > 1.0:
        memory.wait -= 1.0
        return

    step_x = _difference(offsets, 0) - memory.usual[0]
    step_y = _difference(offsets, 1) - memory.usual[1]
    length = math.hypot(step_x, step_y)
    if memory.wait > 0.0:
        memory.wait = 0.0
        _add_step(memory, step_x, step_y, noise_m)
    limited = _USUAL * min(1.0, noise_m / max(length, 1e-9))
    memory.usual[0] += limited * step_x
    memory.usual[1] += limited * step_y

    # A step grows in the differences, stays and leaves them: it counts where it was largest
    peak_m = math.hypot(memory.peak[0], memory.peak[1])
    if length < peak_m and peak_m > noise_m:
        memory.wait = _PASSES
    else:
        memory.peak[0] = step_x
        memory.peak[1] = step_y


@kernel
def _add_step(memory: Record, after_x: float, after_y: float, noise_m: float) -> None:
    """Add the step of the peak to the sum, without what has stayed of it after it has passed."""
    peak_m = math.hypot(memory.peak[0], memory.peak[1])
    stayed_m = (after_x * memory.peak[0] + after_y * memory.peak[1]) / peak_m
    stayed = min(1.0, stayed_m / peak_m) if stayed_m > noise_m else 0.0
    share = (1.0 - stayed) * max(0.0, 1.0 - (noise_m / peak_m) ** 2)
    memory.sum[0] += share * memory.peak[0]
    memory.sum[1] += share * memory.peak[1]
    memory.peak[:] = 0.0


@kernel
def _difference(offsets: FloatArray, axis: int) -> float:
    """Return the mean of the newest offsets along an axis less that of the oldest ones [m]."""
    total = 0.0
    for n in range(_MEAN_OF):
        total += offsets[_KEPT - 1 - n, axis] - offsets[n, axis]
    return total / _MEAN_OF
