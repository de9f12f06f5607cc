"""The control loop, a period at a time: reference -> filter -> controller (MPC) -> supervisor.

`Guidance.update` and `Guidance.step` are the whole loop, in the order in which data flows. What
each call does is in the file of its object: `reference/reference.py`, `estimation/ekf.py`,
`detectors/kernel.py`, `laws/tracking_controller.py` with `mpc/`, `supervisor.py` with `decision.py`
and `command.py`, `dead_time.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ..detectors.interface import Reaction
from ..detectors.monitors import Detect, Monitors
from ..errors import EstimatorFailed, GuidanceFailed, InvalidReference, InvalidTime
from ..estimation.ekf import NO_CHANGE, ExtendedKalmanFilter
from ..estimation.noise import SensorNoise
from ..layout import (
    ALARM,
    ESTIMATE,
    INNOVATION,
    estimate_row,
    innovation_rows,
    measurements_of,
    sample_rows,
)
from ..learning.learner import Identifier
from ..reference.path import Path
from ..reference.reference import ConstantSpeed, Reference, check_drivable, check_pace
from ..types import Command, Estimate, Estimator, FloatArray, Input, Measurement, State, WarmingUp
from ..vehicle import Vehicle
from .controllers import EstimatorFactory
from .dead_time import Guided
from .parts import ControllerFactory, Parts
from .safety import SafetyLimits
from .supervisor import Supervisor
from .user_answer import user_part
from .views import GuidanceViews

if TYPE_CHECKING:
    from ..tube.reference_tube import TubeDesign

_PSI_T: Final = (ESTIMATE.fields or {})["state"][1] // 8 + State.PSI_T
_HEADINGS: Final = slice(_PSI_T, _PSI_T + 2)
_WARN: Final = int(Reaction.WARN)  # an enumeration costs six calls a tick


class Guidance(GuidanceViews):
    """Drives a vehicle along a reference, one control period after the other.

    Every period of `period_s`, call `update` with the samples that arrived since, then `step`:

        >>> from ttempc import Vehicle, figure_eight
        >>> guidance = Guidance(Vehicle(), figure_eight())
        >>> guidance.warm_up()
        >>> estimate = guidance.update(1763775600.0, [])  # time [s], samples since the last call
        >>> guidance.step().delta_t, guidance.diagnostics.fallback
        (0.0, 'estimate not finite: command held')

    `update` runs the estimator and the detectors of faults (`ttempc.detectors`). `step`
    checks the estimate against the reference, asks the controller, and limits its command. On a bad
    estimate, an alarm or a controller far from the reference it holds the command, slows down or
    stops (see `Supervisor`); `diagnostics.fallback` gives the reason.

    Time stamps are seconds on any one clock. The first `update` defines the start of the reference.
    Tick k, the k-th call of `step`, belongs to k * `period_s` on the reference, which waits where
    the supervisor slows or stops the vehicle (`reference_tick`); a missed period delays it.

    While it drives it learns parameters of the model (`ttempc.learning`). Where the data contradict
    the given ones, estimator, reference and controller are made anew in another thread and
    exchanged when they are ready, or at a fixed tick, see `wait`; `diagnostics.learnt` tells. The
    new estimator first receives the samples of the last two minutes; a controller with memory
    continues by its method `resume`. One that was passed as an object stays as it is.

    Args:
        vehicle: model parameters of estimator and controller at the start.
        reference: where both axle points should be over time; of a `Path`, at `speed_mps`.
        period_s: control period [s].
        controller: a name of `ttempc.CONTROLLERS`, a factory called with vehicle, reference and
            period [s], or a controller, which is asked as it is.
        estimator: a name of `ttempc.ESTIMATORS`, a factory of vehicle and noise, or an estimator.
        options: keyword options of the controller by name or factory, such as `horizon`.
        sensor_noise: standard deviations that the estimator assumes.
        tube: of controllers that need or use one; without it `ttempc` tightens nothing.
        safety: where the supervisor slows down and stops.
        speed_mps: speed along a `Path` [m/s]; a `Reference` has its own.
        learn: whether dead times, lags and lengths are learnt; or identifiers of your own.
        learn_field: whether disturbances are learnt by place and known on the next pass over the
            same line; or the `FieldMap.rows` of an earlier drive.
        detect: whether the built-in detectors of faults run; or a list of the names of those that
            run, of those that do not (`"-drift"`), and of detectors of your own beside them.
        compensate: whether dead times are compensated around a controller by name or factory, see
            `DeadTimeCompensation`; the estimator knows them.

    Raises:
        InvalidReference, InvalidPath: the vehicle cannot follow it: curvature, steering rates,
            speed; the message names the place.
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
        learn_field: bool | FloatArray = False,
        detect: Detect = True,
        compensate: bool = True,
    ) -> None:
        if isinstance(reference, Reference) and reference.vehicle != vehicle:
            raise InvalidReference("reference: was made for another vehicle than the guidance")
        check_drivable(reference if isinstance(reference, Path) else reference.path, vehicle)
        if isinstance(reference, Path):
            reference = Reference(reference, vehicle, ConstantSpeed(speed_mps))
        check_pace(reference, period_s)
        self.period_s = period_s
        self.tick = 0  # number of the next control tick
        self.reference_tick = 0  # of the reference at that tick: those that waited apart
        given = vehicle, reference, period_s, controller, estimator, options
        noise = sensor_noise or SensorNoise()
        self._parts = Parts(*given, noise, tube, learn, learn_field, compensate)
        self._monitors = Monitors(detect)
        reasons = self._monitors.reason
        self._supervisor = Supervisor(self._parts.controller, reference, period_s, safety, reasons)
        self._alarms = np.zeros((0, ALARM))  # of the detectors, since the last update
        self._origin_s: float | None = None  # of the clock
        self._time_s = -math.inf  # of the last update, from the origin
        self.estimate_record = np.empty(0)
        self._innovations = np.empty((0, INNOVATION))  # of the last update
        self._view = None
        self._stale = 0  # steps since the last update
        self._sent = np.full(len(Input), math.nan)  # the last command
        self._control_step = None
        self._notes: tuple[str, ...] = ()  # on what was learnt since the last step
        self.learnt = ()

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
        rows, (now, origin) = sample_rows(measurements), self._now(time_s)
        if origin:
            rows = rows - np.array([origin, 0.0, 0.0, 0.0, 0.0])
        usable = self._monitors.usable(rows)  # without sensors that a detector has excluded
        self._take_on_learnt()
        self._view = None
        self._filter(now, usable)
        self._time_s, self._stale = now, 0
        estimate, vehicle = self.estimate_record, self._parts.vehicle
        self._alarms = alarms = self._monitors.observe(
            rows, now, self._sent, estimate, self._innovations, vehicle, self._seen
        )
        learner, field = self._parts.learner, self._parts.field
        faulty = bool(alarms.size and alarms[:, 0].max() > _WARN)
        if faulty:
            learner.forget()
        if field is not None:
            field.observe(self.reference_tick, estimate, not faulty)
        learner.record(self.tick, now, usable, self._sent, *estimate[_HEADINGS].tolist())
        seen = self._seen()
        return replace(seen, time_s=seen.time_s + origin) if origin else seen

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
        estimate = None if self._stale else self.estimate_record
        now = self._time_s + self._stale * self.period_s
        self._stale += 1
        supervisor = self._supervisor
        k = self.reference_tick
        # The supervisor compares the estimate with tick k of the reference. The controller adds
        # feedforward, feedback (MPC) and robust action; the supervisor limits their sum.
        if supervisor.decide(estimate, k, now, self._alarms):
            supervisor.compute_command(self.estimate_record, k, self._seen)
        self._sent = supervisor.finish()
        self.learnt, self._notes, self._control_step = self._notes, (), None
        self.tick += 1
        self.reference_tick += not supervisor.waits
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
        self._monitors.resume(self.estimate_record.view(ESTIMATE)[0]["map_disturbance"])
        self._supervisor.resume()

    def warm_up(self) -> None:
        """Compile and load everything that `update` and `step` need; changes no later result.

        The first call on a machine compiles for some ten seconds, later ones load the result.

        Raises:
            GuidanceFailed: the estimator or the controller raised.
        """
        with user_part(GuidanceFailed, "warm_up raised"):
            for part in (*self._parts.own, self._supervisor, self._monitors):
                if isinstance(part, WarmingUp):
                    part.warm_up()

    def wait(self) -> None:
        """Wait for what is learnt and due at the next tick; nothing else waits for it.

        For simulations: call it before every `update`, and an exchange has a counted tick, whatever
        the time that computing takes, without limit. A vehicle does not call it: `update` takes
        what was learnt when it is ready.
        """
        self._parts.learner.wait(self.tick)

    def prepare(self) -> None:
        """Do the work of the next `step` that needs no samples, where the controller can.

        Optional: call it while waiting for the samples of the next tick.

        Raises:
            GuidanceFailed: the controller raised.
        """
        with user_part(GuidanceFailed, f"prepare raised at tick {self.tick}"):
            self._supervisor.prepare(self.reference_tick)

    def _now(self, time_s: float) -> tuple[float, float]:
        """Return a time from the first update on [s], and the time of that update [s]."""
        try:
            finite = math.isfinite(time_s)
        except (OverflowError, TypeError) as error:
            raise InvalidTime(f"update: time_s: {error}, must be a finite number") from None
        if not finite:
            raise InvalidTime(f"update: time_s = {time_s}, must be finite")
        if self._origin_s is None:
            self._origin_s = time_s
        # Seconds from the start keep their resolution; those of the Unix epoch have steps of 2e-7.
        now = time_s - self._origin_s
        if (late := self._time_s - now) > 0.0:
            raise InvalidTime(f"update: time_s = {time_s} is {late:g} s before the last update")
        return now, self._origin_s

    def _take_on_learnt(self) -> None:
        """Exchange the parts for those of learnt parameters, if such are due at this tick."""
        new, notes = self._parts.exchange(self.tick, self._sent)
        if new and new.estimator is not None:
            self._monitors.forget_pose()
        if new and new.controller is not None:
            self._supervisor.exchange(new.controller, new.reference)
        self._notes = notes or self._notes

    def _filter(self, now: float, rows: FloatArray) -> None:
        """Run the estimator; a user's gets objects, and its estimate is copied into the record."""
        filter_ = self._parts.estimator
        if isinstance(filter_, ExtendedKalmanFilter) and type(filter_) is ExtendedKalmanFilter:
            field = self._parts.field
            change = NO_CHANGE if field is None else field.change(self.reference_tick)
            self.estimate_record, self._innovations = filter_.observe(now, rows, self._sent, change)
            return
        sent = Command(*self._sent.tolist()) if self.tick else None
        with user_part(EstimatorFailed, f"the estimator raised at {now:.3f} s"):
            estimate: object = filter_.update(now, measurements_of(rows), sent)
        if not isinstance(estimate, Estimate):
            got = type(estimate).__name__
            raise EstimatorFailed(f"the estimator returned {got} at {now:.3f} s, not an Estimate")
        self._view, self.estimate_record = estimate, estimate_row(estimate)
        self._innovations = innovation_rows(estimate.innovations)
