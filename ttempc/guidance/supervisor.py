"""Supervisor: holds, slows down or stops the vehicle on a bad estimate, controller or reference.

A step has three parts: `decision.py` finds what is wrong, the controller is asked if it is to
drive, and `command.py` limits its command. The first and the last are compiled functions on flat
records; `reasons.py` makes words of them when someone looks.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..detectors.interface import Reaction
from ..errors import ControllerFailed
from ..laws.tracking_controller import TrackingController, write_told
from ..layout import (
    ALARM,
    ESTIMATE,
    TICK,
    AlarmColumn,
    BodyError,
    ControlColumn,
    estimate_view,
    new_tick,
)
from ..mpc.articulated_error import held_lambda
from ..reference.path import Projection
from ..reference.reference import Reference
from ..types import (
    Controller,
    Diagnostics,
    Estimate,
    FloatArray,
    Input,
    State,
)
from ..vehicle import CommandLimits, Vehicle
from .command import write_command
from .dead_time import DeadTimeCompensation
from .decision import decide_mode
from .reasons import Facts, fallback_words
from .safety import DRIVE, GUARD, ON_PATH, SAFETY, SafetyLimits, SupervisedReference
from .user_answer import checked_answer, user_part

_EXCESS: Final = 1e-6  # of a reference over a limit; below it is rounding
_TURN_SHARE: Final = 0.5  # of the front steering, with which a vehicle comes back to its path
_BEYOND_SHARE: Final = 0.25  # of a reference, by which one by place is continued; assumed
_NO_ESTIMATE: Final[FloatArray] = np.full(ESTIMATE.itemsize // 8, math.nan)
_NOTHING: Final = Diagnostics()


def run_on(ticks: int) -> int:
    """Return the ticks by which the reference of a space-based controller is continued.

    They are for a vehicle that is ahead of its time at the end.
    """
    return math.ceil(_BEYOND_SHARE * ticks)


class SupervisorMemory(NamedTuple):
    """What the supervisor remembers from tick to tick."""

    guard: FloatArray  # record `GUARD`
    tick: FloatArray  # record `TICK` of the last step
    commands: FloatArray  # (n, 3) under way, the newest first; see `DeadTimeCompensation`
    stop_reason: str


class Supervisor:
    """Runs a controller as long as estimate and reference allow it.

    `decide_mode` finds what is wrong, then the controller is asked if it is to drive, and
    `write_command` limits its command, see there. Where nothing is wrong a feasible command is sent
    as it is.

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
    - Errors are those to the reference of the tick; of a `space_based` controller, to its nearest
      tick.
    - A jump of the error, and a reference beyond the limits: reported, and driven within the
      limits.

    To stop, the hydrostat ramps to 0 at its rate and both steering angles are held. Every action
    is reported in `Diagnostics.fallback`.

    While the supervisor slows or stops the vehicle, except for a corridor or the hitch angle, and
    until it is up to speed again, the reference waits at every tick at which it is ahead of the
    vehicle, and leaves ticks out where it falls behind one that does not obey.

    `reasons` returns the words of an alarm from its index and its row of `ALARM` entries.
    """

    def __init__(
        self,
        controller: Controller | DeadTimeCompensation,
        reference: Reference,
        period_s: float,
        safety: SafetyLimits,
        reasons: Callable[[int, FloatArray], str],
    ) -> None:
        self._period_s = period_s
        self._safety = safety
        self._reasons = reasons
        self.space_based = controller.space_based
        self._guard = np.zeros(GUARD.itemsize // 8)
        self.tick = new_tick()  # record `TICK` of the last step
        self._follow(controller, reference)
        if self.space_based:
            self._projection = Projection(self._reference.state[:, :2])
        self._begin()
        self._stop_reason = ""  # of the stop that is held
        self._answered: Diagnostics | None = None  # by the controller at this tick
        self._asked: TrackingController | None = None  # at this tick
        self._asked_tick = 0  # tick of the reference at which the controller was asked
        self._alarms: FloatArray = np.zeros((0, ALARM))

    def _begin(self) -> None:
        """Fill the memory before the first tick: the inputs of the reference were sent."""
        guard = self._guard.view(GUARD)[0]
        limits = self._reference.limits
        guard["sent"] = np.clip(self._reference.inputs[0], limits[0], limits[1])
        guard["rates_hold"] = self._law is not None
        guard["finite_s"] = math.nan
        guard["gnss_s"] = math.nan
        guard["body_error"] = math.nan
        guard["stop_alarm"] = -1.0
        guard["alarm_s"] = -math.inf
        guard["distance_allowance_m"] = math.inf
        guard["yaw_allowance"] = math.inf

    def _follow(self, controller: Controller | DeadTimeCompensation, reference: Reference) -> None:
        """Take a controller and the constants of its reference."""
        if isinstance(controller, DeadTimeCompensation):
            self._dead_times = controller
            self.controller = controller.controller
            self._commands = controller.commands
            hold_back = controller.hold_back
        else:
            self._dead_times = None
            self.controller = controller
            self._commands = np.zeros((0, 3))
            hold_back = np.zeros((3, 2))
        self._law = self.controller if isinstance(self.controller, TrackingController) else None

        grid = reference.on_grid(self._period_s)
        if self.space_based:
            grid = reference.on_grid(self._period_s, beyond=run_on(len(grid.time_s)))
        vehicle = reference.vehicle
        limits = CommandLimits.of(vehicle, self._period_s)
        safety = [getattr(self._safety, name) for name in SAFETY.fields or ()]
        self._reference = SupervisedReference(
            state=grid.state,
            trailer_xy=grid.trailer_xy,
            inputs=grid.inputs,
            beyond=_beyond(grid.inputs, limits),
            limits=np.stack([limits.lower, limits.upper, limits.step]),
            safety=np.array(safety),
            period_s=self._period_s,
            speed=float(np.abs(grid.state[:, State.V]).max()),
            radius=_radius(vehicle, limits),
            gear=-1.0 if vehicle.reverse else 1.0,
            hold_back=hold_back,
        )

    def exchange(self, controller: Controller | DeadTimeCompensation, reference: Reference) -> None:
        """Go on with another controller and a reference of the same path and speed.

        Only the vehicle of the reference may differ; the place on the path is kept.
        """
        self._follow(controller, reference)
        self._guard.view(GUARD)[0]["body_error"] = math.nan  # to the other reference

    def resume(self) -> None:
        """Forget stops that are held; what is still wrong stops the vehicle again."""
        guard = self._guard.view(GUARD)[0]
        guard["stop_alarm"] = -1.0
        guard["alarm_s"] = -math.inf
        guard["restarts"] = 0.0
        guard["lost"] = 0.0
        guard["unanswered_s"] = 0.0
        guard["body_error"] = math.nan

    def memory(self) -> SupervisorMemory:
        """Return what the supervisor remembers; it shares its arrays."""
        return SupervisorMemory(self._guard, self.tick, self._commands, self._stop_reason)

    def restore(self, memory: SupervisorMemory) -> None:
        """Remember what `memory` returned, of this supervisor or of a copy of it."""
        self._guard[:] = memory.guard
        self.tick[:] = memory.tick
        self._commands[:] = memory.commands
        self._stop_reason = memory.stop_reason
        self._answered = None
        self._asked = None

    def prepare(self, k: int) -> None:
        """Let the controller prepare tick `k`, where it can, and fill the caches."""
        self.controller.prepare(k)
        self.warm_up()

    def warm_up(self) -> None:
        """Decide and finish a tick on copies; changes no later result."""
        guard = self._guard.copy()
        tick = new_tick()
        row = np.zeros(len(_NO_ESTIMATE))
        decide_mode(0, 0.0, True, row, np.zeros((1, ALARM)), self._reference, guard, tick)
        write_command(True, self._reference, self._commands.copy(), guard, tick)

    @property
    def reference_ticks(self) -> int:
        """By how many ticks the reference goes on after the last step: 0, 1 or 2."""
        tick = self.tick.view(TICK)[0]
        return 1 - int(tick["waits"]) + int(tick["hurries"])

    def decide(self, row: FloatArray | None, k: int, now: float, alarms: FloatArray) -> bool:
        """Begin the record `tick` of a step; return whether the controller is to be asked.

        Args:
            row: record `ESTIMATE`, possibly old or not finite; None where there is none since the
                last step.
            k: control tick, counted from the start of the reference.
            now: present time on the clock of the estimate [s].
            alarms: of the detectors, rows (m, `ALARM`).
        """
        fresh = row is not None
        estimate = _NO_ESTIMATE if row is None else row
        sample = min(k, len(self._reference.state) - 1)
        position = estimate.view(ESTIMATE)[0]["state"][: State.PSI_T]
        if self.space_based and np.isfinite(position).all():
            sample = round(self._projection.place(*position.tolist()))
        mode = decide_mode(
            sample, now, fresh, estimate, alarms, self._reference, self._guard, self.tick
        )
        steers = mode in (DRIVE, ON_PATH)
        self._answered = None
        self._asked_tick = k
        self._alarms = alarms
        self._asked = self._law if steers else None

        # The words of a stop are those of its first tick.
        guard = self._guard.view(GUARD)[0]
        row_of_alarm = int(guard["stop_alarm"])
        if row_of_alarm < 0:
            self._stop_reason = ""
        elif not self._stop_reason:
            alarm = np.array([Reaction.STOP, *guard["stop_numbers"]], dtype=float)
            self._stop_reason = self._reasons(row_of_alarm, alarm)
        return steers

    def compute_command(self, row: FloatArray, k: int, view: Callable[[], Estimate]) -> None:
        """Let the controller write its actions, or a user's its command, into the record.

        `view` returns the estimate of `row`, for a controller that is not compiled.

        Raises:
            ControllerFailed: the controller raised, or returned neither a `Command` nor a
                `ControlStep` with numbers and arrays of the documented shapes.
        """
        before = self._sent
        seen = view
        if self._dead_times:
            before = self._commands[0]
            ahead = self._dead_times.predicted(row)
            row = ahead

            def seen() -> Estimate:
                return estimate_view(ahead, view().innovations)

        with user_part(ControllerFailed, f"the controller raised at tick {k}"):
            if self._law is not None:
                self._answered = self._law.act(row, seen, k, before.copy(), self.tick)
                return
            answer: object = self.controller.step(seen(), k)
        command, self._answered = checked_answer(answer, k)
        write_told(self._answered, self.tick)
        control = self.tick.view(TICK)[0]["control"]
        control[:, ControlColumn.COMMAND] = command
        control[:, ControlColumn.LIMITED] = self._answered.limited

    def finish(self) -> FloatArray:
        """Return the command of the step within the vehicle's limits, (3,)."""
        is_packaged = self._law is not None
        write_command(is_packaged, self._reference, self._commands, self._guard, self.tick)
        return self._sent.copy()

    @property
    def _sent(self) -> FloatArray:
        """The last command (3,), a view."""
        return self._guard.view(GUARD)[0]["sent"]

    @property
    def stopping(self) -> bool:
        """Whether the last step stops the vehicle, or holds it at rest."""
        return bool(self.tick.view(TICK)[0]["stopping"])

    @property
    def solve_time_s(self) -> float:
        """Time of the last step's solver as it reports it [s]; 0 where none was needed."""
        report = None
        if self._answered:
            report = self._answered.solver
        elif self._asked:
            report = self._asked.feedback.report
        return report.solve_time_s if report else 0.0

    def predicted_path(self) -> FloatArray | None:
        """Return `Diagnostics.predicted_path` of the last step."""
        if self._answered:
            return self._answered.predicted_path
        return self._asked.feedback.predicted_path(self._asked_tick) if self._asked else None

    def diagnostics(self) -> Diagnostics:
        """Return the view of the record of the last step."""
        t = self.tick.view(TICK)[0]
        told = self._answered
        if told is None:
            told = self._asked.view(self._asked_tick, self.tick) if self._asked else _NOTHING
        control = t["control"]
        body_error = t["tracking"][: len(BodyError)]
        return replace(
            told,
            feedforward=control[:, ControlColumn.FEEDFORWARD].copy(),
            feedback=control[:, ControlColumn.FEEDBACK].copy(),
            robust=control[:, ControlColumn.ROBUST].copy(),
            limited=control[:, ControlColumn.LIMITED] != 0.0,
            tracking_error=None if np.isnan(body_error[0]) else body_error.copy(),
            fallback=self._words(told.fallback),
            stopping=bool(t["stopping"]),
        )

    def _words(self, of_controller: str) -> str:
        """Return what the supervisor did at the last step, with the words of the controller."""
        alarms = [
            self._reasons(index, row)
            for index, row in enumerate(self._alarms)
            if row[AlarmColumn.REACTION] >= 0.0
        ]
        facts = Facts(self._safety, alarms, self._stop_reason, of_controller)
        return fallback_words(self.tick, self._guard, self._reference, facts)


def _beyond(inputs: FloatArray, limits: CommandLimits) -> NDArray[np.bool_]:
    """Return which inputs (N, 3) of a reference are beyond the limits of amplitude or rate."""
    changes = np.abs(np.diff(inputs, axis=0, prepend=inputs[:1]))
    beyond = (inputs > limits.upper + _EXCESS) | (inputs < limits.lower - _EXCESS)
    return beyond | (changes > limits.step + _EXCESS)


def _radius(vehicle: Vehicle, limits: CommandLimits) -> float:
    """Return the radius of the turn by which the leading body comes back to its path [m]."""
    front = _TURN_SHARE * limits.upper.item(Input.DELTA_T)
    if vehicle.reverse:  # of the trailer, with the lambda that this steering holds
        behind = vehicle.drawbar_length + vehicle.trailer_length
        return behind / math.sin(held_lambda(vehicle, front))
    return vehicle.wheelbase / math.tan(front)
