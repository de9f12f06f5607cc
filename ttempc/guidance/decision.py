"""Decision of a supervisor at a tick: drive, slow down, hold, stop."""

import math
from typing import Any, Final

from ..detectors.interface import Reaction
from ..jit import cached_njit, record
from ..layout import ESTIMATE, TICK, AlarmColumn, BodyError
from ..types import FloatArray, State
from .safety import (
    ALARM_HELD,
    BESIDE,
    DRIVE,
    FAR,
    GUARD,
    HOLD,
    LOST,
    NO_COMMAND,
    NO_ESTIMATE,
    NOT_FINITE,
    NOT_STARTED,
    ON_PATH,
    POSITION_LOST,
    SAFETY,
    STOP,
    TURNED,
    UNCERTAIN,
    WAYS_TO_BE_LOST,
    SupervisedReference,
)

Record = Any
"""Record of a compiled call: fields by name, as `ttempc.jit.record` returns it."""

_STANDING_MPS: Final = 0.05  # largest speed of a vehicle that stands
_ALARM_FREE_S: Final = 2.0  # before a vehicle that stands drives on; assumed
# A vehicle whose alarm has its cause in driving, as spinning wheels, must not stop and start for
# ever: after so many restarts a stop is for good.
_RESTARTS: Final = 1
_FORGOTTEN_S: Final = 60.0  # of driving after which the restarts count anew; assumed
_UP_TO_SPEED: Final = 0.8  # share of the reference's speed from which on it waits no more; assumed
_RUN_AWAY_M: Final = 0.5  # by which a vehicle leaves a reference that would wait behind; assumed
_MARGIN_M: Final = 0.5  # beside what a line acquisition needs; assumed
_MARGIN_YAW: Final = math.radians(30.0)  # for a trailer that is turned first; assumed
_DELAY_S: Final = 1.0  # until the steering turns a vehicle back; assumed
_TRAILER_FIRST: Final = 3.0  # times the margin in reverse, where the trailer leads; assumed
_TRAILER_DELAY: Final = 2.0  # times the delay; assumed
_TURN: Final = math.tau
_OF_A_BODY: Final = 3  # columns of `BodyError` of a body: the trailer's follow the tractor's
_SLOW: Final = float(Reaction.SLOW)
_STOP_ON_PATH: Final = float(Reaction.STOP_ON_PATH)
_STOP: Final = float(Reaction.STOP)

_kernel: Final = cached_njit(error_model="numpy", nogil=True, _nrt=False, no_rewrites=True)


@_kernel
def decide_mode(
    sample: int,
    now: float,
    fresh: bool,
    estimate: FloatArray,
    alarms: FloatArray,
    reference: SupervisedReference,
    guard: FloatArray,
    tick: FloatArray,
) -> int:
    """Begin the record `tick` and return the mode of this tick.

    Args:
        sample: of the reference with which the estimate is compared.
        now: present time on the clock of the estimate [s].
        fresh: whether there is an estimate since the last step.
        estimate: record `ESTIMATE`.
        alarms: rows (m, `ALARM`) of the detectors.
        reference: with the limits of the vehicle and of safety.
        guard: record `GUARD`.
        tick: record `TICK`.
    """
    e = record(estimate, ESTIMATE)
    g = record(guard, GUARD)
    t = record(tick, TICK)
    safety = record(reference.safety, SAFETY)
    tick[:] = 0.0
    _begin_tick(t, sample)

    if math.isnan(g.finite_s):
        g.finite_s = now
    if not (fresh and _is_finite(e)):
        _bridge(g, t, fresh, now - g.finite_s <= safety.blind_s)
        return int(t.mode)
    g.started = 1.0
    g.finite_s = now

    _write_body_error(t.tracking, e, reference, sample)
    _note_jump(g, t, safety, reference)
    _widen_limits(g, t.tracking, safety, reference)
    _find_lost(g, t.tracking, safety)

    if e.position_seen != 0.0:
        g.gnss_s = e.time_s
    outage_s = now - (e.time_s if math.isnan(g.gnss_s) else g.gnss_s)
    deviation_m = _position_deviation(e)
    speed = e.state[State.V]
    reaction = _strongest_reaction(g, alarms, now, speed)

    _choose_mode(g, t, safety, reference.gear, outage_s, deviation_m, reaction)
    _let_reference_wait(g, t, reference, sample, speed)
    if t.reason != 0.0 or t.jump_m != 0.0 or _any_alarm(alarms):
        t.fallback = 1.0
    for i in range(3):
        if reference.beyond[sample, i]:
            t.fallback = 1.0
    return int(t.mode)


