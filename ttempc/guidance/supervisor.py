"""Supervisor: holds, slows down or stops the vehicle on a bad estimate, controller or reference.

What it decides and how it limits a command are two compiled functions on flat records, `decide`
and `finish`; words are made when someone looks.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..detectors.interface import Reaction
from ..detectors.table import DetectorIndex
from ..errors import ControllerFailed, GuidanceFailed, InvalidTuning
from ..jit import cached_njit, record
from ..laws.tracking_controller import TrackingController, write_told
from ..layout import ALARM, ESTIMATE, TICK, estimate_view, new_tick
from ..mpc.articulated_error import held_lambda
from ..reference.path import Projection
from ..reference.reference import Reference
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    State,
)
from ..vehicle import CommandLimits
from .dead_time import DeadTimeCompensation

# Modes:
DRIVE: Final = 0  # the controller drives, at half speed where there is a reason.
ON_PATH: Final = 1  # stop, and the controller steers.
HOLD: Final = 2  # the last command is held.
STOP: Final = 3  # stop, and hold the steering.
# Reasons of a mode or of half speed:
NO_ESTIMATE: Final = 1
NOT_FINITE: Final = 2
LOST: Final = 3  # the tractor is too far off, beside, turned; the trailer likewise
ALARM_HELD: Final = 9
UNSEEN: Final = 10
UNCERTAIN: Final = 11
CORRIDOR: Final = 12
# What is wrong with a command of a user's controller:
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
        ("entry", "f8"),  # by which the distances may exceed their limits, see `_room` [m]
        ("turned", "f8"),  # likewise the yaw errors [rad]
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

    How far the vehicle leaves its path in an outage of GNSS is in the rows "GNSS out" of the table
    of docs/appendix/faults.md.

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
    inputs: FloatArray  # (N, 3)
    beyond: NDArray[np.bool_]  # (N, 3) inputs beyond the limits
    limits: FloatArray  # (3, 3) smallest and largest command, largest change in a period
    safety: FloatArray  # record `SAFETY`
    period_s: float
    speed: float  # largest one of the reference [m/s]
    radius: float  # of the turn by which a vehicle comes back to its path [m]
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
_EXCESS: Final = 1e-6  # likewise of a reference
_MARGIN_M: Final = 0.5  # beside what an entry needs; assumed
_MARGIN_YAW: Final = math.radians(30.0)  # likewise, for a trailer that is turned first; assumed
_DELAY_S: Final = 1.0  # until the steering turns a vehicle back; assumed
_TURN: Final = math.tau
_CHECK: Final = float(DetectorIndex.DRIFT)
_SLOW_DOWN, _STOP_ON_PATH, _STOP = (
    float(Reaction.SLOW),
    float(Reaction.STOP_ON_PATH),
    float(Reaction.STOP),
)
_X_T, _Y_T, _PSI_T, _X_I, _Y_I, _PSI_I, _V = range(7)  # of the error


@cached_njit(error_model="numpy", nogil=True, _nrt=False, no_rewrites=True, inline="always")
def _room(error: FloatArray, course: Course, safety_m: float) -> float:
    """Return by how much a vehicle that turns back to its path may exceed `safety_m` [m].

    It is what it is beside the path now, or will be after the turn by which its leading body comes
    back: the turn's depth, and the way until the steering acts. In reverse the trailer leads.
    """
    body, margin, delay = 0, _MARGIN_M, _DELAY_S
    if course.gear < 0.0:
        body, margin, delay = 3, 3.0 * margin, 2.0 * delay
    aside, turned = error[body + _Y_T], error[body + _PSI_T]
    depth = course.radius * (1.0 - math.cos(turned))
    depth += delay * course.speed * abs(math.sin(turned))
    after = abs(aside + math.copysign(depth, course.gear * math.sin(turned)))
    return max(0.0, max(abs(error[_Y_T]), abs(error[_Y_I]), after) + margin - safety_m)


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
    e, g, t = record(estimate, ESTIMATE), record(guard, GUARD), record(tick, TICK)
    safety, x = record(course.safety, SAFETY), e.state
    tick[:] = 0.0
    t.sample = sample
    for i in range(11):
        t.tracking[i] = math.nan
    for i in range(20):
        t.tube[i] = math.nan
    t.solver.accepted = math.nan
    t.solver.iterations = math.nan
    t.solver.primal_residual = math.nan
    t.solver.dual_residual = math.nan
    t.solver.status = math.nan
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
        g.error[0], t.fallback = math.nan, 1.0
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
    if g.lost == 0.0:
        g.entry = min(g.entry, _room(error, course, safety.cross_m))
        turned = max(abs(error[_PSI_T]), abs(error[_PSI_I]))
        g.turned = min(g.turned, max(0.0, turned + _MARGIN_YAW - safety.yaw))
    for body in range(2):
        at = 3 * body
        if g.lost == 0.0 and math.hypot(error[at], error[at + 1]) > safety.distance_m + g.entry:
            g.lost = LOST + at
        if g.lost == 0.0 and abs(error[at + 1]) > safety.cross_m + g.entry:
            g.lost = LOST + at + 1
        if g.lost == 0.0 and abs(error[at + 2]) > safety.yaw + g.turned:
            g.lost = LOST + at + 2
    if e.position_seen != 0.0:
        g.seen_s = e.time_s
    unseen_s = now - (e.time_s if math.isnan(g.seen_s) else g.seen_s)
    variance = max(e.covariance[0, 0], e.covariance[1, 1])  # along the worse axis of the map
    deviation = math.sqrt(variance) if variance >= 0.0 else math.inf
    first, strongest, reaction = -1, 0.0, 0.0
    for i in range(alarms.shape[0]):
        t.fallback = max(t.fallback, 1.0 if alarms[i, 0] >= 0.0 else 0.0)
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
        elif g.held == _CHECK:
            g.held = first
        for i in range(3 if g.held == first else 0):
            g.held_numbers[i] = alarms[first, 1 + i]
        g.held_kind, g.alarm_s = max(g.held_kind, strongest), now
    else:
        quiet = now - g.alarm_s >= _QUIET_S and g.restarts < _RESTARTS
        if g.held == _CHECK:  # which the vehicle has passed
            g.held = -1.0
        elif g.held >= 0.0 and abs(x[6]) <= _STANDING and quiet:
            g.held, g.restarts = -1.0, g.restarts + 1.0
    if g.held >= 0.0:
        reaction = g.held_kind
    along = error[_X_T] * math.cos(error[_PSI_T]) + error[_Y_T] * math.sin(error[_PSI_T])
    ahead = along * course.gear >= 0.0  # whether the reference is
    t.mode = STOP
    if g.lost != 0.0:  # in reverse a trailer would fold while the vehicle rolls out
        t.mode, t.reason = ON_PATH if course.gear < 0.0 else STOP, g.lost
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
    for i in range(3):
        if t.reason != 0.0 or t.jump_m != 0.0 or course.beyond[sample, i]:
            t.fallback = 1.0
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
    g, t = record(guard, GUARD), record(tick, TICK)
    limits, delayed = course.limits, commands.shape[0] > 0
    asked, largest_hp, sample = t.mode == DRIVE or t.mode == ON_PATH, math.inf, int(t.sample)
    if t.mode == DRIVE:
        lagging = False
        if t.reason == 0.0 and t.leaves_corridor != 0.0:
            t.reason = CORRIDOR
            lagging = t.tracking[_X_T] * math.copysign(1.0, course.inputs[sample, Input.HP]) > LAG_M
        if t.reason != 0.0 and not lagging:
            largest_hp = _SLOW * abs(course.inputs[sample, Input.HP])
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
                t.cut[i], t.fallback = CUT_NOT_FINITE, 1.0
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
        t.fallback = 1.0


@contextmanager
def user_part(error: type[GuidanceFailed], what: str) -> Iterator[None]:
    """Convert whatever a user's part raises to `error`; `what` was called starts the message.

    `SystemExit` and other exceptions that do not derive from `Exception` are converted, too: they
    would end the program of the caller. An interrupt is the caller's own and passes.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as reason:
        raise error(f"{what}: {type(reason).__name__}: {reason}") from reason


