"""Parts of a guidance: estimator and controller by name, by factory, or as they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..estimation.noise import SensorNoise
from ..reference.reference import Reference
from ..tube.reference_tube import TubeDesign
from ..types import Controller, Estimator
from ..vehicle import Vehicle
from .controllers import make_controller
from .dead_time import compensated
from .estimators import EstimatorFactory, estimator_factory

ControllerFactory = Callable[..., Controller]
"""Makes a controller from vehicle, reference and control period [s], options as keywords."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Parts of a guidance for one vehicle; None where the user gave an object, which stays."""

    reference: Reference
    controller: Controller | None
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
    controller: str | ControllerFactory | Controller,
    reference: Reference,
    period_s: float,
    options: Mapping[str, object] | None,
    tube: TubeDesign | None,
) -> Controller:
    """Return the controller of a name or factory with its dead times compensated, or the object."""
    if not isinstance(controller, str | type) and hasattr(controller, "step"):
        return controller  # pyright: ignore[reportReturnType] - it has `step`

    def make(vehicle: Vehicle, reference: Reference) -> Controller:
        if isinstance(controller, str):
            return make_controller(controller, vehicle, reference, period_s, tube, options)
        return controller(vehicle, reference, period_s, **(options or {}))  # pyright: ignore[reportCallIssue] - a factory

    return compensated(make, reference, period_s)
