"""Supervisor: holds, slows down or stops the vehicle on a bad estimate, controller or reference."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import ControllerFailed, GuidanceFailed, InvalidTuning
from ..models.kinematics import Error, estimated_error
from ..reference.path import Projection
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
    SolverReport,
    SpaceBased,
    State,
    TubeReport,
)
from ..vehicle import CommandLimits
from .detection import Alarm, Reaction, Reactions


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


_EXCESS: Final = 1e-6  # excess of a reference over a limit that is not reported


def beyond_limits(grid: ReferenceSample, limits: CommandLimits) -> list[str]:
    """Return for every tick the inputs of the reference beyond the limits, "" where none is."""
    inputs = grid.inputs
    over = (inputs > limits.upper + _EXCESS) | (inputs < limits.lower - _EXCESS)
    fast = np.abs(np.diff(inputs, axis=0, prepend=inputs[:1])) > limits.step + _EXCESS
    names = np.array([item.name.lower() for item in Input])
    notes = np.full(len(inputs), "", dtype=object)
    for k in np.flatnonzero(over.any(axis=1) | fast.any(axis=1)):
        excess = ", ".join(names[over[k] | fast[k]])
        notes[k] = f"reference asks for more {excess} than the limits allow: driving at the limit"
    return notes.tolist()


_SHAPES: Final[dict[str, tuple[int | None, ...]]] = {  # None: any length
    "feedforward": (3,),
    "feedback": (3,),
    "robust": (3,),
    "limited": (3,),
    "tracking_error": (7,),
    "modelling_error": (4,),
    "predicted_path": (None, 4),
}
_OPTIONAL: Final = {"tracking_error", "modelling_error", "predicted_path"}
_SOLVER_NUMBERS: Final = [item.name for item in fields(SolverReport) if item.name != "status"]
_MOST_POINTS: Final = 10_000  # of a predicted path
_MOST_TEXT: Final = 1000  # characters of a reason
_NUMBER: Final = (int, float, np.number, np.bool_)
_ROUNDING: Final = 1e-9  # an excess over a limit below this is not reported


class CommandGuard:
    """Asks a controller for its step and returns one that can be driven and logged.

    A command beyond an amplitude or a rate is cut to the nearest allowed one. An entry that is
    not finite keeps its value of the tick before, 0 at the first tick. Both are reported in
    `Diagnostics.fallback` and `Diagnostics.limited`.
    """

    def __init__(self, controller: Controller, limits: CommandLimits) -> None:
        self._controller = controller
        self._limits = limits
        self._previous: FloatArray | None = None

    def exchange(self, controller: Controller, limits: CommandLimits) -> None:
        """Ask another controller from now on; its first step is limited from the last command."""
        self._controller, self._limits = controller, limits

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the step of tick `k` with a command within the limits.

        Raises:
            ControllerFailed: the controller raised, or returned neither a `Command` nor a
                `ControlStep` with numbers and arrays of the documented shapes.
        """
        with user_part(ControllerFailed, f"the controller raised at tick {k}"):
            answer: object = self._controller.step(estimate, k)
        step = _checked(answer, k)
        desired = _numbers(step.command, k)
        if self._previous is None:
            allowed = self._limits.clamp(np.where(np.isfinite(desired), desired, 0.0))
        else:
            allowed, _ = self._limits.apply(desired, self._previous)
        self._previous = allowed
        pairs = zip(allowed.tolist(), desired.tolist(), strict=True)
        beyond = [not abs(cut - own) <= _ROUNDING for cut, own in pairs]  # NaN is beyond
        if not any(beyond):
            return step
        reasons = ", ".join(self._reason(desired, i) for i, out in enumerate(beyond) if out)
        note = f"the controller's {reasons}: cut"
        diagnostics = replace(
            step.diagnostics,
            limited=np.asarray(step.diagnostics.limited, dtype=np.bool_) | np.array(beyond),
            fallback="; ".join(filter(None, (step.diagnostics.fallback, note))),
        )
        return ControlStep(Command(*allowed.tolist()), diagnostics)

    def _reason(self, desired: FloatArray, entry: int) -> str:
        value, name = desired.item(entry), fields(Command)[entry].name
        if not math.isfinite(value):
            return f"{name} not finite"
        low, high = self._limits.lower.item(entry), self._limits.upper.item(entry)
        return f"{name} beyond its {'rate' if low <= value <= high else 'range'}"


