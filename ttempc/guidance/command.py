"""Command of a tick: composed, aligned with dead times, clipped, reported.

`write_command` is the one place that limits a command.
"""

import math
from typing import Any, Final, NamedTuple

from ..jit import cached_njit, record
from ..layout import TICK, BodyError, ControlColumn
from ..types import FloatArray, Input
from .safety import (
    CORRIDOR,
    CUT_NOT_FINITE,
    CUT_RANGE,
    CUT_RATE,
    DRIVE,
    GUARD,
    HOLD,
    LAG_M,
    ON_PATH,
    LimitRow,
    SupervisedReference,
)

Record = Any
"""Record of a compiled call: fields by name, as `ttempc.jit.record` returns it."""

_HALF_SPEED: Final = 0.5  # share of the reference's hydrostat position that is left
_ROUNDING: Final = 1e-9  # an excess over a limit below this is not reported
_WHOLE: Final = 0  # column of `SupervisedReference.hold_back`: whole periods
_REST: Final = 1  # rest [s]

_kernel: Final = cached_njit(error_model="numpy", nogil=True, _nrt=False, no_rewrites=True)


class Ask(NamedTuple):
    """What the command of a tick is made of."""

    steers: bool  # whether the controller was asked, in `DRIVE` and `ON_PATH`
    is_packaged: bool  # a law of the package, whose actions have no limits yet; else a user's
    delayed: bool  # whether dead times are compensated
    largest_hp: float  # magnitude of the hydrostat's position, infinite where it is free


class Clipped(NamedTuple):
    """An input within its limits."""

    desired: float  # value before the limits
    lower: float  # limits of this period, by amplitude and rate
    upper: float
    allowed: float  # nearest value within them
    command: float  # the same, with the hydrostat as the supervisor lets it


@_kernel
def write_command(
    is_packaged: bool,
    reference: SupervisedReference,
    commands: FloatArray,
    guard: FloatArray,
    tick: FloatArray,
) -> None:
    """Write the command of a tick into its record: the one place that limits a command.

    An amplitude or a rate beyond a limit is cut to the nearest allowed one, from the command that
    was sent. An entry that is not finite keeps its value of the tick before, 0 at the first tick;
    how long that lasts is counted. To stop, the hydrostat ramps to 0 at its rate.

    Args:
        is_packaged: whether the record has the actions of a controller of the package, without
            limits; else it has the command of a user's, with what that says of limits.
        reference: with the limits of the vehicle.
        commands: with dead times the commands as they act together, newest first, (count, 3);
            without them (0, 3).
        guard: record `GUARD`.
        tick: record `TICK` as `decide_mode` and the controller have left it.
    """
    g = record(guard, GUARD)
    t = record(tick, TICK)
    steers = t.mode == DRIVE or t.mode == ON_PATH
    ask = Ask(steers, is_packaged, len(commands) > 0, _largest_hydrostat(t, reference))
    if ask.delayed:
        _shift(commands)

    changed = False
    answered = True
    for i in range(len(g.sent)):
        control = t.control[i]
        wanted = _compose(ask, i, g, t)
        answered &= math.isfinite(wanted)
        desired = _align(ask, i, wanted, g, control, reference, commands)
        clipped = _clip(ask, i, desired, g, reference.limits)
        control[ControlColumn.LOWER] = reference.limits[LimitRow.LOWER, i]
        control[ControlColumn.UPPER] = reference.limits[LimitRow.UPPER, i]
        newest = commands[0, i] if ask.delayed else clipped.allowed
        _report(ask, i, wanted, newest, clipped, g, t)

        moved = clipped.command != desired
        changed |= clipped.command != clipped.allowed or (g.overridden != 0.0 and moved)
        if ask.delayed and (not ask.steers or moved):
            commands[0, i] = clipped.command
        g.sent[i] = clipped.command
        control[ControlColumn.COMMAND] = clipped.command
    g.overridden = 1.0 if changed or t.mode != DRIVE else 0.0
    g.rates_hold = 1.0
    if ask.steers:
        g.unanswered_s = 0.0 if answered else g.unanswered_s + reference.period_s
    if t.reason != 0.0 or t.law != 0.0:
        t.fallback = 1.0


@_kernel
def _largest_hydrostat(t: Record, reference: SupervisedReference) -> float:
    """Return the largest magnitude of the hydrostat's position; write the reason `CORRIDOR`.

    Half the reference's where there is a reason for half speed, 0 for a stop on the path. A
    corridor is a reason unless the vehicle lags a metre behind already.
    """
    if t.mode == ON_PATH:
        return 0.0
    if t.mode != DRIVE:
        return math.inf
    hydrostat = reference.inputs[int(t.sample), Input.HP]
    lags = False
    if t.reason == 0.0 and t.leaves_corridor != 0.0:
        t.reason = CORRIDOR
        lags = t.tracking[BodyError.X_T] * math.copysign(1.0, hydrostat) > LAG_M
    if t.reason != 0.0 and not lags:
        return _HALF_SPEED * abs(hydrostat)
    return math.inf


