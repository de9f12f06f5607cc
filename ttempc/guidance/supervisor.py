"""Supervisor: holds, slows down or stops the vehicle on a bad estimate, controller or reference."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from ..errors import ControllerFailed, GuidanceFailed
from ..laws.tracking_controller import TrackingController, write_told
from ..layout import ALARM, ESTIMATE, TICK, estimate_row, estimate_view, new_tick
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
    SolverReport,
    SpaceBased,
    State,
    TubeReport,
)
from ..vehicle import CommandLimits
from .dead_time import DeadTimeCompensation
from .detection import Alarm
from .supervise import (
    ALARM_HELD,
    CORRIDOR,
    CUT_NOT_FINITE,
    CUT_RANGE,
    CUT_RATE,
    DRIVE,
    GUARD,
    HOLD,
    LAG_M,
    LOST,
    NO_ESTIMATE,
    NOT_FINITE,
    ON_PATH,
    SAFETY,
    STOP,
    UNCERTAIN,
    UNSEEN,
    Course,
    SafetyLimits,
    decide,
    finish,
)


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
        self._period_s, self._safety = period_s, safety or SafetyLimits()
        self.space_based = isinstance(controller, SpaceBased) and controller.space_based
        self._guard = np.zeros(GUARD.itemsize // 8)
        self.tick = new_tick()  # record `TICK` of the last step
        self._follow(controller, reference)
        if self.space_based:
            self._projection = Projection(self._course.state[:, :2])
        guard = self._guard.view(GUARD)[0]
        guard["sent"] = CommandLimits.of(reference.vehicle, period_s).clamp(self._start)
        guard["began"] = self._law is not None
        guard["finite_s"] = guard["seen_s"] = guard["error"] = math.nan
        guard["held"], guard["alarm_s"] = -1.0, -math.inf
        self._held = ""  # reason of the stop that is held
        self._told: Diagnostics | None = None  # by the controller at this tick
        self._asked: TrackingController | None = None  # at this tick
        self._sample = 0  # of the reference, of the controller at this tick
        self._reasons: Callable[[int, FloatArray], str] = _Given(())
        self._alarms: FloatArray = np.zeros((0, ALARM))

    def _follow(self, controller: Controller, reference: Reference) -> None:
        limits = CommandLimits.of(reference.vehicle, self._period_s)
        self._dead_times = controller if isinstance(controller, DeadTimeCompensation) else None
        asked = self._dead_times.controller if self._dead_times else controller
        self._controller = asked
        self._law = asked if isinstance(asked, TrackingController) else None
        self._preparing = controller if isinstance(controller, Preparing) else None
        grid = reference.on_grid(self._period_s)
        if self.space_based:
            grid = reference.on_grid(self._period_s, beyond=run_on(len(grid.time_s)))
        self._start, self._beyond_limits = grid.inputs[0], beyond_limits(grid, limits)
        self._commands = self._dead_times.commands if self._dead_times else np.zeros((0, 3))
        self._course = Course(
            state=grid.state,
            trailer_xy=grid.trailer_xy,
            hp=np.ascontiguousarray(grid.inputs[:, Input.HP]),
            beyond=np.array([float(bool(text)) for text in self._beyond_limits]),
            limits=np.stack([limits.lower, limits.upper, limits.step]),
            safety=np.array([getattr(self._safety, name) for name in SAFETY.fields or ()]),
            period_s=self._period_s,
            speed=float(np.abs(grid.state[:, State.V]).max()),
            gear=-1.0 if reference.vehicle.reverse else 1.0,
            hold_back=self._dead_times.hold_back if self._dead_times else np.zeros((3, 2)),
        )

    def exchange(self, controller: Controller, reference: Reference) -> None:
        """Go on with another controller and a reference of the same path and speed.

        Only the vehicle of the reference may differ; the place on the path is kept.
        """
        self._follow(controller, reference)
        self._guard.view(GUARD)[0]["error"] = math.nan  # to the other reference

    def prepare(self, k: int) -> None:
        """Let the controller prepare tick `k`, where it can, and fill the caches."""
        if self._preparing:
            self._preparing.prepare(k)
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
            ControllerFailed: the controller raised, or returned neither a `Command` nor a
                `ControlStep` with numbers and arrays of the documented shapes.
        """
        row = _NO_ESTIMATE if estimate is None else estimate_row(estimate)
        rows = np.array([[alarm.reaction, 0.0, 0.0, 0.0] for alarm in alarms]).reshape(-1, ALARM)
        command = self.drive(
            None if estimate is None else row,
            k,
            time_s,
            rows,
            _Given(alarms),
            None if estimate is None else lambda: estimate,
        )
        return ControlStep(Command(*command.tolist()), self.diagnostics())

    def drive(
        self,
        row: FloatArray | None,
        k: int,
        now: float,
        alarms: FloatArray,
        reasons: Callable[[int, FloatArray], str],
        view: Callable[[], Estimate] | None,
    ) -> FloatArray:
        """Do `step` on flat arrays and return the command (3,); `tick` has the record of it.

        Args:
            row: record `ESTIMATE`; None as of `step`.
            k: as of `step`, with `now` its `time_s`.
            alarms: rows (m, `ALARM`).
            reasons: returns the words of an alarm from its row and its three numbers.
            view: returns the estimate, for a controller that is not compiled.
        """
        course, guard, tick = self._course, self._guard, self.tick
        fresh, estimate = row is not None, _NO_ESTIMATE if row is None else row
        sample = min(k, len(course.hp) - 1)
        if self.space_based and np.isfinite(estimate[1:3]).all():
            sample = round(self._projection.place(*estimate[1:3].tolist()))
        mode = decide(sample, now, fresh, estimate, alarms, course, guard, tick)
        self._told, self._sample, self._alarms, self._reasons = None, k, alarms, reasons
        self._asked = self._law if mode in (DRIVE, ON_PATH) else None
        record = guard.view(GUARD)[0]
        held = int(record["held"])
        if held < 0:
            self._held = ""
        elif not self._held:
            self._held = reasons(held, record["held_numbers"])
        if mode in (DRIVE, ON_PATH) and view is not None:
            self._ask(estimate, view, k)
        finish(self._law is not None, course, self._commands, guard, tick)
        return record["sent"].copy()

    def _ask(self, row: FloatArray, view: Callable[[], Estimate], k: int) -> None:
        """Let the controller write its actions, or a user's its command, into the record."""
        before, tick = self._guard[:3], self.tick
        if self._dead_times:
            before, ahead = self._commands[0], self._dead_times.predicted(row)
            seen, row, view = view, ahead, lambda: estimate_view(ahead, seen().innovations)
        with user_part(ControllerFailed, f"the controller raised at tick {k}"):
            if self._law is not None:
                self._told = self._law.act(row, view, k, before.copy(), tick)
                return
            answer: object = self._controller.step(view(), k)
        step = _checked(answer, k)
        self._told = step.diagnostics
        write_told(step.diagnostics, tick)
        control = tick.view(TICK)[0]["control"]
        control[:, 4], control[:, 7] = _numbers(step.command, k), step.diagnostics.limited

    @property
    def stopping(self) -> bool:
        """Whether the last step stops the vehicle, or holds it at rest."""
        return bool(self.tick[_STOPPING])

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
                f"more than {safety.distance_m:g} m from its reference",
                f"more than {safety.cross_m:g} m beside its reference",
                f"turned by more than {math.degrees(safety.yaw):.0f} deg",
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
            said = f"corridor cannot be kept: half speed until {LAG_M:g} m behind the reference"
        elif reason:
            said += ": half speed"
        jump = float(t["jump_m"])
        cut = ", ".join(
            f"{_COMMAND[i]} {_CUTS[int(kind)]}" for i, kind in enumerate(t["cut"]) if kind
        )
        notes = (
            self._beyond_limits[int(t["sample"])],
            f"error jumped by {jump:.1f} m: driving back" if jump else "",
            said or "; ".join(alarms),
            told,
            f"the controller's {cut}: cut" if cut else "",
        )
        return "; ".join(filter(None, notes))


@dataclass(frozen=True, slots=True)
class _Given:
    """Words of alarms that were given as such."""

    alarms: Sequence[Alarm]

    def __call__(self, row: int, numbers: FloatArray) -> str:
        return self.alarms[row].reason


_NO_ESTIMATE: Final[FloatArray] = np.full(ESTIMATE.itemsize // 8, math.nan)
_NOTHING: Final = Diagnostics()
_STOPPING: Final = (TICK.fields or {})["stopping"][1] // 8
_COMMAND: Final = [item.name for item in fields(Command)]
_CUTS: Final = {
    CUT_NOT_FINITE: "not finite",
    CUT_RANGE: "beyond its range",
    CUT_RATE: "beyond its rate",
}