@_kernel
def _begin_tick(t: Record, sample: int) -> None:
    """Write NaN where a controller may write nothing."""
    t.sample = sample
    t.tracking[:] = math.nan
    t.tube[:] = math.nan
    t.solver.accepted = math.nan
    t.solver.iterations = math.nan
    t.solver.primal_residual = math.nan
    t.solver.dual_residual = math.nan
    t.solver.status = math.nan
    t.expected.slip_i = math.nan
    t.expected.share = math.nan


@_kernel
def _is_finite(e: Record) -> bool:
    """Return whether what an estimate has of the vehicle is finite."""
    total = e.hitch_angle + e.trailer_xy[0] + e.trailer_xy[1]
    for i in range(len(e.state)):
        total += e.state[i]
    for i in range(len(e.disturbance)):
        total += e.disturbance[i]
    for i in range(len(e.map_disturbance)):
        total += e.map_disturbance[i]
    return math.isfinite(total)


@_kernel
def _bridge(g: Record, t: Record, fresh: bool, holds: bool) -> None:
    """Hold the last command without an estimate for a short time, then stop."""
    g.body_error[0] = math.nan
    t.fallback = 1.0
    t.reason = NOT_FINITE if fresh else NO_ESTIMATE
    if fresh and g.started == 0.0:
        t.reason = NOT_STARTED
    if holds:
        t.mode = HOLD
        return
    t.mode = STOP
    t.stopping = 1.0
    t.waits = 1.0
    g.waiting = 1.0


@_kernel
def _write_body_error(
    error: FloatArray, e: Record, reference: SupervisedReference, sample: int
) -> None:
    """Write the body error, see `BodyError`: the reference in the frame of each body.

    With the positions p and the yaw psi of a body, and those of its reference with an index r,

        (x, y) = R(psi)' (p_r - p),   psi_r - psi wrapped to half a turn,   v_r - v.
    """
    state = reference.state[sample]
    _write_pose_error(
        error[BodyError.X_T :],
        state[State.X] - e.state[State.X],
        state[State.Y] - e.state[State.Y],
        state[State.PSI_T] - e.state[State.PSI_T],
        e.state[State.PSI_T],
    )
    _write_pose_error(
        error[BodyError.X_I :],
        reference.trailer_xy[sample, 0] - e.trailer_xy[0],
        reference.trailer_xy[sample, 1] - e.trailer_xy[1],
        state[State.PSI_I] - e.state[State.PSI_I],
        e.state[State.PSI_I],
    )
    error[BodyError.V] = state[State.V] - e.state[State.V]


@_kernel
def _write_pose_error(error: FloatArray, dx: float, dy: float, turned: float, yaw: float) -> None:
    """Write distances ahead and to the left and the wrapped yaw error of one body."""
    error[0] = math.cos(yaw) * dx + math.sin(yaw) * dy
    error[1] = math.cos(yaw) * dy - math.sin(yaw) * dx
    error[2] = turned - _TURN * math.floor(turned / _TURN + 0.5)


@_kernel
def _note_jump(g: Record, t: Record, safety: Record, reference: SupervisedReference) -> None:
    """Note a change of the tractor's error that speeds do not explain; keep the error.

    The vehicle is at most as fast as the reference and its speed error together, and the reference
    is no faster: both together change the error by twice as much at most.
    """
    error = t.tracking
    before = g.body_error
    if not math.isnan(before[0]):
        moved_m = math.hypot(
            error[BodyError.X_T] - before[BodyError.X_T],
            error[BodyError.Y_T] - before[BodyError.Y_T],
        )
        speed = abs(error[BodyError.V]) + reference.speed
        if not moved_m <= safety.jump_m + 2.0 * speed * reference.period_s:
            t.jump_m = moved_m
    for i in range(len(before)):
        before[i] = error[i]