_SHAPES: Final[dict[str, tuple[int | None, ...]]] = {  # of what is logged; None: any length
    **dict.fromkeys(("feedforward", "feedback", "robust", "limited"), (3,)),
    "tracking_error": (7,),
    "modelling_error": (4,),
    "predicted_path": (None, 4),
    **dict.fromkeys(("tube.nominal", "tube.half_width"), (9,)),
    **dict.fromkeys(("tube.inside", "tube.margin"), ()),
    **dict.fromkeys((f"solver.{n}" for n in ("accepted", "iterations", "solve_time_s")), ()),
    **dict.fromkeys(("solver.primal_residual", "solver.dual_residual"), ()),
}
_OPTIONAL: Final = {"tracking_error", "modelling_error", "predicted_path", "tube", "solver"}
_MOST_POINTS: Final = 10_000  # of a predicted path
_MOST_TEXT: Final = 1000  # characters of a reason


def _checked(answer: object, k: int) -> tuple[FloatArray, Diagnostics]:
    """Return command (3,) and diagnostics of a controller's answer; a bare command has empty ones.

    Raises:
        ControllerFailed: it is no step that could be driven and logged.
    """
    step = ControlStep(answer) if isinstance(answer, Command) else answer
    about = f"the controller's step at tick {k}: "
    if not isinstance(step, ControlStep):
        raise ControllerFailed(
            f"{about}must be Command or ControlStep, got {type(answer).__name__}"
        )
    command, told = step.command, step.diagnostics
    if not isinstance(command, Command) or not isinstance(told, Diagnostics):
        raise ControllerFailed(f"{about}must hold Command and Diagnostics, got {answer!r:.200}")
    for name, shape in _SHAPES.items():
        part = name.partition(".")[0]
        if part in _OPTIONAL and getattr(told, part) is None:
            continue
        try:
            value = attrgetter(name)(told)
        except AttributeError as error:
            raise ControllerFailed(f"{about}diagnostics.{name}: {error}") from None
        array = np.asarray(value) if np.ndim(value) == 0 and not shape else value
        if (
            not isinstance(array, np.ndarray)
            or array.dtype.kind not in "biuf"
            or array.ndim != len(shape)
            or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True))
        ):
            raise ControllerFailed(
                f"{about}diagnostics.{name} must hold numbers of shape {shape}, got {value!r:.200}"
            )
    path = told.predicted_path
    if path is not None and not (len(path) <= _MOST_POINTS and np.isfinite(path).all()):
        raise ControllerFailed(
            f"{about}diagnostics.predicted_path must be finite, {_MOST_POINTS} points at most"
        )
    for name, texts in (("fallback", (told.fallback,)), ("learnt", told.learnt)):
        if not all(map(_is_text, texts)):
            raise ControllerFailed(
                f"{about}diagnostics.{name} must be text, {_MOST_TEXT} characters at most"
            )
    try:
        return np.array([float(command.delta_t), float(command.delta_i), float(command.hp)]), told
    except (TypeError, ValueError) as error:
        raise ControllerFailed(f"{about}{command} is not of numbers: {error}") from None


