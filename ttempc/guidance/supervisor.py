"""Supervisor: holds, slows down or stops the vehicle on a bad estimate, controller or reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidTuning
from ..limits import CommandLimits
from ..models.tracking_error import Error, estimated_error
from ..reference.projection import Projection
from ..reference.reference import Reference
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
    SpaceBased,
    State,
)
from .command_guard import CommandGuard
from .detection.detector import Alarm, Reaction
from .detection.reactions import Reactions
from .reference_limits import beyond_limits

_GNSS = frozenset({Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER})
_SLOW = 0.5  # share of the reference's hydrostat position that is left at half speed
_UP_TO_SPEED = 0.8  # share of the reference's speed from which on it no longer waits; assumed
_LAG_M = 1.0  # behind the reference, up to which a corridor slows the vehicle down; assumed


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits at which a supervisor slows down and stops; all assumed.

    Without GNSS the filter `ekf` drifts by some centimetres in the time to `unseen_stop_s`.

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


def run_on(ticks: int) -> int:
    """Return the ticks by which the reference of a space-based controller is continued.

    They are for a vehicle that is ahead of its time at the end; a quarter, assumed.
    """
    return math.ceil(0.25 * ticks)


class Supervisor:
    """Runs a controller as long as estimate and reference allow it.

    The controller's step is taken through a `CommandGuard`. Where nothing is wrong its command is
    sent as it is.

    - Estimate not finite: the last command is held for `blind_s`, then the vehicle stops.
    - No GNSS sample accepted for some time, an old estimate, or an uncertain position: half speed,
      then stop. Both end as soon as the position is known again. An estimator that reports no
      innovation of GNSS is judged by its time stamps and its covariance alone.
    - An alarm of a detector (`ttempc.guidance.detection`): reported, half speed, or a stop until
      its cause has ended, in which the controller steers unless the steering is the cause.
    - Metres away from the reference, or a large yaw error: stop for good. A linear model does not
      hold there.
    - A controller whose predicted path leaves the corridor: half speed until it does not, or until
      the vehicle lags a metre behind its time-based reference, with which it catches up later.
    - Errors are those to the reference of the tick, of a `SpaceBased` controller those to the
      nearest tick of the reference.
    - A jump of the error, and a reference beyond the limits: reported, and driven within the
      limits.

    To stop, the hydrostat ramps to 0 at its rate and both steering angles are held. Every action
    is reported in `Diagnostics.fallback`.

    While the supervisor slows or stops the vehicle, and until it is up to speed again, the
    reference waits at every tick at which it is ahead of the vehicle (`waits`).
    """

    def __init__(
        self,
        controller: Controller,
        reference: Reference,
        period_s: float,
        safety: SafetyLimits | None = None,
    ) -> None:
        self._period_s = period_s
        self._safety = safety or SafetyLimits()
        self.space_based = isinstance(controller, SpaceBased) and controller.space_based
        self._guard = CommandGuard(controller, CommandLimits.of(reference.vehicle, period_s))
        self._follow(controller, reference)
        if self.space_based:
            self._projection = Projection(self._grid.state[:, :2])
        start = self._limits.clamp(self._grid.inputs[0])
        unlimited = np.zeros(len(Input), dtype=np.bool_)
        self._last = ControlStep(Command(*start.tolist()), _override(start, unlimited, ""))
        self._overridden = False  # whether the last command was the supervisor's own
        self._finite_s: float | None = None  # time of the last finite estimate
        self._seen_s: float | None = None  # time of the last accepted GNSS sample
        self._error: FloatArray | None = None  # z_e of the tick before
        self._stopped = ""  # reason of a stop for good
        self._reactions = Reactions()
        self._waiting = False  # whether the reference waits where it is ahead
        self._waits = False

    def _follow(self, controller: Controller, reference: Reference) -> None:
        self._limits = CommandLimits.of(reference.vehicle, self._period_s)
        self._reverse = reference.vehicle.reverse
        self._preparing = controller if isinstance(controller, Preparing) else None
        grid = reference.on_grid(self._period_s)
        if self.space_based:
            grid = reference.on_grid(self._period_s, beyond=run_on(len(grid.time_s)))
        self._grid = grid
        self._speed = float(np.abs(self._grid.state[:, State.V]).max())
        self._hp = self._grid.inputs[:, Input.HP]
        self._beyond_limits = beyond_limits(self._grid, self._limits)

    def exchange(self, controller: Controller, reference: Reference) -> None:
        """Go on with another controller and a reference of the same path and speed.

        Only the vehicle of the reference may differ; the place on the path is kept.
        """
        self._follow(controller, reference)
        self._guard.exchange(controller, self._limits)
        self._error = None  # to the other reference

    @property
    def waits(self) -> bool:
        """Whether the reference stays at the tick of the last step."""
        return self._waits

    def prepare(self, k: int) -> None:
        """Let the controller prepare tick `k`, where it can."""
        if self._preparing:
            self._preparing.prepare(k)

    def step(
        self, estimate: Estimate, k: int, time_s: float, alarms: Sequence[Alarm] = ()
    ) -> ControlStep:
        """Return the step of tick `k`, its command within the vehicle's limits.

        Args:
            estimate: of the vehicle at this tick, possibly old or not finite.
            k: control tick, counted from the start of the reference.
            time_s: present time on the clock of `estimate.time_s` [s].
            alarms: of the detectors at this tick.

        Raises:
            ControllerFailed: as `CommandGuard.step`.
        """
        safety = self._safety
        self._waits = False
        if self._finite_s is None:
            self._finite_s = time_s
        if not _finite(estimate):
            self._error = None
            if time_s - self._finite_s <= safety.blind_s:
                return self._steady(self._last.command.hp, "estimate not finite: command held")
            return self._stop(f"estimate not finite for more than {safety.blind_s:g} s")
        self._finite_s = time_s
        sample = min(k, len(self._hp) - 1)
        if self.space_based:
            x, y = estimate.state[: State.PSI_T].tolist()
            sample = round(self._projection.place(x, y))
        error = estimated_error(estimate, self._grid, sample)
        jump = self._jump(error)
        self._error = error
        self._stopped = self._stopped or _astray(error, safety)
        unseen_s, deviation = self._unseen_s(estimate, time_s), _deviation_m(estimate)
        reaction, reasons = self._reactions.decide(alarms, float(estimate.state[State.V]), time_s)
        if self._stopped:
            return self._stop(self._stopped, error)
        if reaction is Reaction.STOP:
            return self._stop(reasons, error)
        if unseen_s > safety.unseen_stop_s:
            reason = f"position not measured for more than {safety.unseen_stop_s:g} s"
            return self._stop(reason, error)
        if deviation > safety.uncertain_stop_m:
            reason = f"position uncertain by more than {safety.uncertain_stop_m:g} m"
            return self._stop(reason, error)
        if reaction is Reaction.STOP_ON_PATH:
            return self._stop_on_path(estimate, k, reasons, error)
        slow = ""
        if unseen_s > safety.unseen_slow_s:
            slow = f"position not measured for more than {safety.unseen_slow_s:g} s: half speed"
        elif deviation > safety.uncertain_slow_m:
            slow = f"position uncertain by more than {safety.uncertain_slow_m:g} m: half speed"
        elif reaction is Reaction.SLOW:
            slow = f"{reasons}: half speed"
        self._wait(error, sample, estimate.state.item(State.V), slows=bool(slow))
        lagging = False
        before, step = self._last.command, self._guard.step(estimate, k)
        if not slow and step.diagnostics.leaves_corridor:
            slow = f"corridor cannot be kept: half speed until {_LAG_M:g} m behind the reference"
            lagging = error[Error.X_T] * math.copysign(1.0, self._hp[sample]) > _LAG_M
        if slow or self._overridden:
            largest_hp = _SLOW * abs(self._hp[sample]) if slow and not lagging else math.inf
            step = self._rejoin(step, before, largest_hp)
        alarmed = "" if slow else reasons
        notes = [self._beyond_limits[sample], jump, slow, alarmed, step.diagnostics.fallback]
        diagnostics = replace(
            step.diagnostics, tracking_error=error, fallback="; ".join(filter(None, notes))
        )
        self._last = ControlStep(step.command, diagnostics)
        return self._last

    def _rejoin(self, step: ControlStep, before: Command, largest_hp: float) -> ControlStep:
        """Return `step` within the rate limits from `before` and a hydrostat of +-`largest_hp`.

        The controller's own rate limits start at the command that it returned last, which was not
        sent while the supervisor drove.
        """
        desired = step.command.as_array()
        desired[Input.HP] = min(max(desired[Input.HP], -largest_hp), largest_hp)
        command, _ = self._limits.apply(desired, before.as_array())
        changed = command != step.command.as_array()
        self._overridden = bool(changed.any())
        if not self._overridden:
            return step
        diagnostics = replace(step.diagnostics, limited=step.diagnostics.limited | changed)
        return ControlStep(Command(*command.tolist()), diagnostics)

    def _stop(self, reason: str, error: FloatArray | None = None) -> ControlStep:
        step = self._steady(0.0, f"{reason}: stopped", error)
        self._last = replace(step, diagnostics=replace(step.diagnostics, stopping=True))
        self._waiting = True
        self._waits = error is None or self._is_ahead(error)
        return self._last

    def _stop_on_path(
        self, estimate: Estimate, k: int, reason: str, error: FloatArray
    ) -> ControlStep:
        """Move the hydrostat to 0 and let the controller steer."""
        step = self._rejoin(self._guard.step(estimate, k), self._last.command, largest_hp=0.0)
        diagnostics = replace(
            step.diagnostics, tracking_error=error, fallback=f"{reason}: stopped", stopping=True
        )
        self._last = ControlStep(step.command, diagnostics)
        self._overridden = self._waiting = True
        self._waits = self._is_ahead(error)
        return self._last

    def _wait(self, error: FloatArray, k: int, speed: float, *, slows: bool) -> None:
        """Decide whether the reference waits at tick `k` while the vehicle drives."""
        if slows:
            self._waiting = True
        elif abs(speed) >= _UP_TO_SPEED * abs(self._grid.state.item(k, State.V)):
            self._waiting = False
        self._waits = self._waiting and self._is_ahead(error)

    def _is_ahead(self, error: FloatArray) -> bool:
        """Whether the reference is ahead of the vehicle in its direction of travel, or level."""
        x, y, yaw = error[[Error.X_T, Error.Y_T, Error.PSI_T]].tolist()
        along = x * math.cos(yaw) + y * math.sin(yaw)  # in the frame of the reference
        return along * (-1.0 if self._reverse else 1.0) >= 0.0

    def _steady(self, hp: float, reason: str, error: FloatArray | None = None) -> ControlStep:
        """Hold both steering angles and move the hydrostat to `hp`, booked as feedforward."""
        before = self._last.command.as_array()
        command, limited = self._limits.apply(np.array([*before[:2], hp]), before)
        diagnostics = _override(command, limited, reason, error)
        self._last = ControlStep(Command(*command.tolist()), diagnostics)
        self._overridden = True
        return self._last

    def _unseen_s(self, estimate: Estimate, time_s: float) -> float:
        """Return the time since the position was measured [s]."""
        if any(item.accepted and item.sensor in _GNSS for item in estimate.innovations):
            self._seen_s = estimate.time_s
        return time_s - (estimate.time_s if self._seen_s is None else self._seen_s)

    def _jump(self, error: FloatArray) -> str:
        """Return a note where the error changed faster than the speeds explain, else ""."""
        if self._error is None:
            return ""
        (x, y, *_, v), (last_x, last_y, *_) = error.tolist(), self._error.tolist()
        moved = math.hypot(x - last_x, y - last_y)
        speed = abs(v) + self._speed
        if moved <= self._safety.jump_m + 2.0 * speed * self._period_s:
            return ""
        return f"error jumped by {moved:.1f} m: driving back"


def _override(
    command: FloatArray, limited: NDArray[np.bool_], reason: str, error: FloatArray | None = None
) -> Diagnostics:
    """Return the diagnostics of the supervisor's own command, booked as feedforward."""
    none = np.zeros(len(Input))
    return Diagnostics(command, none, none, limited, tracking_error=error, fallback=reason)


