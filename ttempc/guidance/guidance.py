"""Guidance of a vehicle along a reference: estimator, controller, supervisor, command limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ..errors import EstimatorFailed, GuidanceFailed, InvalidReference, InvalidTime
from ..estimation.ekf import NO_CHANGE, ExtendedKalmanFilter
from ..estimation.noise import SensorNoise
from ..layout import (
    ALARM,
    ESTIMATE,
    INNOVATION,
    Innovations,
    estimate_row,
    estimate_view,
    innovation_rows,
    measurements_of,
    sample_rows,
)
from ..learning.learner import Identifier, Learner, Learnt
from ..learning.window import RecordedTick
from ..reference.path import Path
from ..reference.reference import ConstantSpeed, Reference, check_drivable, check_pace
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    Estimator,
    FloatArray,
    Input,
    Measurement,
    State,
    WarmingUp,
)
from ..vehicle import Vehicle
from .controllers import EstimatorFactory, estimator_factory, make_controller
from .dead_time import DeadTimeCompensation, Guided, compensated, resume
from .detection import Alarm, Detector, Monitors, Reaction
from .supervisor import SafetyLimits, Supervisor, user_part

if TYPE_CHECKING:
    from ..tube.reference_tube import TubeDesign

_PSI_T: Final = (ESTIMATE.fields or {})["state"][1] // 8 + State.PSI_T
_GO_ON: Final = int(Reaction.GO_ON)  # an enumeration costs six calls a tick
_HEADINGS: Final = slice(_PSI_T, _PSI_T + 2)

ControllerFactory = Callable[..., Controller]
"""Makes a controller from vehicle, reference and control period [s], options as keywords."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Parts of a guidance for one vehicle; None where the user gave an object, which stays."""

    reference: Reference
    controller: Guided | None
    estimator: Estimator | None


def make_estimator(
    estimator: str | EstimatorFactory | Estimator, vehicle: Vehicle, noise: SensorNoise
) -> Estimator:
    """Return the estimator of a name or a factory, or the object itself."""
    if isinstance(estimator, str):
        estimator = estimator_factory(estimator)
    if isinstance(estimator, type) or not hasattr(estimator, "update"):
        return estimator(vehicle, noise)  # pyright: ignore[reportCallIssue] - a factory
    return estimator  # pyright: ignore[reportReturnType] - it has `update`


def make_guided(
    controller: str | ControllerFactory | Guided,
    reference: Reference,
    period_s: float,
    options: Mapping[str, object] | None,
    tube: TubeDesign | None,
) -> Guided:
    """Return the controller of a name or factory with its dead times compensated, or the object."""
    if isinstance(controller, DeadTimeCompensation):
        return controller
    if not isinstance(controller, str | type) and hasattr(controller, "step"):
        return controller  # pyright: ignore[reportReturnType] - it has `step`

    def make(vehicle: Vehicle, reference: Reference) -> Controller:
        if isinstance(controller, str):
            return make_controller(controller, vehicle, reference, period_s, tube, options)
        return controller(vehicle, reference, period_s, **(options or {}))  # pyright: ignore[reportCallIssue] - a factory

    return compensated(make, reference, period_s)


@dataclass(frozen=True, slots=True)
class _Builder:
    """Builds parts for learnt parameters, see `Builder`; None for what the user gave as an object.

    It knows nothing of the guidance, which its thread would keep.
    """

    controller: str | ControllerFactory | Guided | None
    estimator: str | EstimatorFactory | Estimator | None
    reference: Reference
    period_s: float
    options: Mapping[str, object] | None
    tube: TubeDesign | None
    noise: SensorNoise

    def build(self, vehicle: Vehicle) -> Parts:
        reference = replace(self.reference, vehicle=vehicle)
        check_drivable(reference.path, vehicle)
        check_pace(reference, self.period_s)
        tube = self.tube and replace(self.tube, vehicle=vehicle.without_dead_times())
        controller = estimator = None
        if self.controller is not None:
            controller = make_guided(self.controller, reference, self.period_s, self.options, tube)
            if isinstance(controller, WarmingUp):
                controller.warm_up()
        if self.estimator is not None:
            estimator = make_estimator(self.estimator, vehicle, self.noise)
        return Parts(reference, controller, estimator)

    def replay(self, parts: Parts, window: Sequence[RecordedTick]) -> None:
        if parts.estimator is not None:
            for tick in window:
                parts.estimator.update(tick.time_s, tick.samples, tick.command)


