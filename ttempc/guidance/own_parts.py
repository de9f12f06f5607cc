"""Controllers and estimators of a user that derive from nothing."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Protocol

from ..types import Command, Controller, ControlStep, Estimate, Estimator, Measurement


class HasStep(Protocol):
    """What the guidance needs of a controller."""

    def step(self, estimate: Estimate, k: int) -> ControlStep | Command:
        """Return the command of tick `k`, see `Controller.step`."""
        ...


class HasUpdate(Protocol):
    """What the guidance needs of an estimator."""

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        """Return the estimate at `time_s`, see `Estimator.update`."""
        ...


def as_controller(given: HasStep) -> Controller:
    """Return a controller with all methods of `Controller`; the object itself if it has them."""
    return given if isinstance(given, Controller) else OwnController(given)


def as_estimator(given: HasUpdate) -> Estimator:
    """Return an estimator with all methods of `Estimator`; the object itself if it has them."""
    return given if isinstance(given, Estimator) else OwnEstimator(given)


class OwnController(Controller):
    """A user's object with `step`; methods that it lacks do nothing."""

    def __init__(self, given: HasStep) -> None:
        self.given = given
        self.space_based = bool(getattr(given, "space_based", False))

    def step(self, estimate: Estimate, k: int) -> ControlStep | Command:
        return self.given.step(estimate, k)

    def prepare(self, k: int) -> None:
        _call_if_present(self.given, "prepare", k)

    def resume(self, previous: object) -> None:
        before = previous.given if isinstance(previous, OwnController) else previous
        _call_if_present(self.given, "resume", before)

    def warm_up(self) -> None:
        _call_if_present(self.given, "warm_up")

    def memory(self) -> object:
        return self.given

    def restore(self, memory: Any) -> None:  # noqa: ANN401 - the user's object
        self.given = copy.deepcopy(memory)


class OwnEstimator(Estimator):
    """A user's object with `update`; `warm_up` does nothing where it is missing."""

    def __init__(self, given: HasUpdate) -> None:
        self.given = given

    def update(
        self, time_s: float, measurements: Sequence[Measurement], command: Command | None
    ) -> Estimate:
        return self.given.update(time_s, measurements, command)

    def warm_up(self) -> None:
        _call_if_present(self.given, "warm_up")

    def memory(self) -> object:
        return self.given

    def restore(self, memory: Any) -> None:  # noqa: ANN401 - the user's object
        self.given = copy.deepcopy(memory)


def _call_if_present(given: object, name: str, *arguments: object) -> None:
    method = getattr(given, name, None)
    if method is not None:
        method(*arguments)
