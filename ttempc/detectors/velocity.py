"""Detector of positions that drift from the velocity which the same receivers measure.

A receiver finds its velocity by Doppler or by differences of the carrier phase, whatever the base
station, the ambiguities and the reference frame do to its positions.
"""

import math
from typing import Final

import numpy as np

from ..layout import FLOAT, AlarmColumn, SampleColumn
from ..sensors import GNSS_OF_BODY, VELOCITY_OF_BODY
from ..types import FloatArray
from .board import Record, TickData, has_alarm
from .history import kernel
from .table import DetectorIndex

_TRACK: Final = np.dtype(
    [
        ("time_s", "f8"),  # of the last velocity, NaN: none yet
        ("spacing_s", "f8"),  # from the velocity before to the last one
        ("velocity", "f8", 2),  # last one [m/s], east and north
        ("change", "f8", 2),  # from the one before
        ("moved", "f8", 2),  # integral of the velocities [m]
        ("count", "f8"),  # of the changes of the change
        ("variance", "f8"),  # of the white part of a velocity, from these [m^2/s^2]
        ("stated_sd", "f8"),  # by the receiver [m/s]; 0: it states none
        ("difference", "f8", 2),  # position less `moved` at this tick [m]
        ("known", "f8"),  # whether there is a difference at this tick
        ("origin", "f8", 2),  # of the differences [m]
        ("used", "f8"),  # whether it was used at the tick before
    ]
)
"""Velocity and position of one receiver."""

_ONSET: Final = np.dtype(
    [
        ("age_s", "f8"),  # since the assumed begin of a drift, -1: not in use
        ("signature", "f8", 2),  # effect of a unit drift on the error of the filter's state
        ("information", "f8"),  # about the drift [s^2/m^2]
        ("evidence", "f8", 2),  # for a drift east and north [s/m]
    ]
)
"""Hypothesis that a drift began at one moment."""

_ONSETS: Final = 60
_EVERY_S: Final = 2.0  # from one onset to the next: the longest window is 120 s

VELOCITY: Final = np.dtype(
    [
        ("receivers", _TRACK, 2),
        ("wander_mps", "f8"),  # standard deviation of the common slow part of the velocities
        ("time_s", "f8"),  # of the last step of the filter, NaN: none yet
        ("state", "f8", (2, 2)),  # axis; mean difference [m], common wander [m/s]
        ("covariance", "f8", (2, 2)),  # of either axis
        ("misfit", "f8"),  # mean normalised squared innovation of an axis
        ("steps", "f8"),  # in that mean
        ("rejected", "f8"),  # innovations beyond the gate in succession
        ("onsets", _ONSET, _ONSETS),
        ("next_onset", "f8"),  # number of the onset that is replaced next
        ("likeliest", "f8"),  # number of the onset with the largest ratio
        ("next_s", "f8"),  # time until then [s]
    ]
)
"""Memory of the detector."""

WANDER_S: Final = 60.0  # its correlation time; assumed

_UNSTATED_SD_MPS: Final = 0.05  # of a velocity whose receiver states none
_LIVES: Final = 0.6  # least share of the stated deviation in the noise of a measured velocity
_LEAST_SD_MPS: Final = 0.003  # of the noise of a measured velocity
_SEEN: Final = 25.0  # velocities before the first judgement; assumed
_USUAL: Final = 400.0  # of the means of variance and misfit, in samples
_WALK_M: Final = 0.005  # of slow errors of the positions [m/sqrt(s)]; assumed
_WHITE_M: Final = 0.01  # least standard deviation of the white part of a position; assumed
_LONGEST_GAP_S: Final = 1.0
_SAME_MOMENT_S: Final = 0.3  # between a position and the velocity that belongs to it
_JITTER_S: Final = 0.03  # of stamps that do not run late; assumed
_GATE: Final = 6.0  # standard deviations of an innovation that is taken for an outlier
_OUTLIERS: Final = 3.0  # in succession that are no outliers
_LARGEST_MISFIT: Final = 8.0  # that one step adds
_FASTEST_MPS: Final = 0.3  # standard deviation of a drift; assumed
_LEAST_AGE_S: Final = 1.5  # of an onset that is judged
_CONTRADICTS: Final = 4.0  # logarithm of how much less likely a drift is than none; assumed