def _identifiers(vehicle: Vehicle, noise: SensorNoise) -> list[Identifier]:
    from ..learning.actuators import ActuatorIdentifier
    from ..learning.lengths import LengthIdentifier

    # The lengths last: their fit replays the commands as they act.
    return [ActuatorIdentifier(), LengthIdentifier(vehicle, noise)]


class Guidance:
    """Drives a vehicle along a reference, one control period after the other.

    Every period of `period_s`, call `update` with the samples that arrived since, then `step`:

        >>> from ttempc import Vehicle, figure_eight
        >>> guidance = Guidance(Vehicle(), figure_eight())
        >>> guidance.warm_up()
        >>> estimate = guidance.update(1763775600.0, [])  # time [s], samples since the last call
        >>> guidance.step().delta_t, guidance.diagnostics.fallback
        (0.0, 'estimate not finite: command held')

    `update` runs the estimator. `step` checks the estimate against the reference, asks the
    controller, and limits its command. On a bad estimate or a controller far from the reference it
    holds the command, slows down or stops (see `Supervisor`); `diagnostics.fallback` gives the
    reason.

    Time stamps are seconds on any one clock, of the Unix epoch for example. The first `update`
    defines the start of the reference. Control ticks are counted: tick k, the k-th call of `step`,
    belongs to k * `period_s` on the reference. A loop that misses a period delays the reference.
    Where the supervisor slows or stops the vehicle, the reference waits for it (`reference_tick`).

    Detectors compare samples, commands and estimate (`ttempc.guidance.detection`); the supervisor
    reacts to their alarms.

    While it drives it learns parameters of the model (`ttempc.learning`). Where the data contradict
    the given ones, estimator, reference and controller are made anew in another thread and
    exchanged when they are ready, or at a fixed tick, see `wait`. The new estimator first receives
    the samples of the last two minutes; a controller with memory continues by its method `resume`.
    `diagnostics.learnt` tells what has changed. An estimator or a controller that was passed as an
    object stays as it is.

    Args:
        vehicle: model parameters of estimator and controller at the start.
        reference: where both axle points should be over time; of a `Path`, at `speed_mps`.
        period_s: control period [s].
        controller: a name of `ttempc.CONTROLLERS`, a factory called with vehicle, reference and
            period [s], or a controller. Around the former two the dead times of the vehicle are
            compensated, see `DeadTimeCompensation`; a controller is asked as it is.
        estimator: a name of `ttempc.ESTIMATORS`, a factory called with vehicle and sensor noise,
            or an estimator.
        options: keyword options of the controller by name or factory, such as `horizon`.
        sensor_noise: standard deviations that the estimator assumes.
        tube: of controllers that need or use one; without it `ttempc` tightens nothing.
        safety: where the supervisor slows down and stops.
        speed_mps: speed along a `Path` [m/s]; a `Reference` has its own.
        learn: whether dead times, lags and lengths of the model are learnt; or identifiers of
            your own.
        detect: whether the supervisor reacts to the built-in detectors of faults; or detectors of
            your own, which run beside the built-in ones and do not replace them.

    Raises:
        InvalidReference: the vehicle cannot follow the reference: curvature, steering rates,
            speed; the message names the place.
        InvalidPath: the vehicle cannot follow the path at all.
        UnknownController, UnknownEstimator: a name that does not exist.
        InvalidTuning: an option that is unknown or out of its range.
        InvalidTube: the tube is missing or belongs to another vehicle.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference | Path,
        period_s: float = 0.2,
        controller: str | ControllerFactory | Guided = "ttempc",
        estimator: str | EstimatorFactory | Estimator = "ekf",
        *,
        options: Mapping[str, object] | None = None,
        sensor_noise: SensorNoise | None = None,
        tube: TubeDesign | None = None,
        safety: SafetyLimits | None = None,
        speed_mps: float = 1.0,
        learn: bool | Sequence[Identifier] = True,
        detect: bool | Sequence[Detector] = True,
    ) -> None:
        if isinstance(reference, Path):
            check_drivable(reference, vehicle)
            reference = Reference(reference, vehicle, ConstantSpeed(speed_mps))
        elif reference.vehicle != vehicle:
            raise InvalidReference("reference: was made for another vehicle than the guidance")
        else:
            check_drivable(reference.path, vehicle)
        check_pace(reference, period_s)
        self.vehicle = vehicle  # model parameters, those that were learnt included
        self.reference = reference  # that is followed, for the present model parameters
        self.period_s = period_s
        self.tick = 0  # number of the next control tick
        self.reference_tick = 0  # of the reference at that tick: those that waited apart
        noise = sensor_noise or SensorNoise()
        self._estimator = make_estimator(estimator, vehicle, noise)
        self._controller = make_guided(controller, reference, period_s, options, tube)
        if isinstance(learn, bool):
            learn = _identifiers(vehicle, noise) if learn else []
        builder = _Builder(
            None if self._controller is controller else controller,
            None if self._estimator is estimator else estimator,
            reference,
            period_s,
            options,
            tube,
            noise,
        )
        self._learner = Learner(learn, vehicle, period_s, builder)
        self._learnt: tuple[str, ...] = ()  # since the last step
        own = () if isinstance(detect, bool) else detect
        self._monitors = Monitors(own, built_in=detect is not False)
        reasons = self._monitors.reason
        self._supervisor = Supervisor(self._controller, reference, period_s, safety, reasons)
        self._alarms = np.zeros((0, ALARM))  # of the detectors, since the last update
        self._origin_s: float | None = None  # of the clock
        self._time_s = -math.inf  # of the last update, from the origin
        self._row = np.empty(0)  # record `ESTIMATE` of the last update
        self._innovations = np.empty((0, INNOVATION))  # of it
        self.field: FloatArray | None = None
        self._view: Estimate | None = None  # of both, once somebody has looked
        self._stale = 0  # steps since the last update
        self._sent = np.full(len(Input), math.nan)  # the last command
        self._control_step: ControlStep | None = None  # the view of it
        self.learnt: tuple[str, ...] = ()  # model parameters that act from the last step on

    @property
    def space_based(self) -> bool:
        """Whether the controller follows the reference by place and not by time."""
        return self._supervisor.space_based

    @property
    def finished(self) -> bool:
        """Whether the next tick lies at or beyond the end of the reference."""
        return self.reference_tick * self.period_s >= self.reference.duration_s - 1e-9

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """Detectors of faults, each with its present statistic."""
        return self._monitors.detectors

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Alarms of the detectors that stand since the last update, by detector."""
        return self._monitors.alarms

    @property
    def estimate_record(self) -> FloatArray:
        """Record `ttempc.layout.ESTIMATE` of the last update."""
        return self._row

    @property
    def tick_record(self) -> FloatArray:
        """Record `ttempc.layout.TICK` of the last step; `diagnostics` is its view."""
        return self._supervisor.tick

    @property
    def stopping(self) -> bool:
        """Whether the supervisor stops the vehicle, or holds it at rest."""
        return self._supervisor.stopping

    @property
    def solve_time_s(self) -> float:
        """Time of the last step's solver as it reports it [s]; 0 where none was needed."""
        return self._supervisor.solve_time_s

    def predicted_path(self) -> FloatArray | None:
        """Return `Diagnostics.predicted_path` of the last step; call it before `prepare`."""
        return self._supervisor.predicted_path()

    @property
    def control_step(self) -> ControlStep:
        """Command and diagnostics of the last `step`.

        Raises:
            GuidanceFailed: there was no step yet.
        """
        if self._control_step is None:
            if not self.tick:
                raise GuidanceFailed("control_step: call step() first")
            diagnostics = replace(self._supervisor.diagnostics(), learnt=self.learnt)
            self._control_step = ControlStep(Command(*self._sent.tolist()), diagnostics)
        return self._control_step

    @property
    def diagnostics(self) -> Diagnostics:
        """Explanation of the last command: actions, solver, tracking error, fallback."""
        return self.control_step.diagnostics

    def warm_up(self) -> None:
        """Compile and load everything that `update` and `step` need; changes no later result.

        The first call on a machine compiles for some ten seconds, later ones load the result in a
        fraction of a second. Without it the first ticks take that time.

        Raises:
            GuidanceFailed: the estimator or the controller raised.
        """
        with user_part(GuidanceFailed, "warm_up raised"):
            for part in (self._estimator, self._controller, self._supervisor, self._monitors):
                if isinstance(part, WarmingUp):
                    part.warm_up()

    def wait(self) -> None:
        """Wait for what is learnt and due at the next tick; nothing else waits for it.

        For simulations: call it before every `update`, and an exchange has a counted tick, whatever
        the time that computing takes. There is no limit: an identifier that never returns is waited
        for. A vehicle does not call it: `update` takes what was learnt when it is ready.
        """
        self._learner.wait(self.tick)

    def prepare(self) -> None:
        """Do the work of the next `step` that needs no samples, where the controller can.

        Optional: call it while waiting for the samples of the next tick.

        Raises:
            GuidanceFailed: the controller raised.
        """
        with user_part(GuidanceFailed, f"prepare raised at tick {self.tick}"):
            self._supervisor.prepare(self.reference_tick)

    def update(self, time_s: float, measurements: Sequence[Measurement] | FloatArray) -> Estimate:
        """Run the estimator to `time_s` and return its estimate.

        Args:
            time_s: present time [s] on the clock of the samples.
            measurements: the samples that arrived since the last update, in the order of arrival,
                late ones included; each with the time at which it was taken. As objects, or as
                rows (n, 5) of `ttempc.layout.SAMPLE` entries.

        Raises:
            InvalidTime: `time_s` is no finite number or before that of the last update.
            InvalidSamples: rows of another shape, a sensor that does not exist, what is no number.
            EstimatorFailed: the estimator raised, or returned no `Estimate`.
        """
        rows = sample_rows(measurements)
        try:
            finite = math.isfinite(time_s)
        except (OverflowError, TypeError) as error:
            raise InvalidTime(f"update: time_s: {error}, must be a finite number") from None
        if not finite:
            raise InvalidTime(f"update: time_s = {time_s}, must be finite")
        if self._origin_s is None:
            self._origin_s = time_s
        # Seconds from the start keep their resolution; those of the Unix epoch have steps of 2e-7.
        origin = self._origin_s
        now = time_s - origin
        if now < self._time_s:
            raise InvalidTime(
                f"update: time_s = {time_s} is {self._time_s - now:g} s before the last update"
            )
        if origin:
            rows = rows - np.array([origin, 0.0, 0.0, 0.0, 0.0])
        usable = self._monitors.usable(rows)
        self._exchange()
        self._view = None
        self._observe(now, usable)
        self._time_s, self._stale = now, 0
        self._alarms = alarms = self._monitors.observe(
            rows, now, self._sent, self._row, self._innovations, self.vehicle, self._seen
        )
        if alarms.size and alarms[:, 0].max() > _GO_ON:
            self._learner.forget()
        self._learner.record(self.tick, now, usable, self._sent, *self._row[_HEADINGS].tolist())
        return (
            replace(self._seen(), time_s=self._seen().time_s + origin) if origin else self._seen()
        )

    def step(self) -> Command:
        """Return the command for the period that starts at the time of the last `update`.

        A second step on one update is driven as without an estimate: the command is held for
        `SafetyLimits.blind_s`, then the vehicle stops.

        Raises:
            GuidanceFailed: `update` was not called yet.
            ControllerFailed: the controller raised, or returned no usable step.
        """
        if self._origin_s is None:
            raise GuidanceFailed("step: call update(time_s, measurements) first")
        # Without an update no time has passed by the clock; a period has for the vehicle.
        row = None if self._stale else self._row
        now = self._time_s + self._stale * self.period_s
        self._stale += 1
        self._sent = self._supervisor.drive(row, self.reference_tick, now, self._alarms, self._seen)
        self.learnt, self._learnt, self._control_step = self._learnt, (), None
        self.tick += 1
        self.reference_tick += not self._supervisor.waits
        return Command(*self._sent.tolist())

    def resume(self) -> None:
        """Drive on after a stop: an operator has seen that position and vehicle are in order.

        The present estimate is taken for true and a sensor that contradicted it is used again. An
        alarm whose cause goes on stops the vehicle anew.

        Raises:
            GuidanceFailed: `update` was not called yet.
        """
        if self._origin_s is None:
            raise GuidanceFailed("resume: call update(time_s, measurements) first")
        self._monitors.resume(self._row.view(ESTIMATE)[0]["map_disturbance"])
        self._supervisor.resume()

    def _observe(self, now: float, rows: FloatArray) -> None:
        """Run the estimator; a user's gets objects, and its estimate is copied into the record."""
        filter_ = self._estimator
        if isinstance(filter_, ExtendedKalmanFilter) and type(filter_) is ExtendedKalmanFilter:
            waited = self.tick and self._supervisor.waits
            known = self.field is not None and not waited
            change = self.field.change(self.reference_tick) if known else NO_CHANGE
            self._row, self._innovations = filter_.observe(now, rows, self._sent, change)
            return
        sent = Command(*self._sent.tolist()) if self.tick else None
        with user_part(EstimatorFailed, f"the estimator raised at {now:.3f} s"):
            estimate: object = filter_.update(now, measurements_of(rows), sent)
        if not isinstance(estimate, Estimate):
            raise EstimatorFailed(
                f"the estimator returned {type(estimate).__name__} at {now:.3f} s, must be an "
                "Estimate"
            )
        self._view, self._row = estimate, estimate_row(estimate)
        self._innovations = innovation_rows(estimate.innovations)

    def _seen(self) -> Estimate:
        """Return the view of the present estimate."""
        if self._view is None:
            self._view = estimate_view(self._row, Innovations(self._innovations))
        return self._view

    def _exchange(self) -> None:
        try:
            learnt = self._learner.exchange(self.tick)
        except Exception as error:  # a user's factory may raise anything; the old parts drive on
            self._learnt = (f"nothing more: {type(error).__name__}: {error}",)
            return
        if learnt is not None:
            self._take_on(learnt)
        elif self._learner.overdue(self.tick):
            self._learnt = ("nothing yet: an identifier has not returned for a minute",)

    def _take_on(self, learnt: Learnt[Parts]) -> None:
        parts, notes = learnt.parts, [str(change) for change in learnt.changes]
        if parts.estimator is None:
            notes.append("the estimator was given as an object and stays as it is")
        else:
            self._estimator = parts.estimator
            self._monitors.forget_pose()
        if parts.controller is None:
            notes.append("the controller was given as an object and stays as it is")
        else:
            sent = [*learnt.sent, Command(*self._sent.tolist())]
            resume(parts.controller, self._controller, sent)
            self._controller, self.reference = parts.controller, parts.reference
            self._supervisor.exchange(parts.controller, parts.reference)
        self.vehicle, self._learnt = learnt.vehicle, tuple(notes)
