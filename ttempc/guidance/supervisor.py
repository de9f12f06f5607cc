"""What happens where estimate, reference or controller are bad: hold, slow down or stop."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..limits import CommandLimits
from ..models.tracking_error import Error, estimated_error
from ..reference.reference import Reference, ReferenceSample
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    Preparing,
    Sensor,
    State,
)
from ..vehicle import Vehicle

_GNSS = frozenset({Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER})
_SLOW = 0.5  # part of the reference's hydrostat position that is left to a vehicle that goes slow
_ROUNDING = 1e-6  # by which a reference may exceed a limit without a word


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Where a supervisor slows down and where it stops; all assumed.

    Without GNSS the filter of `ekf` drifts by some centimetres in the time to `stop`.

    Raises:
        InvalidTuning: a value is not above 0.
    """

    unseen_slow_s: float = 2.0  # without an accepted GNSS sample, or an estimate so old
    unseen_stop_s: float = 4.0
    blind_s: float = 1.0  # without a finite estimate: hold so long, then stop
    uncertain_slow_m: float = 0.25  # standard deviation of the tractor point
    uncertain_stop_m: float = 0.50
    cross_m: float = 2.0  # cross-track error of either point
    distance_m: float = 4.0  # of either point from its reference
    yaw: float = math.radians(60.0)  # yaw error of either body [rad]
    jump_m: float = 0.3  # error that comes in one period beside what two speeds explain

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not value > 0.0:
                raise InvalidTuning(f"{item.name}: got {value}, must be above 0")


