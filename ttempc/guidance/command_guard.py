"""Command guard: checks the steps of any controller and limits their commands."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Final

import numpy as np

from ..errors import ControllerFailed
from ..limits import CommandLimits
from ..types import (
    Command,
    Controller,
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    SolverReport,
    TubeReport,
)
from .user_part import user_part

_SHAPES: Final[dict[str, tuple[int | None, ...]]] = {
    "feedforward": (3,),
    "feedback": (3,),
    "robust": (3,),
    "limited": (3,),
    "tracking_error": (7,),
    "modelling_error": (4,),
    "predicted_path": (None, 4),
}
_TUBE_SHAPES: Final = {"nominal": (9,), "half_width": (9,)}
_SOLVER_NUMBERS: Final = (
    "accepted",
    "iterations",
    "primal_residual",
    "dual_residual",
    "solve_time_s",
)
_MOST_POINTS: Final = 10_000  # of a predicted path
_MOST_TEXT: Final = 1000  # characters of a reason
_NUMBER: Final = (int, float, np.number, np.bool_)
_OPTIONAL: Final = {"tracking_error", "modelling_error", "predicted_path"}
_ROUNDING: Final = 1e-9  # an excess over a limit below this is not reported


class CommandGuard:
    """Asks a controller for its step and returns one that can be driven and logged.

    A command beyond an amplitude or a rate is cut to the nearest allowed one. An entry that is
    not finite keeps its value of the tick before, 0 at the first tick. Both are reported in
    `Diagnostics.fallback` and `Diagnostics.limited`.
    """

    def __init__(self, controller: Controller, limits: CommandLimits) -> None:
        self._controller = controller
        self._limits = limits
        self._previous: FloatArray | None = None

    def exchange(self, controller: Controller, limits: CommandLimits) -> None:
        """Ask another controller from now on; its first step is limited from the last command."""
        self._controller, self._limits = controller, limits

    def step(self, estimate: Estimate, k: int) -> ControlStep:
        """Return the step of tick `k` with a command within the limits.

        Raises:
            ControllerFailed: the controller raised, or returned neither a `Command` nor a
                `ControlStep` with numbers and arrays of the documented shapes.
        """
        with user_part(ControllerFailed, f"the controller raised at tick {k}"):
            answer: object = self._controller.step(estimate, k)
        step = _checked(answer, k)
        desired = _numbers(step.command, k)
        allowed = self._allowed(desired)
        self._previous = allowed
        pairs = zip(allowed.tolist(), desired.tolist(), strict=True)
        beyond = [not abs(cut - own) <= _ROUNDING for cut, own in pairs]  # NaN is beyond
        if not any(beyond):
            return step
        reasons = ", ".join(self._reason(desired, i) for i, out in enumerate(beyond) if out)
        note = f"the controller's {reasons}: cut"
        diagnostics = replace(
            step.diagnostics,
            limited=np.asarray(step.diagnostics.limited, dtype=np.bool_) | np.array(beyond),
            fallback="; ".join(filter(None, (step.diagnostics.fallback, note))),
        )
        return ControlStep(Command(*allowed.tolist()), diagnostics)

    def _reason(self, desired: FloatArray, entry: int) -> str:
        """Return the name of an entry of the command, and why it is not driven as it is."""
        value, name = desired.item(entry), fields(Command)[entry].name
        if not math.isfinite(value):
            return f"{name} not finite"
        low, high = self._limits.lower.item(entry), self._limits.upper.item(entry)
        return f"{name} beyond its {'rate' if low <= value <= high else 'range'}"

    def _allowed(self, desired: FloatArray) -> FloatArray:
        """Return the allowed command nearest to `desired`, (3,)."""
        if self._previous is not None:
            return self._limits.apply(desired, self._previous)[0]
        return self._limits.clamp(np.where(np.isfinite(desired), desired, 0.0))


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
    if path is not None and not (len(path) <= _MOST_POINTS and np.isfinite(path).all()):
        raise ControllerFailed(
            f"{about}: diagnostics.predicted_path must be finite, {_MOST_POINTS} points at most"
        )
    if not (tube is None or isinstance(tube, TubeReport)):
        raise ControllerFailed(f"{about}: diagnostics.tube must be a TubeReport or None")
    for name, shape in _TUBE_SHAPES.items() if tube else ():
        _check_array(about, f"tube.{name}", getattr(tube, name), shape)
    if not (solver is None or isinstance(solver, SolverReport)):
        raise ControllerFailed(f"{about}: diagnostics.solver must be a SolverReport or None")
    numbers = [getattr(solver, name) for name in _SOLVER_NUMBERS] if solver else []
    numbers += [tube.margin, tube.inside] if tube else []
    if not all(isinstance(value, _NUMBER) for value in numbers):
        raise ControllerFailed(f"{about}: diagnostics: {numbers} must be numbers")
    if not _is_text(diagnostics.fallback):
        raise ControllerFailed(
            f"{about}: diagnostics.fallback must be text of {_MOST_TEXT} characters at most"
        )
    if not all(map(_is_text, diagnostics.learnt)):
        raise ControllerFailed(f"{about}: diagnostics.learnt must be texts")
    return answer


def _numbers(command: Command, k: int) -> FloatArray:
    try:
        return np.array([float(command.delta_t), float(command.delta_i), float(command.hp)])
    except (TypeError, ValueError) as error:
        raise ControllerFailed(
            f"the controller's step at tick {k}: {command} is not of numbers: {error}"
        ) from None


def _check_array(about: str, name: str, value: object, shape: tuple[int | None, ...]) -> None:
    """Refuse what is not an array of real numbers of a shape; None stands for any length."""
    if not isinstance(value, np.ndarray) or not _fits(value.shape, shape):
        raise ControllerFailed(
            f"{about}: diagnostics.{name} must be an array of shape {shape}, got {value!r:.200}"
        )
    if value.dtype.kind not in "biuf":
        raise ControllerFailed(f"{about}: diagnostics.{name} must hold numbers, got {value.dtype}")


def _is_text(value: object) -> bool:
    """Whether a value is text that can be logged; lone surrogates cannot be encoded."""
    return (
        isinstance(value, str)
        and len(value) <= _MOST_TEXT
        and (value.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in value))
    )


def _fits(shape: tuple[int, ...], allowed: tuple[int | None, ...]) -> bool:
    return shape == allowed or (
        len(shape) == len(allowed)
        and all(size is None or entry == size for entry, size in zip(shape, allowed, strict=True))
    )