def new_velocity(wander_mps: float) -> FloatArray:
    """Return a record `VELOCITY` before the first sample, flat.

    Args:
        wander_mps: standard deviation of the slow part of a velocity that receivers share.
    """
    flat = np.zeros(VELOCITY.itemsize // 8)
    memory = flat.view(VELOCITY)[0]
    memory["receivers"]["time_s"] = math.nan
    memory["wander_mps"] = wander_mps
    memory["time_s"] = math.nan
    memory["onsets"]["age_s"] = -1.0
    return flat


@kernel
def observe_velocity(
    memory: Record, board: Record, data: TickData, clocks: Record, position_sd: float
) -> None:
    """Compare the positions with the integral of the velocities, by both receivers together.

    With positions p and velocities v of the receivers, the mean z of p less the integral of v has
    no trend but that of the slow error b of the velocities, which receivers share, and walks by
    their white error. Of each axis, with a time T and white noises q, s, e,

        r <- r + b T + q,   b <- exp(-T / 60 s) b + s,   z = r + e.

    A drift w of the positions from a time t0 on adds w (t - t0) to z. The statistic is the largest
    generalised likelihood ratio (Willsky and Jones 1976, IEEE TAC 21, 108-112) over onsets t0 of
    the last 120 s: with innovations u of variance S, and the effect g of a unit drift on u,

        C = sum(g^2 / S),   d = sum(g u / S),   J = |d|^2 / (C + 1 / w_0^2) / max(1, misfit).

    The misfit is the mean of u^2 / S. It covers noise that is larger than stated.

    Above a first limit the vehicle slows down, above a second one it stops until `resume`. While it
    is slow the likeliest onset stays, so that the alarm ends where its own drift is contradicted.

    A delay v d of the positions grows where their stamps run late by d: it is a matter of `clock`,
    whose lateness is taken off the stamps.

    A receiver whose velocities lack noise derives them from its positions, or holds them: it is
    not used. Not seen is what moves velocity and position alike, a coherent spoofer, nor a base
    that is wrong and stands still.

    Args:
        memory: record `VELOCITY`.
        board: record `BOARD`.
        data: of the tick.
        clocks: records `CLOCK` by `SensorIndex`, after this tick.
        position_sd: of the white noise of the positions [m].
    """
    if has_alarm(board, DetectorIndex.VELOCITY_SURE):
        return  # both statistics stay
    newest_s = math.nan
    for body in range(2):
        track = memory.receivers[body]
        _integrate(track, data.rows, VELOCITY_OF_BODY[body])
        late_s = clocks[GNSS_OF_BODY[body]].late_s
        time_s = _compare(track, board, data.rows, GNSS_OF_BODY[body], late_s)
        if not time_s <= newest_s and not math.isnan(time_s):
            newest_s = time_s
    if math.isnan(newest_s):
        return

    step_s = newest_s - memory.time_s
    if math.isnan(step_s) or step_s > _LONGEST_GAP_S:
        _restart(memory)
    elif step_s > 0.0:
        _predict(memory, step_s)
        _replace_onset(memory, step_s, has_alarm(board, DetectorIndex.VELOCITY))
    else:
        return
    memory.time_s = newest_s
    _correct(memory, position_sd)
    _judge(memory, board)


@kernel
def confirms(memory: Record) -> bool:
    """Return whether positions and velocities of a receiver were compared, and agree so far."""
    compared = memory.receivers[0].used + memory.receivers[1].used > 0.0
    return compared and memory.rejected == 0.0


@kernel
def contradicts_drift(memory: Record, drift_mps: FloatArray, age_s: float) -> bool:
    """Return whether the velocities make a drift of the positions far less likely than none.

    They do not where none was compared yet. With C, d and the misfit as in `observe_velocity`, of
    the onset that is nearest in age, the logarithm of the ratio of both likelihoods is

        (w' d - C |w|^2 / 2) / max(1, misfit).

    Args:
        memory: record `VELOCITY`.
        drift_mps: east and north [m/s], w.
        age_s: time for which it has acted.
    """
    nearest = -1
    nearest_s = math.inf
    for n in range(_ONSETS):
        onset_s = memory.onsets[n].age_s
        if onset_s >= 0.0 and abs(onset_s - age_s) < nearest_s:
            nearest = n
            nearest_s = abs(onset_s - age_s)
    if nearest < 0:
        return False
    onset = memory.onsets[nearest]
    square = drift_mps[0] ** 2 + drift_mps[1] ** 2
    agrees = drift_mps[0] * onset.evidence[0] + drift_mps[1] * onset.evidence[1]
    ratio = (agrees - 0.5 * onset.information * square) / max(1.0, memory.misfit)
    return ratio < -_CONTRADICTS


@kernel
def compares_both(memory: Record) -> bool:
    """Return whether the positions of both receivers are compared with their velocities."""
    return min(memory.receivers[0].used, memory.receivers[1].used) > 0.0


@kernel
def has_new_offset(memory: Record) -> bool:
    """Return whether both receivers had a position at this tick."""
    return min(memory.receivers[0].known, memory.receivers[1].known) > 0.0


@kernel
def offset_from_velocity(memory: Record, axis: int) -> float:
    """Return the mean position less the mean integral of the velocities, along an axis [m]."""
    total = 0.0
    for body in range(2):
        track = memory.receivers[body]
        total += track.difference[axis] - track.origin[axis]
    return 0.5 * total


@kernel
def offset_sd(memory: Record, position_sd: float, mean_of: float, apart_s: float) -> float:
    """Return the deviation of a difference of two means of offsets, along an axis [m].

    Each is the mean of `mean_of` offsets of both receivers; they are `apart_s` apart.
    """
    white_sd = min(max(position_sd, _WHITE_M), 1.0)
    of_positions = 2.0 * white_sd**2 / (2.0 * mean_of)
    return math.sqrt(of_positions + _walk_variance(memory, apart_s))


@kernel
def _integrate(track: Record, rows: FloatArray, sensor: int) -> None:
    """Add the velocities of a tick to their integral, by trapezia, and learn their noise."""
    for row in range(len(rows)):
        sample = rows[row]
        if sample[SampleColumn.SENSOR] != sensor:
            continue
        east = sample[SampleColumn.FIRST]
        north = sample[SampleColumn.SECOND]
        span_s = sample[SampleColumn.TIME_S] - track.time_s
        if not math.isfinite(east + north) or span_s <= 0.0:
            continue
        is_first = not span_s <= _LONGEST_GAP_S
        if not is_first:
            track.spacing_s = span_s
            _learn_noise(track, east - track.velocity[0], north - track.velocity[1])
            track.moved[0] += 0.5 * span_s * (east + track.velocity[0])
            track.moved[1] += 0.5 * span_s * (north + track.velocity[1])
        else:
            track.used = 0.0
        track.time_s = sample[SampleColumn.TIME_S]
        track.velocity[0] = east
        track.velocity[1] = north
        track.stated_sd = sample[SampleColumn.THIRD]


@kernel
def _learn_noise(track: Record, east: float, north: float) -> None:
    """Take in a change of the velocity [m/s]: a second difference has six times the variance."""
    square = (east - track.change[0]) ** 2 + (north - track.change[1]) ** 2
    track.count = min(track.count + 1.0, _USUAL)
    track.variance += (square / 12.0 - track.variance) / track.count
    track.change[0] = east
    track.change[1] = north


@kernel
def lives(track: Record) -> bool:
    """Return whether a receiver measures its velocity: it has the noise of a measurement."""
    least = max(_LIVES * track.stated_sd, _LEAST_SD_MPS)
    return track.count >= _SEEN and track.variance >= least**2


@kernel
def _compare(track: Record, board: Record, rows: FloatArray, sensor: int, late_s: float) -> float:
    """Write the last position of a tick less the integral; return its time, NaN without one.

    `late_s` is how far its stamps run late; what jitter makes of it is left.
    """
    runs_late_s = math.copysign(max(0.0, abs(late_s) - _JITTER_S), late_s)
    found_s = math.nan
    track.known = 0.0
    if board.excluded[sensor] > 0.0 or not lives(track):
        track.used = 0.0
        return found_s
    for row in range(len(rows)):
        sample = rows[row]
        if sample[SampleColumn.SENSOR] != sensor:
            continue
        later_s = sample[SampleColumn.TIME_S] - track.time_s
        ahead_s = later_s - runs_late_s
        x = sample[SampleColumn.FIRST] - track.moved[0] - ahead_s * track.velocity[0]
        y = sample[SampleColumn.SECOND] - track.moved[1] - ahead_s * track.velocity[1]
        if sample[SampleColumn.THIRD] == FLOAT:
            track.used = 0.0  # the fix that follows may lie elsewhere
        elif abs(later_s) <= _SAME_MOMENT_S and math.isfinite(x + y):
            track.difference[0] = x
            track.difference[1] = y
            track.known = 1.0
            found_s = sample[SampleColumn.TIME_S]
    return found_s


@kernel
def _restart(memory: Record) -> None:
    """Begin anew after a gap: nothing is known of the time in it."""
    memory.state[:] = 0.0
    memory.covariance[:] = 0.0
    memory.covariance[1, 1] = memory.wander_mps**2
    memory.rejected = 0.0
    memory.next_s = 0.0
    for n in range(_ONSETS):
        memory.onsets[n].age_s = -1.0
    for body in range(2):
        memory.receivers[body].used = 0.0


@kernel
def _predict(memory: Record, step_s: float) -> None:
    """Predict the state and the effects of all onsets by a time."""
    stays = math.exp(-step_s / WANDER_S)
    for axis in range(2):
        memory.state[axis, 0] += step_s * memory.state[axis, 1]
        memory.state[axis, 1] *= stays

    p = memory.covariance
    p[0, 0] += step_s * (2.0 * p[0, 1] + step_s * p[1, 1]) + _walk_variance(memory, step_s)
    p[0, 1] = stays * (p[0, 1] + step_s * p[1, 1])
    p[1, 0] = p[0, 1]
    p[1, 1] = stays**2 * p[1, 1] + (1.0 - stays**2) * memory.wander_mps**2

    for n in range(_ONSETS):
        onset = memory.onsets[n]
        if onset.age_s >= 0.0:
            onset.age_s += step_s
            onset.signature[0] += step_s * (1.0 + onset.signature[1])
            onset.signature[1] *= stays


@kernel
def _replace_onset(memory: Record, step_s: float, keeps: bool) -> None:
    """Assume every two seconds that a drift begins, in place of the oldest onset.

    `keeps` says that the likeliest one stays.
    """
    memory.next_s -= step_s
    if memory.next_s > 0.0:
        return
    memory.next_s = _EVERY_S
    if keeps and memory.next_onset == memory.likeliest:
        memory.next_onset = (memory.next_onset + 1.0) % _ONSETS
    onset = memory.onsets[int(memory.next_onset)]
    memory.next_onset = (memory.next_onset + 1.0) % _ONSETS
    onset.age_s = 0.0
    onset.signature[:] = 0.0
    onset.information = 0.0
    onset.evidence[:] = 0.0


@kernel
def _walk_variance(memory: Record, step_s: float) -> float:
    """Return the variance by which the mean difference walks in a time [m^2]."""
    total = 0.0
    receivers = 0
    for body in range(2):
        track = memory.receivers[body]
        if track.known > 0.0:
            receivers += 1
            total += max(track.variance, _LEAST_SD_MPS**2) * track.spacing_s
    if not receivers:
        return _UNSTATED_SD_MPS**2 * step_s
    return (total / receivers**2 + _WALK_M**2) * step_s


@kernel
def _correct(memory: Record, position_sd: float) -> None:
    """Correct the state and all onsets by the mean difference of the receivers."""
    mean_x = 0.0
    mean_y = 0.0
    receivers = 0
    anchor = False
    for body in range(2):
        track = memory.receivers[body]
        receivers += int(track.known)
        anchor = anchor or track.known != track.used
    if not receivers:
        return
    for body in range(2):
        track = memory.receivers[body]
        if anchor:  # the mean of other receivers goes on from where it was
            track.origin[0] = track.difference[0] - memory.state[0, 0]
            track.origin[1] = track.difference[1] - memory.state[1, 0]
        track.used = track.known
        if track.known > 0.0:
            mean_x += (track.difference[0] - track.origin[0]) / receivers
            mean_y += (track.difference[1] - track.origin[1]) / receivers

    p = memory.covariance
    white_sd = min(max(position_sd, _WHITE_M), 1.0)
    variance = p[0, 0] + white_sd**2 / receivers
    x = mean_x - memory.state[0, 0]
    y = mean_y - memory.state[1, 0]
    if max(abs(x), abs(y)) > _GATE * math.sqrt(variance) and memory.rejected < _OUTLIERS:
        memory.rejected += 1.0
        return
    memory.rejected = 0.0
    _take_innovation(memory, x, y, variance)


@kernel
def _take_innovation(memory: Record, x: float, y: float, variance: float) -> None:
    """Take the innovations of both axes [m], of one variance [m^2], into state and onsets."""
    misfit = min(0.5 * (x * x + y * y) / variance, _LARGEST_MISFIT)
    memory.steps = min(memory.steps + 1.0, _USUAL)
    memory.misfit += (misfit - memory.misfit) / memory.steps

    p = memory.covariance
    gain = p[0, 0] / variance
    gain_of_wander = p[0, 1] / variance
    memory.state[0, 0] += gain * x
    memory.state[1, 0] += gain * y
    memory.state[0, 1] += gain_of_wander * x
    memory.state[1, 1] += gain_of_wander * y
    p[1, 1] -= gain_of_wander * p[0, 1]
    p[0, 1] -= gain * p[0, 1]
    p[0, 0] -= gain * p[0, 0]
    p[1, 0] = p[0, 1]

    for n in range(_ONSETS):
        onset = memory.onsets[n]
        if onset.age_s >= 0.0:
            effect = onset.signature[0]
            onset.information += effect * effect / variance
            onset.evidence[0] += effect * x / variance
            onset.evidence[1] += effect * y / variance
            onset.signature[0] -= gain * effect
            onset.signature[1] -= gain_of_wander * effect


@kernel
def _judge(memory: Record, board: Record) -> None:
    """Write the statistic, and of the likeliest onset the drift and how far it has gone."""
    largest = 0.0
    drift_mps = 0.0
    age_s = 0.0
    scale = max(1.0, memory.misfit)
    for n in range(_ONSETS):
        onset = memory.onsets[n]
        if onset.age_s < _LEAST_AGE_S:
            continue
        information = onset.information + 1.0 / _FASTEST_MPS**2
        evidence = math.hypot(onset.evidence[0], onset.evidence[1])
        ratio = evidence * evidence / information / scale
        if ratio > largest:
            largest = ratio
            drift_mps = evidence / information
            age_s = onset.age_s
            memory.likeliest = n
    for index in (DetectorIndex.VELOCITY, DetectorIndex.VELOCITY_SURE):
        board.statistic[index] = largest
        board.residual[index] = largest
        board.proposed[index, AlarmColumn.FIRST] = 100.0 * drift_mps
        board.proposed[index, AlarmColumn.SECOND] = drift_mps * age_s
