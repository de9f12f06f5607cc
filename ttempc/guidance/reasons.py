"""Reasons of a supervisor in words, made of its records when someone looks."""

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Final, NamedTuple

import numpy as np

from ..layout import TICK
from ..types import Command, FloatArray, Input
from .safety import (
    ALARM_HELD,
    BESIDE,
    CORRIDOR,
    CUT_NOT_FINITE,
    CUT_RANGE,
    CUT_RATE,
    DRIVE,
    FAR,
    GUARD,
    HOLD,
    LAG_M,
    LOST,
    NO_COMMAND,
    NO_ESTIMATE,
    NOT_FINITE,
    NOT_STARTED,
    POSITION_LOST,
    TURNED,
    UNCERTAIN,
    WAYS_TO_BE_LOST,
    SafetyLimits,
    SupervisedReference,
)

_INPUTS: Final = [item.name for item in fields(Command)]
_BODIES: Final = ("tractor", "trailer")
_WITHOUT_ESTIMATE: Final = {
    NOT_STARTED: "no estimate yet",
    NO_ESTIMATE: "no new estimate",
    NOT_FINITE: "estimate not finite",
}
_CUTS: Final = {
    CUT_NOT_FINITE: "not finite",
    CUT_RANGE: "beyond its range",
    CUT_RATE: "beyond its rate",
}


class Facts(NamedTuple):
    """What the words of a tick are made of, beside its record."""

    safety: SafetyLimits
    alarms: Sequence[str]  # reasons of the alarms that stand
    stop: str  # reason of the alarm whose stop is held
    controller: str  # `Diagnostics.fallback` of the controller


def fallback_words(
    tick: FloatArray, guard: FloatArray, reference: SupervisedReference, facts: Facts
) -> str:
    """Return every action of the supervisor at a tick in words, empty where there is none.

    Args:
        tick: record `TICK`.
        guard: record `GUARD`.
        reference: with its inputs beyond the limits.
        facts: beside the records.
    """
    t = tick.view(TICK)[0]
    mode = int(t["mode"])
    reason = int(t["reason"])
    words = _reason_words(t, guard.view(GUARD)[0], facts)
    if mode == HOLD:
        return words
    if mode != DRIVE:
        return f"{words}: stopped"
    if reason and reason != CORRIDOR:
        words += ": half speed"
    notes = (
        _beyond_words(reference, int(t["sample"])),
        _jump_words(float(t["jump_m"])),
        words or "; ".join(facts.alarms),
        facts.controller,
        _cut_words(t["cut"]),
    )
    return "; ".join(filter(None, notes))


def _reason_words(t: np.void, guard: np.void, facts: Facts) -> str:
    """Return the reason of the mode or of half speed."""
    mode = int(t["mode"])
    reason = int(t["reason"])
    drives = mode == DRIVE
    safety = facts.safety
    if reason in _WITHOUT_ESTIMATE:
        held = ": command held" if mode == HOLD else f" for more than {safety.blind_s:g} s"
        return _WITHOUT_ESTIMATE[reason] + held
    if reason == NO_COMMAND:
        return f"no finite command of the controller for more than {safety.blind_s:g} s"
    if LOST <= reason < ALARM_HELD:
        return _lost_words(reason, guard, safety)
    if reason == ALARM_HELD:
        return "; ".join(facts.alarms) if drives else facts.stop
    if reason == POSITION_LOST:
        limit_s = safety.gnss_outage_slow_s if drives else safety.gnss_outage_stop_s
        return f"position not measured for more than {limit_s:g} s"
    if reason == UNCERTAIN:
        limit_m = safety.uncertain_slow_m if drives else safety.uncertain_stop_m
        return f"position uncertain by more than {limit_m:g} m"
    if reason == CORRIDOR:
        return (
            "corridor cannot be kept, or the hitch angle's bound: half speed until "
            f"{LAG_M:g} m behind the reference"
        )
    return ""


def _lost_words(reason: int, guard: np.void, safety: SafetyLimits) -> str:
    """Return which body is lost, and how."""
    body, way = divmod(reason - LOST, WAYS_TO_BE_LOST)
    allowance_m = float(guard["distance_allowance_m"])
    yaw = safety.yaw + float(guard["yaw_allowance"])
    ways = {
        FAR: f"more than {safety.distance_m + allowance_m:.3g} m from its reference",
        BESIDE: f"more than {safety.cross_m + allowance_m:.3g} m beside its reference",
        TURNED: f"turned by more than {math.degrees(yaw):.0f} deg",
    }
    return f"{_BODIES[body]} {ways[way]}"


def _beyond_words(reference: SupervisedReference, sample: int) -> str:
    """Return which inputs of the reference are beyond the limits."""
    names = [item.name.lower() for item in Input if reference.beyond[sample, item]]
    if not names:
        return ""
    return f"reference asks for more {', '.join(names)} than the limits allow: driving at the limit"


def _jump_words(jump_m: float) -> str:
    return f"error jumped by {jump_m:.1f} m: driving back" if jump_m else ""


def _cut_words(kinds: FloatArray) -> str:
    """Return what is wrong with the command of a user's controller."""
    cuts = [f"{_INPUTS[i]} {_CUTS[int(kind)]}" for i, kind in enumerate(kinds) if kind]
    return f"the controller's {', '.join(cuts)}: cut" if cuts else ""
