"""Decisions of the supervisor and limits of the command, on flat arrays."""

import math
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np

from ..errors import InvalidTuning
from ..jit import cached_njit
from ..layout import ESTIMATE, TICK
from ..types import FloatArray, Input
from .detection import Reaction

DRIVE: Final = 0
"""Mode: the controller drives, at half speed where there is a reason."""
ON_PATH: Final = 1
"""Mode: stop, and the controller steers."""
HOLD: Final = 2
"""Mode: the last command is held."""
STOP: Final = 3
"""Mode: stop, and hold the steering."""

NO_ESTIMATE: Final = 1
NOT_FINITE: Final = 2
LOST: Final = 3  # the tractor is too far off, beside, turned; the trailer likewise
ALARM_HELD: Final = 9
UNSEEN: Final = 10
UNCERTAIN: Final = 11
CORRIDOR: Final = 12

CUT_NOT_FINITE: Final = 1
CUT_RANGE: Final = 2
CUT_RATE: Final = 3

GUARD: Final = np.dtype(
    [
        ("sent", "f8", 3),  # the last command
        ("began", "f8"),  # whether the rate limits hold: a user's first command is free of them
        ("finite_s", "f8"),  # time of the last finite estimate, NaN: none
        ("seen_s", "f8"),  # time of the last accepted GNSS sample, NaN: none
        ("error", "f8", 7),  # z_e of the tick before, NaN: none
        ("lost", "f8"),  # reason of a stop for good
        ("overridden", "f8"),  # whether the last command was not the controller's
        ("waiting", "f8"),  # whether the reference waits where it is ahead
        ("held", "f8"),  # row of the alarm whose stop is held, -1: none
        ("held_numbers", "f8", 3),  # of that alarm
        ("held_kind", "f8"),  # reaction of that stop
        ("alarm_s", "f8"),  # time of the last alarm that asked for a stop
        ("restarts", "f8"),
    ]
)
"""Memory of the supervisor from tick to tick."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits at which a supervisor slows down and stops; all assumed.

    Without GNSS the filter `ekf` drifts by some decimetres in the time to `unseen_stop_s`: after
    10 s by 17 cm in the median and 40 cm at most, in the project's own simulated outages.

    Raises:
        InvalidTuning: a value is not above 0.

    Examples:
        >>> SafetyLimits(unseen_stop_s=6.0).unseen_stop_s
        6.0
    """

    unseen_slow_s: float = 10.4  # without an accepted GNSS sample, or age of the estimate
    unseen_stop_s: float = 12.0
    blind_s: float = 1.0  # without a finite estimate: hold the command so long, then stop
    uncertain_slow_m: float = 0.25  # standard deviation of the tractor point
    uncertain_stop_m: float = 0.50
    cross_m: float = 2.0  # cross-track error of either point
    distance_m: float = 4.0  # of either point from its reference
    yaw: float = math.radians(60.0)  # yaw error of either body [rad]
    jump_m: float = 0.3  # change of the error in one period beyond that of the speeds

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value > 0.0:
                raise InvalidTuning(f"{item.name}: got {value}, must be above 0")


SAFETY: Final = np.dtype([(item.name, "f8") for item in fields(SafetyLimits)])
"""Record of `SafetyLimits`."""


class Course(NamedTuple):
    """Constants of a supervisor along a reference of N ticks."""

    state: FloatArray  # (N, 7) of the reference
    trailer_xy: FloatArray  # (N, 2) [m]
    hp: FloatArray  # (N,) hydrostat position
    beyond: FloatArray  # (N,) 1 where the reference asks for more than the limits allow
    limits: FloatArray  # (3, 3) smallest and largest command, largest change in a period
    safety: FloatArray  # record `SAFETY`
    period_s: float
    speed: float  # largest one of the reference [m/s]
    gear: float  # 1, in reverse -1
    hold_back: FloatArray  # (3, 2) whole periods and rest [s] of inputs with a shorter dead time


_STANDING: Final = 0.05  # [m/s] largest speed of a vehicle that stands
_QUIET_S: Final = 2.0  # without an alarm before a vehicle that stands drives on; assumed
# Where the cause shows only while the vehicle drives, as with spinning wheels, it must not stop and
# start for ever.
_RESTARTS: Final = 1
_FORGOTTEN_S: Final = 60.0  # of driving after which the restarts count anew; assumed
_SLOW: Final = 0.5  # share of the reference's hydrostat position that is left at half speed
_UP_TO_SPEED: Final = 0.8  # share of the reference's speed from which on it waits no more; assumed
LAG_M: Final = 1.0  # behind the reference, up to which a corridor slows the vehicle down; assumed
_ROUNDING: Final = 1e-9  # an excess over a limit below this is not reported
_TURN: Final = math.tau
_SLOW_DOWN, _STOP_ON_PATH, _STOP = (
    float(Reaction.SLOW),
    float(Reaction.STOP_ON_PATH),
    float(Reaction.STOP),
)
_X_T, _Y_T, _PSI_T, _X_I, _Y_I, _PSI_I, _V = range(7)  # of the error