@_kernel
def _widen_limits(
    g: Record, error: FloatArray, safety: Record, reference: SupervisedReference
) -> None:
    """Widen the limits for a vehicle that starts beside its path; as it comes in they shrink."""
    if g.lost != 0.0:
        return
    needed_m = _distance_allowance(error, reference, safety.cross_m)
    g.distance_allowance_m = min(g.distance_allowance_m, needed_m)
    turned = max(abs(error[BodyError.PSI_T]), abs(error[BodyError.PSI_I]))
    g.yaw_allowance = min(g.yaw_allowance, max(0.0, turned + _MARGIN_YAW - safety.yaw))


@_kernel
def _distance_allowance(error: FloatArray, reference: SupervisedReference, cross_m: float) -> float:
    """Return by how much a vehicle that turns back to its path may exceed `cross_m` [m].

    It is the larger one of the distances beside the path now and after the turn by which the
    leading body comes back: with the yaw error psi, the radius R and the time T until the steering
    acts, that turn needs

        R (1 - cos psi) + T v |sin psi|.

    In reverse the trailer leads.
    """
    body = 0
    margin_m = _MARGIN_M
    delay_s = _DELAY_S
    if reference.gear < 0.0:
        body = 1
        margin_m *= _TRAILER_FIRST
        delay_s *= _TRAILER_DELAY
    beside = error[_OF_A_BODY * body + BodyError.Y_T]
    turned = error[_OF_A_BODY * body + BodyError.PSI_T]
    depth = reference.radius * (1.0 - math.cos(turned))
    depth += delay_s * reference.speed * abs(math.sin(turned))
    after = abs(beside + math.copysign(depth, reference.gear * math.sin(turned)))
    farthest = max(abs(error[BodyError.Y_T]), abs(error[BodyError.Y_I]), after)
    return max(0.0, farthest + margin_m - cross_m)


@_kernel
def _find_lost(g: Record, error: FloatArray, safety: Record) -> None:
    """Note the first reason why the vehicle is lost: far from its reference, beside it, turned."""
    for body in range(2):
        x = error[_OF_A_BODY * body + BodyError.X_T]
        y = error[_OF_A_BODY * body + BodyError.Y_T]
        turned = error[_OF_A_BODY * body + BodyError.PSI_T]
        reason = LOST + WAYS_TO_BE_LOST * body
        if g.lost == 0.0 and math.hypot(x, y) > safety.distance_m + g.distance_allowance_m:
            g.lost = reason + FAR
        if g.lost == 0.0 and abs(y) > safety.cross_m + g.distance_allowance_m:
            g.lost = reason + BESIDE
        if g.lost == 0.0 and abs(turned) > safety.yaw + g.yaw_allowance:
            g.lost = reason + TURNED


@_kernel
def _position_deviation(e: Record) -> float:
    """Return the standard deviation of the tractor point along the worse axis of the map [m].

    It is at most a factor of sqrt(2) below that along the worse axis of the ellipse. The limits are
    for this one; the protection level of the detectors takes the ellipse.
    """
    variance = max(e.covariance[0, 0], e.covariance[1, 1])
    return math.sqrt(variance) if variance >= 0.0 else math.inf


@_kernel
def _any_alarm(alarms: FloatArray) -> bool:
    """Return whether any detector has an alarm."""
    found = False
    for row in range(len(alarms)):
        found |= alarms[row, AlarmColumn.REACTION] >= 0.0
    return found


