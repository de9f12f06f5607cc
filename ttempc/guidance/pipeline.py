"""Estimator and controller of a guidance, and their exchange for learnt parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from ..errors import EstimatorFailed
from ..estimation.ekf import NO_CHANGE, ExtendedKalmanFilter
from ..estimation.noise import SensorNoise
from ..laws.tracking_controller import TrackingController
from ..layout import (
    ESTIMATE,
    EXPECTED,
    TICK,
    estimate_row,
    innovation_rows,
    measurements_of,
)
from ..learning.curve_slip import CurveSlip
from ..learning.field import FieldMap
from ..learning.foresight import Foresight
from ..learning.learner import Identifier, Learner
from ..learning.window import RecordedTick
from ..reference.reference import Reference, check_drivable, check_pace
from ..types import Command, Controller, Estimate, Estimator, FloatArray, State
from ..vehicle import Vehicle
from .controllers import CONTROLLERS, EstimatorFactory, estimator_factory, make_controller
from .dead_time import DeadTimeCompensation, GuidedController, compensated, lead_s, resume
from .own_parts import HasStep, HasUpdate, as_controller, as_estimator
from .settings import GuidanceSettings
from .user_answer import user_part

_FIRST_EXPECTED: Final = (TICK.fields or {})["expected"][1] // 8
_EXPECTED: Final = slice(_FIRST_EXPECTED, _FIRST_EXPECTED + EXPECTED.itemsize // 8)

ControllerFactory = Callable[..., HasStep]
"""Makes a controller from vehicle, reference and control period [s], options as keywords."""


@dataclass(frozen=True, slots=True)
class PipelineCandidate:
    """Parts for one vehicle; None where the user gave an object, which stays."""

    reference: Reference
    controller: GuidedController | None
    estimator: Estimator | None


@dataclass(frozen=True, slots=True)
class PipelineRecipe:
    """Describes how the parts of a guidance are made, for any vehicle; arguments of `Guidance`.

    As a `Builder` it makes parts for learnt parameters. It knows nothing of the guidance, which
    the learner's thread would keep alive.
    """

    reference: Reference
    period_s: float
    controller: str | ControllerFactory | HasStep
    estimator: str | EstimatorFactory | HasUpdate
    settings: GuidanceSettings

    @property
    def has_own_controller(self) -> bool:
        """Whether the controller was given as an object."""
        is_recipe = isinstance(self.controller, str | type)
        return not is_recipe and hasattr(self.controller, "step")

    @property
    def has_own_estimator(self) -> bool:
        """Whether the estimator was given as an object."""
        is_recipe = isinstance(self.estimator, str | type)
        return not is_recipe and hasattr(self.estimator, "update")

    @property
    def foresees(self) -> bool:
        """Whether the trailer's slip is foretold; by default the controller's entry says it."""
        if self.settings.foresee is not None:
            return self.settings.foresee
        entry = CONTROLLERS.get(self.controller) if isinstance(self.controller, str) else None
        return entry is not None and entry.foresees

    def make_estimator(self, vehicle: Vehicle) -> Estimator:
        """Return the estimator of a name or a factory, or the object itself."""
        given = self.estimator
        if self.has_own_estimator:
            return as_estimator(given)  # pyright: ignore[reportArgumentType] - it has `update`
        factory = estimator_factory(given) if isinstance(given, str) else given
        return as_estimator(factory(vehicle, self.settings.sensor_noise))  # pyright: ignore[reportCallIssue] - a factory

    def make_controller(self, reference: Reference) -> GuidedController:
        """Return the controller of a name or factory, its dead times compensated, or the object."""
        given = self.controller
        if self.has_own_controller:
            return as_controller(given)  # pyright: ignore[reportArgumentType] - it has `step`
        if not self.settings.compensate:  # the controller is told of no dead times
            reference = replace(reference, vehicle=reference.vehicle.without_dead_times())
        return compensated(self._make_for, reference, self.period_s)

    def _make_for(self, vehicle: Vehicle, reference: Reference) -> Controller:
        """Return the controller of a name or a factory."""
        given = self.controller
        options = self.settings.options
        if isinstance(given, str):
            tube = self.settings.tube
            return make_controller(given, vehicle, reference, self.period_s, tube, options)
        made = given(vehicle, reference, self.period_s, **options)  # pyright: ignore[reportCallIssue] - a factory
        return as_controller(made)

    def _with_tube_of(self, vehicle: Vehicle) -> PipelineRecipe:
        """Return the recipe with its tube for learnt parameters: its widths stay as fitted."""
        tube = self.settings.tube
        if tube is None:
            return self
        learnt = replace(tube, vehicle=vehicle.without_dead_times())
        return replace(self, settings=replace(self.settings, tube=learnt))

    def build(self, vehicle: Vehicle) -> PipelineCandidate:
        """Return new parts for a vehicle, see `Builder.build`."""
        reference = replace(self.reference, vehicle=vehicle)
        check_drivable(reference.path, vehicle)
        check_pace(reference, self.period_s)

        controller = None
        if not self.has_own_controller:
            controller = self._with_tube_of(vehicle).make_controller(reference)
            controller.warm_up()
        estimator = None if self.has_own_estimator else self.make_estimator(vehicle)
        return PipelineCandidate(reference, controller, estimator)

    def replay(self, parts: PipelineCandidate, window: Sequence[RecordedTick]) -> None:
        """Let a new estimator receive recorded ticks, see `Builder.replay`."""
        if parts.estimator is None:
            return
        for tick in window:
            parts.estimator.update(tick.time_s, tick.samples, tick.command)


def _identifiers(vehicle: Vehicle, noise: SensorNoise) -> list[Identifier]:
    from ..learning.actuators import ActuatorIdentifier
    from ..learning.lengths import LengthIdentifier

    # The lengths last: their fit replays the commands as they act.
    return [ActuatorIdentifier(), LengthIdentifier(vehicle, noise)]


class Pipeline:
    """Vehicle, reference, estimator and controller of a guidance.

    `exchange` replaces all four by those for the parameters that `learner` has found.
    """

    def __init__(self, vehicle: Vehicle, recipe: PipelineRecipe) -> None:
        settings = recipe.settings
        self.vehicle = vehicle
        self.reference = recipe.reference
        self.estimator = recipe.make_estimator(vehicle)
        self.controller = recipe.make_controller(recipe.reference)

        identifiers = settings.learn
        if isinstance(identifiers, bool):
            noise = settings.sensor_noise
            identifiers = _identifiers(vehicle, noise) if identifiers else []
        self.learner = Learner(identifiers, vehicle, recipe.period_s, recipe)

        self.field: FieldMap | None = None
        if settings.learn_field is not False:
            earlier = None if settings.learn_field is True else settings.learn_field
            self.field = FieldMap(recipe.reference, recipe.period_s, lead_s(vehicle), earlier)
        # A map has the slip of its curves, too: beside it the same slip would count twice
        self.curve_slip: CurveSlip | None = None
        if self.field is None and (vehicle.compliance_t or vehicle.compliance_i):
            self.curve_slip = CurveSlip(recipe.reference, recipe.period_s, lead_s(vehicle))
        self.foresight: Foresight | None = None
        if recipe.foresees:
            self.foresight = Foresight(vehicle, recipe.period_s, lead_s(vehicle))
        self._show_changes_to_the_law()

    @property
    def _of_reference(self) -> list[FieldMap | CurveSlip]:
        """Sources of changes of disturbances that are known beforehand along the reference."""
        return [source for source in (self.field, self.curve_slip) if source is not None]

    @property
    def _expected(self) -> list[FieldMap | CurveSlip | Foresight]:
        """All sources of changes that a plan may foresee."""
        if self.foresight is None:
            return [*self._of_reference]
        return [*self._of_reference, self.foresight]

    def _show_changes_to_the_law(self) -> None:
        """Let a law of the library plan with the disturbances that are expected."""
        inner = self.controller
        if isinstance(inner, DeadTimeCompensation):
            inner = inner.controller
        if isinstance(inner, TrackingController):
            inner.feedback.expect(self._expected)

    def warm_up(self) -> None:
        """Compile or load what the parts need; changes no later result."""
        self.estimator.warm_up()
        self.controller.warm_up()
        for source in self._expected:
            source.warm_up()

    def observe(
        self,
        now: float,
        rows: FloatArray,
        sent: FloatArray,
        obeyed: FloatArray,
        tick: int,
        reference_tick: int,
    ) -> tuple[FloatArray, FloatArray, Estimate | None]:
        """Run the estimator to a time; return `ESTIMATE`, rows of innovations, and its own object.

        A user's estimator gets objects, and its estimate is copied into the record. It gets the
        command that was `sent`, the filter the one that is `obeyed`, NaN where an input is not.

        Raises:
            EstimatorFailed: the estimator raised, or returned no `Estimate`.
        """
        estimator = self.estimator
        if type(estimator) is ExtendedKalmanFilter:  # one that derives from it has an own `update`
            change = sum(
                (source.change(reference_tick) for source in self._of_reference), NO_CHANGE
            )
            return *estimator.observe(now, rows, obeyed, change), None

        command = Command(*sent.tolist()) if tick else None
        with user_part(EstimatorFailed, f"the estimator raised at {now:.3f} s"):
            estimate: object = estimator.update(now, measurements_of(rows), command)
        if not isinstance(estimate, Estimate):
            got = type(estimate).__name__
            raise EstimatorFailed(f"the estimator returned {got} at {now:.3f} s, not an Estimate")
        return estimate_row(estimate), innovation_rows(estimate.innovations), estimate

    def learn(
        self,
        tick: int,
        now: float,
        rows: FloatArray,
        sent: FloatArray,
        estimate: FloatArray,
        reference_tick: int,
        is_faulty: bool,
    ) -> None:
        """Hand a tick to the learners of the vehicle and of the field; a fault teaches nothing."""
        if is_faulty:
            self.learner.forget()
        for source in self._of_reference:
            source.observe(reference_tick, estimate, not is_faulty)
        if self.foresight is not None:
            self.foresight.observe(rows, estimate, not is_faulty)
        state = estimate.view(ESTIMATE)[0]["state"]
        headings = (float(state[State.PSI_T]), float(state[State.PSI_I]))
        self.learner.record(tick, now, rows, sent, *headings)

    def foresight_memory(self) -> tuple[FloatArray, ...] | None:
        """Return the memory of the foresight, None without one."""
        return None if self.foresight is None else self.foresight.memory()

    def restore_foresight(self, memory: tuple[FloatArray, ...] | None) -> None:
        """Let the foresight go on from a memory."""
        if self.foresight is not None and memory is not None:
            self.foresight.restore(memory)

    def report_expected(self, tick: FloatArray) -> None:
        """Write what the foresight expected at a step into its record `TICK`."""
        if self.foresight is not None:
            tick[_EXPECTED] = self.foresight.expected

    def exchange(
        self, tick: int, sent: FloatArray
    ) -> tuple[PipelineCandidate | None, tuple[str, ...]]:
        """Take on what is learnt and due at a tick; return it, and the notes on it.

        The new controller continues after the present one and the command (3,) `sent` last.
        """
        try:
            learnt = self.learner.exchange(tick)
        except Exception as error:  # a user's factory may raise anything; the old parts drive on
            return None, (f"nothing more: {type(error).__name__}: {error}",)
        if learnt is None:
            overdue = self.learner.overdue(tick)
            late = "nothing yet: an identifier has not returned for a minute"
            return None, (late,) if overdue else ()

        new = learnt.parts
        notes = [str(change) for change in learnt.changes]
        if new.estimator is None:
            notes.append("the estimator was given as an object and stays as it is")
        else:
            self.estimator = new.estimator
        if new.controller is None:
            notes.append("the controller was given as an object and stays as it is")
        else:
            resume(new.controller, self.controller, [*learnt.sent, Command(*sent.tolist())])
            self.controller = new.controller
            self.reference = new.reference
        self.vehicle = learnt.vehicle
        for source in self._expected:
            source.exchange(self.vehicle, lead_s(self.vehicle))
        self._show_changes_to_the_law()
        return new, tuple(notes)