def _checked(answer: object, k: int) -> ControlStep:
    """Return the answer of a controller as a step; a bare command gets empty diagnostics.

    Raises:
        ControllerFailed: it is no step that could be driven and logged.
    """
    if isinstance(answer, Command):
        return ControlStep(answer)
    if not isinstance(answer, ControlStep):
        raise ControllerFailed(
            f"the controller returned {type(answer).__name__} at tick {k}, must be a Command or a "
            "ControlStep"
        )
    diagnostics, about = answer.diagnostics, f"the controller's step at tick {k}"
    if not isinstance(answer.command, Command) or not isinstance(diagnostics, Diagnostics):
        raise ControllerFailed(f"{about}: must hold a Command and Diagnostics, got {answer!r}")
    for name, shape in _SHAPES.items():
        value = getattr(diagnostics, name)
        if not (value is None and name in _OPTIONAL):
            _check_array(about, name, value, shape)
    path, tube, solver = diagnostics.predicted_path, diagnostics.tube, diagnostics.solver
    numbers: list[object] = []
    if isinstance(tube, TubeReport):
        _check_array(about, "tube.nominal", tube.nominal, (9,))
        _check_array(about, "tube.half_width", tube.half_width, (9,))
        numbers += [tube.margin, tube.inside]
    if isinstance(solver, SolverReport):
        numbers += [getattr(solver, name) for name in _SOLVER_NUMBERS]
    for holds, must in (
        (
            path is None or (len(path) <= _MOST_POINTS and np.isfinite(path).all()),
            f"predicted_path must be finite, {_MOST_POINTS} points at most",
        ),
        (tube is None or isinstance(tube, TubeReport), "tube must be a TubeReport or None"),
        (solver is None or isinstance(solver, SolverReport), "solver must be a SolverReport"),
        (all(isinstance(n, _NUMBER) for n in numbers), "tube and solver must hold numbers"),
        (_is_text(diagnostics.fallback), f"fallback must be text, {_MOST_TEXT} characters at most"),
        (all(map(_is_text, diagnostics.learnt)), "learnt must be texts"),
    ):
        if not holds:
            raise ControllerFailed(f"{about}: diagnostics.{must}")
    return answer


def _numbers(command: Command, k: int) -> FloatArray:
    try:
        return np.array([float(command.delta_t), float(command.delta_i), float(command.hp)])
    except (TypeError, ValueError) as error:
        raise ControllerFailed(
            f"the controller's step at tick {k}: {command} is not of numbers: {error}"
        ) from None


def _check_array(about: str, name: str, value: object, shape: tuple[int | None, ...]) -> None:
    if (
        not isinstance(value, np.ndarray)
        or len(value.shape) != len(shape)
        or any(n not in (None, m) for n, m in zip(shape, value.shape, strict=True))
    ):
        raise ControllerFailed(
            f"{about}: diagnostics.{name} must be an array of shape {shape}, got {value!r:.200}"
        )
    if value.dtype.kind not in "biuf":
        raise ControllerFailed(f"{about}: diagnostics.{name} must hold numbers, got {value.dtype}")


def _is_text(value: object) -> bool:
    return (
        isinstance(value, str)
        and len(value) <= _MOST_TEXT
        and (value.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in value))
    )