def _finite(estimate: Estimate) -> bool:
    arrays = estimate.state, estimate.trailer_xy, estimate.disturbance, estimate.map_disturbance
    return math.isfinite(estimate.hitch_angle + sum(sum(array.tolist()) for array in arrays))


def _deviation_m(estimate: Estimate) -> float:
    """Return the standard deviation of the tractor point along the worse axis of the map [m]."""
    covariance = estimate.covariance
    largest = max(covariance.item(State.X, State.X), covariance.item(State.Y, State.Y))
    return math.sqrt(largest) if largest >= 0.0 else math.inf


def _astray(error: FloatArray, safety: SafetyLimits) -> str:
    """Return the limit of tracking that `error` exceeds, "" if none."""
    x_t, y_t, psi_t, x_i, y_i, psi_i, _ = error.tolist()
    for body, x, y, yaw in (("tractor", x_t, y_t, psi_t), ("trailer", x_i, y_i, psi_i)):
        if math.hypot(x, y) > safety.distance_m:
            return f"{body} more than {safety.distance_m:g} m from its reference"
        if abs(y) > safety.cross_m:
            return f"{body} more than {safety.cross_m:g} m beside its reference"
        if abs(yaw) > safety.yaw:
            return f"{body} turned by more than {math.degrees(safety.yaw):.0f} deg"
    return ""