def _is_text(value: object) -> bool:
    return (
        isinstance(value, str)
        and len(value) <= _MOST_TEXT
        and (value.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in value))
    )


def run_on(ticks: int) -> int:
    """Return the ticks by which the reference of a space-based controller is continued.

    They are for a vehicle that is ahead of its time at the end; a quarter, assumed.
    """
    return math.ceil(0.25 * ticks)


class Supervisor:
    """Runs a controller as long as estimate and reference allow it.

    `decide` finds what is wrong, then the controller is asked if it is to drive, and `finish`
    limits its command, see there. Where nothing is wrong a feasible command is sent as it is.

    - Estimate not finite, or no new one: the last command is held for `blind_s`, then the vehicle
      stops.
    - No GNSS sample accepted for some time, an old estimate, or an uncertain position: half speed,
      then stop. Both end as soon as the position is known again. An estimator that reports no
      innovation of GNSS is judged by its time stamps and its covariance alone.
    - An alarm of a detector (`ttempc.detectors`): reported, half speed, or a stop until
      its cause has ended, in which the controller steers where the alarm lets it. After a
      jump or a drift of the position that lasts, only `resume` ends it.
    - Metres away from the reference, or a large yaw error: stop for good. A vehicle that starts
      beside its path may be as far off as its turn back takes it; as it comes in, this room goes
      down to the limits. In reverse the controller steers meanwhile: a trailer folds otherwise.
    - A controller whose plan leaves the corridor or its hitch angle: half speed until it does not,
      or until the vehicle lags a metre behind.
    - Errors are those to the reference of the tick, of a `space_based` controller those to its nearest tick.
    - A jump of the error, and a reference beyond the limits: reported, and driven within the
      limits.

    To stop, the hydrostat ramps to 0 at its rate and both steering angles are held. Every action
    is reported in `Diagnostics.fallback`.

    While the supervisor slows or stops the vehicle, and until it is up to speed again, the
    reference waits at every tick at which it is ahead of the vehicle (`waits`).

    `reasons` returns the words of an alarm from its row and its three numbers.
    """

    def __init__(
        self,
        controller: Controller | DeadTimeCompensation,
        reference: Reference,
        period_s: float,
        safety: SafetyLimits | None,
        reasons: Callable[[int, FloatArray], str],
    ) -> None:
        self._period_s, self._safety, self._reasons = period_s, safety or SafetyLimits(), reasons
        self.space_based = controller.space_based
        self._guard = np.zeros(GUARD.itemsize // 8)
        self.tick = new_tick()  # record `TICK` of the last step
        self._follow(controller, reference)
        if self.space_based:
            self._projection = Projection(self._course.state[:, :2])
        guard = self._guard.view(GUARD)[0]
        limits = self._course.limits
        guard["sent"] = np.clip(self._course.inputs[0], limits[0], limits[1])
        guard["began"] = self._law is not None
        guard["finite_s"] = guard["seen_s"] = guard["error"] = math.nan
        guard["held"], guard["alarm_s"] = -1.0, -math.inf
        guard["entry"] = guard["turned"] = math.inf
        self._held = ""  # reason of the stop that is held
        self._told: Diagnostics | None = None  # by the controller at this tick
        self._asked: TrackingController | None = None  # at this tick
        self._sample = 0  # of the reference, of the controller at this tick
        self._alarms: FloatArray = np.zeros((0, ALARM))

    def _follow(self, controller: Controller | DeadTimeCompensation, reference: Reference) -> None:
        limits = CommandLimits.of(reference.vehicle, self._period_s)
        self._dead_times = controller if isinstance(controller, DeadTimeCompensation) else None
        asked = (
            controller.controller if isinstance(controller, DeadTimeCompensation) else controller
        )
        self._controller = asked
        self._law = asked if isinstance(asked, TrackingController) else None
        grid = reference.on_grid(self._period_s)
        if self.space_based:
            grid = reference.on_grid(self._period_s, beyond=run_on(len(grid.time_s)))
        inputs = grid.inputs
        beyond = (inputs > limits.upper + _EXCESS) | (inputs < limits.lower - _EXCESS)
        beyond |= np.abs(np.diff(inputs, axis=0, prepend=inputs[:1])) > limits.step + _EXCESS
        vehicle, front = reference.vehicle, 0.5 * limits.upper.item(Input.DELTA_T)
        radius = vehicle.wheelbase / math.tan(front)
        if vehicle.reverse:  # of the trailer, with the lambda that half of the steering holds
            behind = vehicle.drawbar_length + vehicle.trailer_length
            radius = behind / math.sin(held_lambda(vehicle, front))
        self._commands = self._dead_times.commands if self._dead_times else np.zeros((0, 3))
        self._course = Course(
            state=grid.state,
            trailer_xy=grid.trailer_xy,
            inputs=inputs,
            beyond=beyond,
            limits=np.stack([limits.lower, limits.upper, limits.step]),
            safety=np.array([getattr(self._safety, name) for name in SAFETY.fields or ()]),
            period_s=self._period_s,
            speed=float(np.abs(grid.state[:, State.V]).max()),
            radius=radius,
            gear=-1.0 if reference.vehicle.reverse else 1.0,
            hold_back=self._dead_times.hold_back if self._dead_times else np.zeros((3, 2)),
        )

    def exchange(self, controller: Controller | DeadTimeCompensation, reference: Reference) -> None:
        """Go on with another controller and a reference of the same path and speed.

        Only the vehicle of the reference may differ; the place on the path is kept.
        """
        self._follow(controller, reference)
        self._guard.view(GUARD)[0]["error"] = math.nan  # to the other reference

    def resume(self) -> None:
        """Forget stops that are held; what is still wrong stops the vehicle again."""
        guard = self._guard.view(GUARD)[0]
        guard["held"], guard["alarm_s"] = -1.0, -math.inf
        guard["restarts"] = guard["lost"] = 0.0
        guard["error"] = math.nan

    def prepare(self, k: int) -> None:
        """Let the controller prepare tick `k`, where it can, and fill the caches."""
        self._controller.prepare(k)
        self.warm_up()

    def warm_up(self) -> None:
        """Decide and finish a tick on copies; changes no later result."""
        guard, tick, row = self._guard.copy(), new_tick(), np.zeros(len(_NO_ESTIMATE))
        decide(0, 0.0, True, row, np.zeros((1, ALARM)), self._course, guard, tick)
        finish(True, self._course, self._commands.copy(), guard, tick)

    @property
    def waits(self) -> bool:
        """Whether the reference stays at the tick of the last step."""
        return bool(self.tick.view(TICK)[0]["waits"])

    def decide(self, row: FloatArray | None, k: int, now: float, alarms: FloatArray) -> bool:
        """Begin the record `tick` of a step; return whether the controller is to be asked.

        Args:
            row: record `ESTIMATE`, possibly old or not finite; None where there is none since the
                last step.
            k: control tick, counted from the start of the reference.
            now: present time on the clock of the estimate [s].
            alarms: of the detectors, rows (m, `ALARM`).
        """
        course, guard = self._course, self._guard
        fresh, estimate = row is not None, _NO_ESTIMATE if row is None else row
        sample = min(k, len(course.state) - 1)
        if self.space_based and np.isfinite(estimate[1:3]).all():
            sample = round(self._projection.place(*estimate[1:3].tolist()))
        mode = decide(sample, now, fresh, estimate, alarms, course, guard, self.tick)
        self._told, self._sample, self._alarms = None, k, alarms
        self._asked = self._law if mode in (DRIVE, ON_PATH) else None
        memory = guard.view(GUARD)[0]
        held = int(memory["held"])
        if held < 0:
            self._held = ""
        elif not self._held:
            self._held = self._reasons(held, memory["held_numbers"])
        return mode in (DRIVE, ON_PATH)

    def ask(self, row: FloatArray, k: int, view: Callable[[], Estimate]) -> None:
        """Let the controller write its actions, or a user's its command, into the record.

        `view` returns the estimate of `row`, for a controller that is not compiled.

        Raises:
            ControllerFailed: the controller raised, or returned neither a `Command` nor a
                `ControlStep` with numbers and arrays of the documented shapes.
        """
        before, tick = self._guard[:3], self.tick
        if self._dead_times:
            before, ahead = self._commands[0], self._dead_times.predicted(row)
            seen, row, view = view, ahead, lambda: estimate_view(ahead, seen().innovations)
        with user_part(ControllerFailed, f"the controller raised at tick {k}"):
            if self._law is not None:
                self._told = self._law.act(row, view, k, before.copy(), tick)
                return
            answer: object = self._controller.step(view(), k)
        command, self._told = _checked(answer, k)
        write_told(self._told, tick)
        control = tick.view(TICK)[0]["control"]
        control[:, 4], control[:, 7] = command, self._told.limited

    def finish(self) -> FloatArray:
        """Return the command of the step within the vehicle's limits, (3,)."""
        finish(self._law is not None, self._course, self._commands, self._guard, self.tick)
        return self._guard[:3].copy()

    @property
    def stopping(self) -> bool:
        """Whether the last step stops the vehicle, or holds it at rest."""
        return bool(self.tick.view(TICK)[0]["stopping"])

    @property
    def solve_time_s(self) -> float:
        """Time of the last step's solver as it reports it [s]; 0 where none was needed."""
        asked = self._asked
        report = self._told.solver if self._told else asked and asked.feedback.report
        return report.solve_time_s if report else 0.0

    def predicted_path(self) -> FloatArray | None:
        """Return `Diagnostics.predicted_path` of the last step."""
        if self._told or not self._asked:
            return self._told.predicted_path if self._told else None
        return self._asked.feedback.predicted_path(self._sample)

    def diagnostics(self) -> Diagnostics:
        """Return the view of the record of the last step."""
        t = self.tick.view(TICK)[0]
        told = self._told
        if told is None:
            told = self._asked.view(self._sample, self.tick) if self._asked else _NOTHING
        control, error = t["control"], t["tracking"][:7]
        return replace(
            told,
            feedforward=control[:, 0].copy(),
            feedback=control[:, 1].copy(),
            robust=control[:, 2].copy(),
            limited=control[:, 7] != 0.0,
            tracking_error=None if np.isnan(error[0]) else error.copy(),
            fallback=self._words(told.fallback),
            stopping=bool(t["stopping"]),
        )

    def _words(self, told: str) -> str:
        t, safety = self.tick.view(TICK)[0], self._safety
        entry, turned = (float(self._guard.view(GUARD)[0][name]) for name in ("entry", "turned"))
        mode, reason, said = int(t["mode"]), int(t["reason"]), ""
        alarms = [self._reasons(i, row[1:]) for i, row in enumerate(self._alarms) if row[0] >= 0.0]
        limits = {
            UNSEEN: (safety.unseen_slow_s, safety.unseen_stop_s),
            UNCERTAIN: (safety.uncertain_slow_m, safety.uncertain_stop_m),
        }
        if reason in (NO_ESTIMATE, NOT_FINITE):
            said = "no new estimate" if reason == NO_ESTIMATE else "estimate not finite"
            said += ": command held" if mode == HOLD else f" for more than {safety.blind_s:g} s"
        elif LOST <= reason < ALARM_HELD:
            body, how = divmod(reason - LOST, 3)
            said = ("tractor ", "trailer ")[body] + (
                f"more than {safety.distance_m + entry:.3g} m from its reference",
                f"more than {safety.cross_m + entry:.3g} m beside its reference",
                f"turned by more than {math.degrees(safety.yaw + turned):.0f} deg",
            )[how]
        elif reason == ALARM_HELD:
            said = "; ".join(alarms) if mode == DRIVE else self._held
        elif reason == UNSEEN:
            said = f"position not measured for more than {limits[UNSEEN][mode != DRIVE]:g} s"
        elif reason == UNCERTAIN:
            said = f"position uncertain by more than {limits[UNCERTAIN][mode != DRIVE]:g} m"
        if mode in (STOP, ON_PATH):
            return f"{said}: stopped"
        if mode == HOLD:
            return said
        if reason == CORRIDOR:
            said = "corridor cannot be kept, or the hitch angle's bound: half speed until "
            said += f"{LAG_M:g} m behind the reference"
        elif reason:
            said += ": half speed"
        jump = float(t["jump_m"])
        cut = ", ".join(
            f"{_COMMAND[i]} {_CUTS[int(kind)]}" for i, kind in enumerate(t["cut"]) if kind
        )
        over = [item.name.lower() for item in Input if self._course.beyond[int(t["sample"]), item]]
        notes = (
            f"reference asks for more {', '.join(over)} than the limits allow: driving at the limit"
            if over
            else "",
            f"error jumped by {jump:.1f} m: driving back" if jump else "",
            said or "; ".join(alarms),
            told,
            f"the controller's {cut}: cut" if cut else "",
        )
        return "; ".join(filter(None, notes))


_NO_ESTIMATE: Final[FloatArray] = np.full(ESTIMATE.itemsize // 8, math.nan)
_NOTHING: Final = Diagnostics()
_COMMAND: Final = [item.name for item in fields(Command)]
_CUTS: Final = {
    CUT_NOT_FINITE: "not finite",
    CUT_RANGE: "beyond its range",
    CUT_RATE: "beyond its rate",
}
