"""The control loop, a period at a time: reference -> filter -> controller (MPC) -> supervisor.

`Guidance.update` and `Guidance.step` are the whole loop, in the order in which data flows. What
each call does is in the file of its object:

- `report.py`: records and views of the last tick, the base class
- `clock.py`: time stamps in seconds from the first update
- `pipeline.py`: vehicle, reference, estimator and controller, and what is learnt of the vehicle
- `../estimation/filter/observe.py`: the filter
- `../detectors/kernel.py`: the detectors of faults
- `supervisor.py` with `decision.py` and `command.py`: checks, and the limits of a command
- `../laws/`, `../mpc/`: the controller
- `dead_time.py`: compensation of the actuators' dead times around a controller
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ..detectors.interface import Reaction
from ..detectors.monitors import Monitors
from ..errors import GuidanceFailed, InvalidReference
from ..layout import (
    ALARM,
    AlarmColumn,
    sample_rows,
)
from ..reference.path import Path
from ..reference.reference import ConstantSpeed, Reference, check_drivable, check_pace
from ..types import (
    Command,
    Estimate,
    FloatArray,
    Measurement,
)
from ..vehicle import Vehicle
from .clock import GuidanceClock
from .controllers import EstimatorFactory
from .own_parts import HasStep, HasUpdate
from .pipeline import ControllerFactory, Pipeline, PipelineRecipe
from .report import GuidanceReport
from .settings import GuidanceSettings
from .state import GuidanceState
from .supervisor import Supervisor
from .user_answer import user_part

_WARN: Final = int(Reaction.WARN)  # an enumeration costs six calls a tick


class Guidance(GuidanceReport):
    """Drives a vehicle along a reference, one control period after the other.

    Every period of `period_s`, call `update` with the samples that arrived since, then `step`:

        >>> from ttempc import Vehicle, figure_eight
        >>> guidance = Guidance(Vehicle(), figure_eight())
        >>> guidance.warm_up()
        >>> estimate = guidance.update(1763775600.0, [])  # time [s], samples since the last call
        >>> guidance.step().delta_t, guidance.diagnostics.fallback
        (0.0, 'no estimate yet: command held')

    `update` runs the estimator and the detectors of faults (`ttempc.detectors`). `step`
    checks the estimate against the reference, asks the controller, and limits its command. On a bad
    estimate, an alarm or a controller far from the reference it holds the command, slows down or
    stops (see `Supervisor`); `diagnostics.fallback` gives the reason.

    Time stamps are seconds on any one clock. The first `update` defines the start of the reference.
    Tick k, the k-th call of `step`, belongs to k * `period_s` on the reference, which waits where
    the supervisor slows or stops the vehicle, and goes with one that does not obey
    (`reference_tick`); a missed period delays it.

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
        settings: everything else, see `GuidanceSettings`.

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
        controller: str | ControllerFactory | HasStep = "ttempc",
        estimator: str | EstimatorFactory | HasUpdate = "ekf",
        settings: GuidanceSettings | None = None,
    ) -> None:
        settings = settings or GuidanceSettings()
        if isinstance(reference, Reference) and reference.vehicle != vehicle:
            raise InvalidReference("reference: was made for another vehicle than the guidance")
        check_drivable(reference if isinstance(reference, Path) else reference.path, vehicle)
        if isinstance(reference, Path):
            reference = Reference(reference, vehicle, ConstantSpeed(settings.speed_mps))
        check_pace(reference, period_s)
        recipe = PipelineRecipe(reference, period_s, controller, estimator, settings)
        pipeline = Pipeline(vehicle, recipe)
        monitors = Monitors(settings.detect, settings.sensor_noise.velocity_wander)
        supervisor = Supervisor(
            pipeline.controller, reference, period_s, settings.safety, monitors.reason
        )
        super().__init__(pipeline, monitors, supervisor, period_s)
        self._clock = GuidanceClock()
        self._steps_since_update = 0
        self._alarms = np.zeros((0, ALARM))  # rows of the detectors, of the last update
        self._notes: tuple[str, ...] = ()  # on what was learnt since the last step

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
        now = self._clock.seconds(time_s)
        rows = self._clock.from_start(rows)
        self._take_on_learnt()

        # The filter gets no samples of sensors that the detectors' last alarms exclude, and no
        # command that they say the vehicle does not obey.
        usable = self._monitors.usable(rows)
        obeyed = self._monitors.obeyed(self._sent)
        self.estimate_record, self._innovations, self._estimate = self._pipeline.observe(
            now, usable, self._sent, obeyed, self.tick, self.reference_tick
        )
        self._clock.updated_s = now
        self._steps_since_update = 0

        # The detectors get all samples, so that the alarm of a sensor can end.
        self._alarms = self._monitors.observe(
            rows,
            now,
            self._sent,
            self.estimate_record,
            self._innovations,
            self._pipeline.vehicle,
            self._seen_estimate,
        )
        self._learn(now, usable)

        estimate = self._seen_estimate()
        return replace(estimate, time_s=estimate.time_s + (self._clock.origin_s or 0.0))

    def step(self) -> Command:
        """Return the command for the period that starts at the time of the last `update`.

        A second step on one update is driven as without an estimate: the command is held for
        `SafetyLimits.blind_s`, then the vehicle stops.

        Raises:
            GuidanceFailed: `update` was not called yet.
            ControllerFailed: the controller raised, or returned no usable step.
        """
        self._clock.require_update("step")
        # Without an update no time has passed by the clock; a period has for the vehicle.
        is_stale = self._steps_since_update > 0
        estimate = None if is_stale else self.estimate_record
        now = self._clock.updated_s + self._steps_since_update * self.period_s
        self._steps_since_update += 1

        # The supervisor compares the estimate with a tick of the reference. The controller adds
        # feedforward, feedback (MPC) and robust action; the supervisor limits their sum.
        supervisor = self._supervisor
        if supervisor.decide(estimate, self.reference_tick, now, self._alarms):
            supervisor.compute_command(
                self.estimate_record, self.reference_tick, self._seen_estimate
            )
        self._sent = supervisor.finish()
        self._pipeline.report_expected(supervisor.tick)

        self.learnt = self._notes
        self._notes = ()
        self._control_step = None
        self.tick += 1
        self.reference_tick += supervisor.reference_ticks
        return Command(*self._sent.tolist())

    def resume(self) -> None:
        """Drive on after a stop: an operator has seen that position and vehicle are in order.

        The present estimate is taken for true and a sensor that contradicted it is used again. An
        alarm whose cause goes on stops the vehicle anew.

        Raises:
            GuidanceFailed: `update` was not called yet.
        """
        self._clock.require_update("resume")
        self._monitors.resume()
        self._supervisor.resume()

    def warm_up(self) -> None:
        """Compile and load everything that `update` and `step` need; changes no later result.

        The first call on a machine compiles for some ten seconds, later ones load the result.

        Raises:
            GuidanceFailed: the estimator or the controller raised.
        """
        with user_part(GuidanceFailed, "warm_up raised"):
            for part in (self._pipeline, self._supervisor, self._monitors):
                part.warm_up()

    def wait(self) -> None:
        """Wait for what is learnt and due at the next tick; nothing else waits for it.

        For simulations: call it before every `update`, and an exchange has a counted tick, whatever
        the time that computing takes, without limit. A vehicle does not call it: `update` takes
        what was learnt when it is ready.
        """
        self._pipeline.learner.wait(self.tick)

    def prepare(self) -> None:
        """Do the work of the next `step` that needs no samples, where the controller can.

        Optional: call it while waiting for the samples of the next tick.

        Raises:
            GuidanceFailed: the controller raised.
        """
        with user_part(GuidanceFailed, f"prepare raised at tick {self.tick}"):
            self._supervisor.prepare(self.reference_tick)

    @property
    def state(self) -> GuidanceState:
        """Memory of the guidance; it changes with every tick, its `copy` does not."""
        return GuidanceState(
            tick=self.tick,
            reference_tick=self.reference_tick,
            origin_s=self._clock.origin_s,
            updated_s=self._clock.updated_s,
            steps_since_update=self._steps_since_update,
            sent=self._sent,
            estimate=self.estimate_record,
            innovations=self._innovations,
            alarms=self._alarms,
            estimator=self._pipeline.estimator.memory(),
            detectors=self._monitors.memory(),
            supervisor=self._supervisor.memory(),
            controller=self._supervisor.controller.memory(),
            foresight=self._pipeline.foresight_memory(),
        )

    def restore(self, state: GuidanceState) -> None:
        """Go on from a state of this guidance, or of one that was made alike; nothing is shared.

        The learner forgets what it has recorded.
        """
        self.tick = state.tick
        self.reference_tick = state.reference_tick
        self._clock.origin_s = state.origin_s
        self._clock.updated_s = state.updated_s
        self._steps_since_update = state.steps_since_update
        self._sent = state.sent.copy()
        self.estimate_record = state.estimate.copy()
        self._innovations = state.innovations.copy()
        self._alarms = state.alarms.copy()
        self._estimate = None
        self._control_step = None
        self._pipeline.estimator.restore(state.estimator)
        self._pipeline.learner.forget()
        self._monitors.restore(state.detectors)
        self._supervisor.restore(state.supervisor)
        self._supervisor.controller.restore(state.controller)
        self._pipeline.restore_foresight(state.foresight)

    def _take_on_learnt(self) -> None:
        """Exchange the parts for those of learnt parameters, if such are due at this tick."""
        new, notes = self._pipeline.exchange(self.tick, self._sent)
        if new is not None and new.estimator is not None:
            self._monitors.forget_pose()
        if new is not None and new.controller is not None:
            self._supervisor.exchange(new.controller, new.reference)
        self._notes = notes or self._notes

    def _learn(self, now: float, rows: FloatArray) -> None:
        """Record the tick for the learner; a vehicle with a fault teaches nothing."""
        reactions = self._alarms[:, AlarmColumn.REACTION]
        is_faulty = bool(reactions.size and reactions.max() > _WARN)
        self._pipeline.learn(
            self.tick, now, rows, self._sent, self.estimate_record, self.reference_tick, is_faulty
        )