class Supervisor:
    """Any controller, as long as there is something to control by.

    The inner controller is asked only where estimate and reference make sense. Its commands go on
    as they are: the vehicle's limits are the loop's to keep.

    - Estimate not finite: the last command is held for a second, then the vehicle stops.
    - No GNSS sample accepted for a while, an old estimate, or a position too uncertain: half
      speed, then stop. Both end as soon as the position is known again. An estimator that reports
      no innovation of GNSS is judged by its time stamps and its covariance alone.
    - Metres away from the reference, or headed elsewhere: stop, for good. A linear model says
      nothing there, and the time-based reference runs on.
    - A jump of the error, by the estimate or the reference, and a reference that asks for more than
      the limits: said, and driven within the limits.

    To stop means that the hydrostat ramps to 0 at its rate and both steering angles are held. Every
    action is told in `Diagnostics.fallback`.
    """

    def __init__(
        self,
        controller: Controller,
        vehicle: Vehicle,
        reference: Reference,
        period_s: float,
        safety: SafetyLimits | None = None,
    ) -> None:
        grid = reference.on_grid(period_s)
        self._controller = controller
        self._preparing = controller if isinstance(controller, Preparing) else None
        self._period_s = period_s
        self._safety = safety or SafetyLimits()
        self._limits = CommandLimits.of(vehicle, period_s)
        self._grid = grid
        self._speed = float(np.abs(grid.state[:, State.V]).max())
        self._hp = grid.inputs[:, Input.HP]
        self._too_much = _too_much(grid, self._limits)
        start = self._limits.clamp(grid.inputs[0])
        told = _held(start, np.zeros(len(Input), dtype=np.bool_), "")
        self._made = ControlStep(Command(*start.tolist()), told)  # of the tick before
        self._own = False  # whether that was the supervisor's own command
        self._finite_at = 0  # tick of the last finite estimate
        self._seen_at_s: float | None = None  # of the last accepted GNSS sample
        self._error: list[float] | None = None  # z_e of the tick before
        self._stopped = ""  # why for good

    def prepare(self, k: int) -> None:
        """Let the controller get ready for tick `k`, where it can."""
        if self._preparing:
            self._preparing.prepare(k)

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the command for the period that starts at tick `k`."""
        safety = self._safety
        if not _finite(estimate):
            self._error = None
            if (k - self._finite_at) * self._period_s <= safety.blind_s:
                return self._steady(self._made.command.hp, "estimate not finite: command held")
            return self._stop(f"estimate not finite for more than {safety.blind_s:g} s")
        self._finite_at = k
        at = min(k, len(self._hp) - 1)
        tracking_error = estimated_error(estimate, self._grid, at)
        error = tracking_error.tolist()
        jump, self._error = self._jump(error), error
        self._stopped = self._stopped or _astray(error, safety)
        unseen_s, deviation = self._unseen_s(estimate, k), _deviation_m(estimate)
        if self._stopped:
            return self._stop(self._stopped)
        if unseen_s > safety.unseen_stop_s:
            return self._stop(f"position not measured for more than {safety.unseen_stop_s:g} s")
        if deviation > safety.uncertain_stop_m:
            return self._stop(f"position uncertain by more than {safety.uncertain_stop_m:g} m")
        said = [self._too_much[at]] if self._too_much[at] else []
        said += [jump] if jump else []
        slow = ""
        if unseen_s > safety.unseen_slow_s:
            slow = f"position not measured for more than {safety.unseen_slow_s:g} s: half speed"
        elif deviation > safety.uncertain_slow_m:
            slow = f"position uncertain by more than {safety.uncertain_slow_m:g} m: half speed"
        said += [slow] if slow else []
        before, self._made = self._made.command, self._controller.step(estimate, k)
        if slow or self._own:
            self._lead(before, _SLOW * abs(self._hp[at]) if slow else math.inf)
        diagnostics = replace(self._made.diagnostics, tracking_error=tracking_error)
        self._made = replace(self._made, diagnostics=diagnostics)
        if said:
            self._made = _saying(self._made, said)
        return self._made

    def _lead(self, before: Command, most_hp: float) -> None:
        """Keep the hydrostat within +-`most_hp`, and lead back to the step from `before`.

        The controller takes for sent what it asked for, and its rate limits start there.
        """
        asked = self._made.command.as_array()
        wanted = np.array([*asked[:2], min(max(asked[Input.HP], -most_hp), most_hp)])
        command, _ = self._limits.apply(wanted, before.as_array())
        changed = command != asked
        self._own = bool(changed.any())
        if self._own:
            told = self._made.diagnostics
            told = replace(told, limited=told.limited | changed)
            self._made = ControlStep(Command(*command.tolist()), told)

    def _stop(self, why: str) -> ControlStep:
        return self._steady(0.0, f"{why}: stopped")

    def _steady(self, hp: float, why: str) -> ControlStep:
        """Return the steering angles as asked before and the way to `hp`, booked as feedforward."""
        before = self._limits.clamp(np.nan_to_num(self._made.command.as_array()))
        command, limited = self._limits.apply(np.array([*before[:2], hp]), before)
        told = _held(command, limited, why)
        self._made, self._own = ControlStep(Command(*command.tolist()), told), True
        return self._made

    def _unseen_s(self, estimate: Estimate, k: int) -> float:
        """Return for how long the position was not measured [s]."""
        if any(found.accepted and found.sensor in _GNSS for found in estimate.innovations):
            self._seen_at_s = estimate.time_s
        now = k * self._period_s
        seen = estimate.time_s if self._seen_at_s is None else self._seen_at_s
        return now - seen

    def _jump(self, error: list[float]) -> str:
        """Return in words that the error came all at once, where it did."""
        before = self._error
        if before is None:
            return ""
        x, y = Error.X_T, Error.Y_T
        moved = math.hypot(error[x] - before[x], error[y] - before[y])
        speed = abs(error[Error.V]) + self._speed
        if moved <= self._safety.jump_m + 2.0 * speed * self._period_s:
            return ""
        return f"error jumped by {moved:.1f} m: driving back"


def _held(command: FloatArray, limited: NDArray[np.bool_], why: str) -> Diagnostics:
    """Return the diagnostics of a command that no law made, booked as feedforward."""
    none = np.zeros(len(Input))
    return Diagnostics(command, none, none, limited=limited, fallback=why)


def _saying(made: ControlStep, said: list[str]) -> ControlStep:
    """Return the step with more to say."""
    inner = made.diagnostics
    return replace(
        made, diagnostics=replace(inner, fallback="; ".join(filter(None, [*said, inner.fallback])))
    )


def _finite(estimate: Estimate) -> bool:
    known = [*estimate.state.tolist(), *estimate.trailer_xy.tolist(), estimate.hitch_angle]
    disturbance = float(estimate.disturbance.sum() + estimate.map_disturbance.sum())
    return math.isfinite(sum(known) + disturbance)


def _deviation_m(estimate: Estimate) -> float:
    """Return the standard deviation of the tractor point along the worse axis of the map [m]."""
    covariance = estimate.covariance
    largest = max(covariance.item(State.X, State.X), covariance.item(State.Y, State.Y))
    return math.sqrt(largest) if largest >= 0.0 else math.inf


def _astray(error: list[float], safety: SafetyLimits) -> str:
    """Return in words why a linear model of the error is of no use any more."""
    for body, x, y, yaw in (
        ("tractor", Error.X_T, Error.Y_T, Error.PSI_T),
        ("trailer", Error.X_I, Error.Y_I, Error.PSI_I),
    ):
        if math.hypot(error[x], error[y]) > safety.distance_m:
            return f"{body} more than {safety.distance_m:g} m from its reference"
        if abs(error[y]) > safety.cross_m:
            return f"{body} more than {safety.cross_m:g} m beside its reference"
        if abs(error[yaw]) > safety.yaw:
            return f"{body} turned by more than {math.degrees(safety.yaw):.0f} deg"
    return ""


def _too_much(grid: ReferenceSample, limits: CommandLimits) -> list[str]:
    """Return for every tick in words what the reference asks beyond the limits, "" if nothing."""
    inputs = grid.inputs
    over = (inputs > limits.upper + _ROUNDING) | (inputs < limits.lower - _ROUNDING)
    fast = np.abs(np.diff(inputs, axis=0, prepend=inputs[:1])) > limits.step + _ROUNDING
    names = np.array([item.name.lower() for item in Input])
    words = np.full(len(inputs), "", dtype=object)
    for k in np.flatnonzero(over.any(axis=1) | fast.any(axis=1)):
        asked = ", ".join(names[over[k] | fast[k]])
        words[k] = f"reference asks for more {asked} than the limits allow: driving at the limit"
    return words.tolist()
