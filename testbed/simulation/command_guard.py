"""The border between a controller and the plant: whatever comes over it can be driven and logged.

A controller may be anyone's. What it decides is checked here, once every control period, so that
no command leaves the vehicle's limits and no mistake of a controller costs the log.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from ttempc.types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    SolverReport,
)
from ttempc.vehicle import Vehicle

from ..errors import ControllerFailed

_ACTIONS: Final = ("feedforward", "feedback", "robust", "limited")
_ROUNDING: Final = 1e-9  # less than this beyond a limit is no news


@dataclass(frozen=True, slots=True)
class Border:
    """What a command must keep to: the amplitudes and rates of the vehicle as believed."""

    vehicle: Vehicle
    period_s: float

    def ask(
        self, controller: Controller, estimate: Estimate, k: int, previous: Command | None
    ) -> ControlStep:
        """Return the step of `controller` at tick `k`, its command within the limits.

        A command beyond a limit is cut to it. An entry that is not finite stays what it was, at
        the first tick 0. Either is said in the diagnostics, as a fallback.

        Raises:
            ControllerFailed: the controller raised, or what it returned is no `ControlStep` that
                could be driven and written down.
        """
        try:
            made = controller.step(estimate, k)
        except Exception as error:  # whatever a controller of anyone's raises ends the run
            raise ControllerFailed(
                f"the controller raised at tick {k}: {type(error).__name__}: {error}"
            ) from error
        wanted = _command(made, k)
        sent = self._allowed(wanted, previous)
        beyond = ~(np.abs(sent - wanted) <= _ROUNDING)  # NaN is beyond
        if not beyond.any():
            return made
        names = [item.name for item, out in zip(fields(Command), beyond, strict=True) if out]
        said = f"the controller's {', '.join(names)} outside the limits or not finite: cut"
        diagnostics = replace(
            made.diagnostics,
            limited=np.asarray(made.diagnostics.limited, dtype=np.bool_) | beyond,
            fallback="; ".join(filter(None, (made.diagnostics.fallback, said))),
        )
        return ControlStep(Command(*sent.tolist()), diagnostics)

    def _allowed(self, wanted: FloatArray, previous: Command | None) -> FloatArray:
        """Return the allowed command nearest to `wanted`, (3,)."""
        low, high = self.vehicle.input_min, self.vehicle.input_max
        held = np.clip(np.zeros(3), low, high)
        if previous is not None:
            held, reach = previous.as_array(), self.vehicle.input_rate * self.period_s
            low, high = np.maximum(low, held - reach), np.minimum(high, held + reach)
        return np.minimum(np.maximum(np.where(np.isfinite(wanted), wanted, held), low), high)


def _command(made: object, k: int) -> FloatArray:
    """Return the command of a step that can be driven and written down, (3,).

    Raises:
        ControllerFailed: it is none.
    """
    if not isinstance(made, ControlStep):
        raise ControllerFailed(
            f"the controller returned {type(made).__name__} at tick {k}, must be a ControlStep"
        )
    said, about = made.diagnostics, f"the controller's step at tick {k}"
    if not isinstance(made.command, Command) or not isinstance(said, Diagnostics):
        raise ControllerFailed(f"{about}: must hold a Command and Diagnostics, got {made!r}")
    shapes: dict[str, tuple[int | None, ...]] = dict.fromkeys(_ACTIONS, (3,))
    if said.tracking_error is not None:
        shapes["tracking_error"] = (7,)
    if said.modelling_error is not None:
        shapes["modelling_error"] = (4,)
    if said.predicted_path is not None:
        shapes["predicted_path"] = (None, 4)
    for name, shape in shapes.items():
        got = getattr(said, name)
        if not isinstance(got, np.ndarray) or not _fits(got.shape, shape):
            raise ControllerFailed(
                f"{about}: diagnostics.{name} must be an array of shape {shape}, got {got!r}"
            )
    if not isinstance(said.solver, SolverReport | None) or not isinstance(said.fallback, str):
        raise ControllerFailed(
            f"{about}: diagnostics.solver must be a SolverReport or None and fallback text"
        )
    try:
        return np.array([float(value) for value in made.command.as_array()])
    except (TypeError, ValueError) as error:
        raise ControllerFailed(f"{about}: {made.command} is not of numbers: {error}") from None


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(
        want is None or have == want for have, want in zip(shape, wanted, strict=True)
    )