@_kernel
def _shift(commands: FloatArray) -> None:
    """Make room for the newest command."""
    for n in range(len(commands) - 1, 0, -1):
        for i in range(3):
            commands[n, i] = commands[n - 1, i]


@_kernel
def _compose(ask: Ask, i: int, g: Record, t: Record) -> float:
    """Return the command that is wanted for an input, and write the sum of its actions.

    Of a controller of the package it is that sum, of a user's what it has returned. Where no
    controller is asked both steering angles are held, and the hydrostat goes to 0 in a stop.
    """
    control = t.control[i]
    if ask.steers:
        total = control[ControlColumn.FEEDFORWARD]
        total += control[ControlColumn.FEEDBACK]
        total += control[ControlColumn.ROBUST]
        control[ControlColumn.SUM] = total
        return total if ask.is_packaged else control[ControlColumn.COMMAND]
    return g.sent[i] if i != Input.HP or t.mode == HOLD else 0.0


@_kernel
def _align(
    ask: Ask,
    i: int,
    wanted: float,
    g: Record,
    control: FloatArray,
    reference: SupervisedReference,
    commands: FloatArray,
) -> float:
    """Return the command that is desired for an input in this period, a finite one.

    With dead times the newest command, within its limits, waits until it acts together with the
    other inputs; between two ticks it is interpolated. It is that one to which limits apply.
    """
    if not (ask.delayed and ask.steers):
        if math.isfinite(wanted):
            return wanted
        return g.sent[i] if g.rates_hold != 0.0 else 0.0

    limits = reference.limits
    before = commands[1, i]
    lower = max(limits[LimitRow.LOWER, i], before - limits[LimitRow.STEP, i])
    upper = min(limits[LimitRow.UPPER, i], before + limits[LimitRow.STEP, i])
    newest = min(max(wanted if math.isfinite(wanted) else before, lower), upper)
    commands[0, i] = newest
    if ask.is_packaged and not lower + _ROUNDING < newest < upper - _ROUNDING:
        control[ControlColumn.LIMITED] = 1.0

    whole = int(reference.hold_back[i, _WHOLE])
    share = reference.hold_back[i, _REST] / reference.period_s
    acting = commands[whole, i]
    return acting + share * (commands[whole + 1, i] - acting)


@_kernel
def _clip(ask: Ask, i: int, desired: float, g: Record, limits: FloatArray) -> Clipped:
    """Return an input within the limits of amplitude and rate."""
    lower = limits[LimitRow.LOWER, i]
    upper = limits[LimitRow.UPPER, i]
    if g.rates_hold != 0.0:
        lower = max(lower, g.sent[i] - limits[LimitRow.STEP, i])
        upper = min(upper, g.sent[i] + limits[LimitRow.STEP, i])
    allowed = min(max(desired, lower), upper)
    command = allowed
    if i == Input.HP and ask.largest_hp < math.inf:
        capped = min(max(desired, -ask.largest_hp), ask.largest_hp)
        command = min(max(capped, lower), upper)
    return Clipped(desired, lower, upper, allowed, command)


@_kernel
def _report(
    ask: Ask, i: int, wanted: float, newest: float, clipped: Clipped, g: Record, t: Record
) -> None:
    """Write whether a limit acts on an input, and what is wrong with a user's command.

    A command of the package's controller is limited where it is changed, or ends at a limit by
    itself. A user's is judged by its newest command, and not blamed for rates after the supervisor
    has sent another one.
    """
    control = t.control[i]
    command = clipped.command
    limited = control[ControlColumn.LIMITED] != 0.0
    if not ask.steers:
        limited |= command != clipped.desired
        control[ControlColumn.FEEDFORWARD] = command
        control[ControlColumn.FEEDBACK] = 0.0
        control[ControlColumn.ROBUST] = 0.0
        control[ControlColumn.SUM] = command
    elif ask.is_packaged:
        limited |= command != clipped.desired
        within = clipped.lower + _ROUNDING < command < clipped.upper - _ROUNDING
        limited |= not ask.delayed and not within
    else:
        beyond = not abs(wanted - newest) <= _ROUNDING
        limited |= beyond or command != clipped.allowed
        if beyond and (g.overridden == 0.0 or not math.isfinite(wanted)):
            t.fallback = 1.0
            t.cut[i] = _blame(control, wanted)
    control[ControlColumn.LIMITED] = 1.0 if limited else 0.0


@_kernel
def _blame(control: FloatArray, wanted: float) -> int:
    """Return what is wrong with a user's command of an input that cannot be sent."""
    if not math.isfinite(wanted):
        return CUT_NOT_FINITE
    within = control[ControlColumn.LOWER] <= wanted <= control[ControlColumn.UPPER]
    return CUT_RATE if within else CUT_RANGE