@cached_njit(error_model="numpy", nogil=True, _nrt=False, no_rewrites=True)
def decide(
    sample: int,
    now: float,
    fresh: bool,
    estimate: FloatArray,
    alarms: FloatArray,
    course: Course,
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
        guard: record `GUARD`.
    """
    e, g, t = estimate.view(ESTIMATE)[0], guard.view(GUARD)[0], tick.view(TICK)[0]
    safety, x = course.safety.view(SAFETY)[0], e.state
    tick[:] = 0.0
    t.sample = sample
    for i in range(11):
        t.tracking[i] = math.nan
    for i in range(20):
        t.tube[i] = math.nan
    for i in range(4):
        t.solver[i] = math.nan
    if math.isnan(g.finite_s):
        g.finite_s = now
    total = e.hitch_angle + e.trailer_xy[0] + e.trailer_xy[1]
    for i in range(7):
        total += x[i]
    for i in range(5):
        total += e.disturbance[i]
    for i in range(4):
        total += e.map_disturbance[i]
    if not (fresh and math.isfinite(total)):
        g.error[0], t.solver[4] = math.nan, 1.0
        t.reason = NOT_FINITE if fresh else NO_ESTIMATE
        if now - g.finite_s <= safety.blind_s:
            t.mode = HOLD
        else:
            t.mode, t.stopping, t.waits, g.waiting = STOP, 1.0, 1.0, 1.0
        return int(t.mode)
    g.finite_s = now
    error, r, jumped = t.tracking, course.state[sample], not math.isnan(g.error[0])
    for body in range(2):  # see `tracking_error`
        at, yaw = 3 * body, x[2 + body]
        dx, dy = r[0] - x[0], r[1] - x[1]
        if body == 1:
            dx = course.trailer_xy[sample, 0] - e.trailer_xy[0]
            dy = course.trailer_xy[sample, 1] - e.trailer_xy[1]
        error[at] = math.cos(yaw) * dx + math.sin(yaw) * dy
        error[at + 1] = math.cos(yaw) * dy - math.sin(yaw) * dx
        turned = r[2 + body] - yaw
        error[at + 2] = turned - _TURN * math.floor(turned / _TURN + 0.5)
    error[_V] = r[6] - x[6]
    if jumped:  # faster than the speeds explain
        moved = math.hypot(error[0] - g.error[0], error[1] - g.error[1])
        speed = abs(error[_V]) + course.speed
        if not moved <= safety.jump_m + 2.0 * speed * course.period_s:
            t.jump_m = moved
    for i in range(7):
        g.error[i] = error[i]
    for body in range(2):
        at = 3 * body
        if g.lost == 0.0 and math.hypot(error[at], error[at + 1]) > safety.distance_m:
            g.lost = LOST + at
        if g.lost == 0.0 and abs(error[at + 1]) > safety.cross_m:
            g.lost = LOST + at + 1
        if g.lost == 0.0 and abs(error[at + 2]) > safety.yaw:
            g.lost = LOST + at + 2
    if e.position_seen != 0.0:
        g.seen_s = e.time_s
    unseen_s = now - (e.time_s if math.isnan(g.seen_s) else g.seen_s)
    variance = max(e.covariance[0, 0], e.covariance[1, 1])  # along the worse axis of the map
    deviation = math.sqrt(variance) if variance >= 0.0 else math.inf
    first, strongest, reaction = -1, 0.0, 0.0
    for i in range(alarms.shape[0]):
        t.solver[4] = max(t.solver[4], 1.0 if alarms[i, 0] >= 0.0 else 0.0)
        reaction = max(reaction, alarms[i, 0])
        if alarms[i, 0] >= _STOP_ON_PATH:
            strongest = max(strongest, alarms[i, 0])
            if first < 0:
                first = i
    if first >= 0:
        if g.held < 0.0:
            if now - g.alarm_s > _FORGOTTEN_S:
                g.restarts = 0.0
            g.held, g.held_kind = first, strongest
            for i in range(3):
                g.held_numbers[i] = alarms[first, 1 + i]
        g.held_kind, g.alarm_s = max(g.held_kind, strongest), now
    else:
        rests = abs(x[6]) <= _STANDING and now - g.alarm_s >= _QUIET_S
        if g.held >= 0.0 and rests and g.restarts < _RESTARTS:
            g.held, g.restarts = -1.0, g.restarts + 1.0
    if g.held >= 0.0:
        reaction = g.held_kind
    along = error[_X_T] * math.cos(error[_PSI_T]) + error[_Y_T] * math.sin(error[_PSI_T])
    ahead = along * course.gear >= 0.0  # whether the reference is
    t.mode = STOP
    if g.lost != 0.0:
        t.reason = g.lost
    elif reaction == _STOP:
        t.reason = ALARM_HELD
    elif unseen_s > safety.unseen_stop_s:
        t.reason = UNSEEN
    elif deviation > safety.uncertain_stop_m:
        t.reason = UNCERTAIN
    elif reaction == _STOP_ON_PATH:
        t.mode, t.reason = ON_PATH, ALARM_HELD
    else:
        t.mode = DRIVE
        if unseen_s > safety.unseen_slow_s:
            t.reason = UNSEEN
        elif deviation > safety.uncertain_slow_m:
            t.reason = UNCERTAIN
        elif reaction == _SLOW_DOWN:
            t.reason = ALARM_HELD
    if t.mode != DRIVE:
        t.stopping = 1.0
    if t.reason != 0.0:
        g.waiting = 1.0
    elif abs(x[6]) >= _UP_TO_SPEED * abs(r[6]):
        g.waiting = 0.0
    t.waits = 1.0 if g.waiting != 0.0 and ahead else 0.0
    if t.reason != 0.0 or t.jump_m != 0.0 or course.beyond[sample] != 0.0:
        t.solver[4] = 1.0
    return int(t.mode)


@cached_njit(error_model="numpy", nogil=True, _nrt=False, no_rewrites=True)
def finish(
    own: bool, course: Course, commands: FloatArray, guard: FloatArray, tick: FloatArray
) -> None:
    """Write the command of a tick into its record: the one place that limits a command.

    An amplitude or a rate beyond a limit is cut to the nearest allowed one, from the command that
    was sent. An entry that is not finite keeps its value of the tick before, 0 at the first tick.
    To stop, the hydrostat ramps to 0 at its rate.

    Args:
        own: whether the record has the actions of a controller without limits of its own; else it
            has the command of a user's controller, with what that says of limits.
        commands: with dead times the commands as they act together, newest first, (count, 3);
            without them (0, 3).
        guard: record `GUARD`.
        tick: record `TICK` as `decide` and the controller have left it.
    """
    g, t = guard.view(GUARD)[0], tick.view(TICK)[0]
    limits, delayed = course.limits, commands.shape[0] > 0
    asked, largest_hp, sample = t.mode == DRIVE or t.mode == ON_PATH, math.inf, int(t.sample)
    if t.mode == DRIVE:
        lagging = False
        if t.reason == 0.0 and t.leaves_corridor != 0.0:
            t.reason = CORRIDOR
            lagging = t.tracking[_X_T] * math.copysign(1.0, course.hp[sample]) > LAG_M
        if t.reason != 0.0 and not lagging:
            largest_hp = _SLOW * abs(course.hp[sample])
    elif t.mode == ON_PATH:
        largest_hp = 0.0
    if delayed:
        for n in range(commands.shape[0] - 1, 0, -1):
            for i in range(3):
                commands[n, i] = commands[n - 1, i]
    changed = False
    for i in range(3):
        entry = t.control[i]
        if asked:
            total = entry[0] + entry[1] + entry[2]
            wanted = total if own else entry[4]
        else:
            total = wanted = g.sent[i] if i != Input.HP or t.mode == HOLD else 0.0
        kept = g.sent[i] if g.began != 0.0 else 0.0
        told, desired = entry[7] != 0.0, wanted
        if delayed and asked:  # the newest one, and what of it and of older ones acts together
            before = commands[1, i]
            desired = wanted if math.isfinite(wanted) else before
            low = max(limits[0, i], before - limits[2, i])
            high = min(limits[1, i], before + limits[2, i])
            newest = commands[0, i] = min(max(desired, low), high)
            told |= own and not low + _ROUNDING < newest < high - _ROUNDING
            whole, share = int(course.hold_back[i, 0]), course.hold_back[i, 1] / course.period_s
            desired = commands[whole, i]
            desired += share * (commands[whole + 1, i] - desired)
        elif not math.isfinite(desired):
            desired = kept
        low, high = limits[0, i], limits[1, i]
        if g.began != 0.0:
            low, high = max(low, g.sent[i] - limits[2, i]), min(high, g.sent[i] + limits[2, i])
        allowed = min(max(desired, low), high)
        command = allowed
        if i == Input.HP and largest_hp < math.inf:
            command = min(max(min(max(desired, -largest_hp), largest_hp), low), high)
        limited = told or command != desired
        if asked and own and not delayed:
            limited |= not low + _ROUNDING < command < high - _ROUNDING
        elif asked and not own:
            beyond = not abs(wanted - (commands[0, i] if delayed else allowed)) <= _ROUNDING
            limited = told or beyond or command != allowed
            if beyond and (g.overridden == 0.0 or not math.isfinite(wanted)):
                t.cut[i], t.solver[4] = CUT_NOT_FINITE, 1.0
                if math.isfinite(wanted):
                    within = limits[0, i] <= wanted <= limits[1, i]
                    t.cut[i] = CUT_RATE if within else CUT_RANGE
        changed |= command != allowed or (g.overridden != 0.0 and abs(command - desired) > 0.0)
        if not asked:
            entry[0], entry[1], entry[2], total = command, 0.0, 0.0, command
        if delayed and (not asked or command != desired):
            commands[0, i] = command
        g.sent[i] = command
        entry[3], entry[4], entry[5], entry[6] = total, command, limits[0, i], limits[1, i]
        entry[7] = 1.0 if limited else 0.0
    g.overridden = 1.0 if changed or not asked or t.mode == ON_PATH else 0.0
    g.began = 1.0
    if t.reason != 0.0 or t.law != 0.0:
        t.solver[4] = 1.0