_GNSS = frozenset({Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER})
_SLOW = 0.5  # share of the reference's hydrostat position that is left at half speed
_UP_TO_SPEED = 0.8  # share of the reference's speed from which on it no longer waits; assumed
_LAG_M = 1.0  # behind the reference, up to which a corridor slows the vehicle down; assumed


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


def run_on(ticks: int) -> int:
    """Return the ticks by which the reference of a space-based controller is continued.

    They are for a vehicle that is ahead of its time at the end; a quarter, assumed.
    """
    return math.ceil(0.25 * ticks)


class Supervisor:
    """Runs a controller as long as estimate and reference allow it.

    The controller's step is taken through a `CommandGuard`. Where nothing is wrong its command is
    sent as it is.

    - Estimate not finite, or no new one: the last command is held for `blind_s`, then the vehicle
      stops.
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
        self.waits = False  # whether the reference stays at the tick of the last step

    def _follow(self, controller: Controller, reference: Reference) -> None:
        self._limits = CommandLimits.of(reference.vehicle, self._period_s)
        self._reverse = reference.vehicle.reverse
        self._preparing = controller if isinstance(controller, Preparing) else None
        grid = reference.on_grid(self._period_s)
        if self.space_based:
            grid = reference.on_grid(self._period_s, beyond=run_on(len(grid.time_s)))
        self._grid, self._hp = grid, grid.inputs[:, Input.HP]
        self._speed = float(np.abs(grid.state[:, State.V]).max())
        self._beyond_limits = beyond_limits(grid, self._limits)

    def exchange(self, controller: Controller, reference: Reference) -> None:
        """Go on with another controller and a reference of the same path and speed.

        Only the vehicle of the reference may differ; the place on the path is kept.
        """
        self._follow(controller, reference)
        self._guard.exchange(controller, self._limits)
        self._error = None  # to the other reference

    def prepare(self, k: int) -> None:
        """Let the controller prepare tick `k`, where it can."""
        if self._preparing:
            self._preparing.prepare(k)

    def step(
        self, estimate: Estimate | None, k: int, time_s: float, alarms: Sequence[Alarm] = ()
    ) -> ControlStep:
        """Return the step of tick `k`, its command within the vehicle's limits.

        Args:
            estimate: of the vehicle at this tick, possibly old or not finite; None where there is
                none since the last step.
            k: control tick, counted from the start of the reference.
            time_s: present time on the clock of `estimate.time_s` [s].
            alarms: of the detectors at this tick.

        Raises:
            ControllerFailed: as `CommandGuard.step`.
        """
        safety = self._safety
        self.waits = False
        if self._finite_s is None:
            self._finite_s = time_s
        if estimate is None or not _finite(estimate):
            self._error = None
            reason = "no new estimate" if estimate is None else "estimate not finite"
            if time_s - self._finite_s <= safety.blind_s:
                return self._steady(self._last.command.hp, f"{reason}: command held")
            return self._stop(f"{reason} for more than {safety.blind_s:g} s")
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
        self.waits = error is None or self._is_ahead(error)
        return self._last

    def _stop_on_path(
        self, estimate: Estimate, k: int, reason: str, error: FloatArray
    ) -> ControlStep:
        step = self._rejoin(self._guard.step(estimate, k), self._last.command, largest_hp=0.0)
        diagnostics = replace(
            step.diagnostics, tracking_error=error, fallback=f"{reason}: stopped", stopping=True
        )
        self._last = ControlStep(step.command, diagnostics)
        self._overridden = self._waiting = True
        self.waits = self._is_ahead(error)
        return self._last

    def _wait(self, error: FloatArray, k: int, speed: float, *, slows: bool) -> None:
        """Decide whether the reference waits at tick `k` while the vehicle drives."""
        if slows:
            self._waiting = True
        elif abs(speed) >= _UP_TO_SPEED * abs(self._grid.state.item(k, State.V)):
            self._waiting = False
        self.waits = self._waiting and self._is_ahead(error)

    def _is_ahead(self, error: FloatArray) -> bool:
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
