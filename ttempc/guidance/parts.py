"""Estimator and controller of a guidance, and their exchange for learnt parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..estimation.noise import SensorNoise
from ..learning.learner import Identifier, Learner
from ..learning.window import RecordedTick
from ..reference.reference import Reference, check_drivable, check_pace
from ..types import Command, Controller, Estimator, FloatArray, WarmingUp
from ..vehicle import Vehicle
from .controllers import EstimatorFactory, estimator_factory, make_controller
from .dead_time import DeadTimeCompensation, Guided, compensated, lead_s, resume

if TYPE_CHECKING:
    from ..learning.field import FieldMap
    from ..tube.reference_tube import TubeDesign

ControllerFactory = Callable[..., Controller]
"""Makes a controller from vehicle, reference and control period [s], options as keywords."""


@dataclass(frozen=True, slots=True)
class Built:
    """Parts for one vehicle; None where the user gave an object, which stays."""

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
    compensate: bool,
) -> Guided:
    """Return the controller of a name or factory, its dead times compensated, or the object."""
    if not compensate:  # it is told of none
        reference = replace(reference, vehicle=reference.vehicle.without_dead_times())
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
    compensate: bool

    def build(self, vehicle: Vehicle) -> Built:
        reference = replace(self.reference, vehicle=vehicle)
        check_drivable(reference.path, vehicle)
        check_pace(reference, self.period_s)
        tube = self.tube and replace(self.tube, vehicle=vehicle.without_dead_times())
        controller = estimator = None
        if self.controller is not None:
            controller = make_guided(
                self.controller, reference, self.period_s, self.options, tube, self.compensate
            )
            if isinstance(controller, WarmingUp):
                controller.warm_up()
        if self.estimator is not None:
            estimator = make_estimator(self.estimator, vehicle, self.noise)
        return Built(reference, controller, estimator)

    def replay(self, parts: Built, window: Sequence[RecordedTick]) -> None:
        if parts.estimator is not None:
            for tick in window:
                parts.estimator.update(tick.time_s, tick.samples, tick.command)


def _identifiers(vehicle: Vehicle, noise: SensorNoise) -> list[Identifier]:
    from ..learning.actuators import ActuatorIdentifier
    from ..learning.lengths import LengthIdentifier

    # The lengths last: their fit replays the commands as they act.
    return [ActuatorIdentifier(), LengthIdentifier(vehicle, noise)]


class Parts:
    """Vehicle, reference, estimator and controller of a guidance; arguments as of `Guidance`.

    `exchange` replaces all four by those for the parameters that `learner` has found.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference,
        period_s: float,
        controller: str | ControllerFactory | Guided,
        estimator: str | EstimatorFactory | Estimator,
        options: Mapping[str, object] | None,
        noise: SensorNoise,
        tube: TubeDesign | None,
        learn: bool | Sequence[Identifier],
        learn_field: bool | FloatArray,
        compensate: bool,
    ) -> None:
        self.vehicle, self.reference = vehicle, reference
        self.estimator = make_estimator(estimator, vehicle, noise)
        self.controller = make_guided(controller, reference, period_s, options, tube, compensate)
        if isinstance(learn, bool):
            learn = _identifiers(vehicle, noise) if learn else []
        builder = _Builder(
            None if self.controller is controller else controller,
            None if self.estimator is estimator else estimator,
            reference,
            period_s,
            options,
            tube,
            noise,
            compensate,
        )
        self.learner = Learner(learn, vehicle, period_s, builder)
        self.field: FieldMap | None = None
        if learn_field is not False:
            from ..laws.tracking_controller import TrackingController
            from ..learning.field import FieldMap

            earlier = None if learn_field is True else learn_field
            self.field = FieldMap(reference, period_s, lead_s(vehicle), earlier)
            inner = self.controller
            inner = inner.controller if isinstance(inner, DeadTimeCompensation) else inner
            if isinstance(inner, TrackingController):
                inner.feedback.field = self.field

    @property
    def own(self) -> tuple[object, ...]:
        """What may need a warm-up."""
        return self.estimator, self.controller, self.field

    def exchange(self, tick: int, sent: FloatArray) -> tuple[Built | None, tuple[str, ...]]:
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
        new, notes = learnt.parts, [str(change) for change in learnt.changes]
        if new.estimator is None:
            notes.append("the estimator was given as an object and stays as it is")
        else:
            self.estimator = new.estimator
        if new.controller is None:
            notes.append("the controller was given as an object and stays as it is")
        else:
            resume(new.controller, self.controller, [*learnt.sent, Command(*sent.tolist())])
            self.controller, self.reference = new.controller, new.reference
        self.vehicle = learnt.vehicle
        if self.field is not None:
            self.field.exchange(self.vehicle, lead_s(self.vehicle))
        return new, tuple(notes)