@_kernel
def _strongest_reaction(g: Record, alarms: FloatArray, now: float, speed: float) -> float:
    """Return the strongest reaction that the alarms ask for, 0 (as `WARN`) without any.

    A stop is held, with the first alarm that asked for it, until the vehicle stands and no alarm
    has asked for two seconds. The second one within a minute of driving is held for good.
    """
    first = -1
    reaction = 0.0
    for row in range(len(alarms)):
        asked = alarms[row, AlarmColumn.REACTION]
        reaction = max(reaction, asked)
        if asked >= _STOP_ON_PATH and first < 0:
            first = row

    if first >= 0:
        _hold_stop(g, alarms[first], first, reaction, now)
    elif g.stop_alarm >= 0.0 and abs(speed) <= _STANDING_MPS and _may_restart(g, now):
        g.stop_alarm = -1.0
        g.restarts += 1.0
    return g.stop_reaction if g.stop_alarm >= 0.0 else reaction


@_kernel
def _may_restart(g: Record, now: float) -> bool:
    """Return whether a vehicle that stands may drive on after a stop."""
    return now - g.alarm_s >= _ALARM_FREE_S and g.restarts < _RESTARTS


@_kernel
def _hold_stop(g: Record, alarm: FloatArray, row: int, reaction: float, now: float) -> None:
    """Hold the stop of an alarm, the first one that asked for it."""
    if g.stop_alarm < 0.0:
        if now - g.alarm_s > _FORGOTTEN_S:
            g.restarts = 0.0
        g.stop_alarm = row
        g.stop_reaction = reaction
    if g.stop_alarm == row:
        for n in range(len(g.stop_numbers)):
            g.stop_numbers[n] = alarm[AlarmColumn.FIRST + n]
    g.stop_reaction = max(g.stop_reaction, reaction)
    g.alarm_s = now


@_kernel
def _choose_mode(
    g: Record,
    t: Record,
    safety: Record,
    gear: float,
    outage_s: float,
    deviation_m: float,
    reaction: float,
) -> None:
    """Write mode and reason: the first condition that holds, the worst first."""
    t.mode = STOP
    if g.lost != 0.0:  # in reverse a trailer would fold while the vehicle rolls out
        t.mode = ON_PATH if gear < 0.0 else STOP
        t.reason = g.lost
    elif g.unanswered_s > safety.blind_s:  # for good: the controller is not asked any more
        t.reason = NO_COMMAND
    elif reaction == _STOP:
        t.reason = ALARM_HELD
    elif outage_s > safety.gnss_outage_stop_s:
        t.reason = POSITION_LOST
    elif deviation_m > safety.uncertain_stop_m:
        t.reason = UNCERTAIN
    elif reaction == _STOP_ON_PATH:
        t.mode = ON_PATH
        t.reason = ALARM_HELD
    else:
        t.mode = DRIVE
        if outage_s > safety.gnss_outage_slow_s:
            t.reason = POSITION_LOST
        elif deviation_m > safety.uncertain_slow_m:
            t.reason = UNCERTAIN
        elif reaction == _SLOW:
            t.reason = ALARM_HELD
    if t.mode != DRIVE:
        t.stopping = 1.0


@_kernel
def _let_reference_wait(
    g: Record, t: Record, reference: SupervisedReference, sample: int, speed: float
) -> None:
    """Let the reference wait where it is ahead of a vehicle that is slowed down.

    It waits until the vehicle is up to speed again. Where it falls behind one that does not slow
    down, it leaves ticks out: that vehicle is steered along its path, not back to a place on it.
    """
    if t.reason != 0.0:
        g.waiting = 1.0
    elif abs(speed) >= _UP_TO_SPEED * abs(reference.state[sample, State.V]):
        g.waiting = 0.0
    turned = t.tracking[BodyError.PSI_T]
    along = t.tracking[BodyError.X_T] * math.cos(turned)
    along += t.tracking[BodyError.Y_T] * math.sin(turned)
    ahead_m = along * reference.gear
    t.waits = 1.0 if g.waiting != 0.0 and ahead_m >= 0.0 else 0.0
    t.hurries = 1.0 if g.waiting != 0.0 and ahead_m < -_RUN_AWAY_M else 0.0
