"""Check of what a user's controller returns, before it is driven and logged."""

from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np

from ..errors import ControllerFailed, GuidanceFailed
from ..types import Command, ControlStep, Diagnostics, FloatArray

_VECTORS: Final = ("feedforward", "feedback", "robust", "limited")
_NUMBERS: Final = (
    "tube.inside",
    "tube.margin",
    "solver.accepted",
    "solver.iterations",
    "solver.solve_time_s",
    "solver.primal_residual",
    "solver.dual_residual",
)
_SHAPES: Final[dict[str, tuple[int | None, ...]]] = {
    **dict.fromkeys(_VECTORS, (3,)),
    "tracking_error": (7,),
    "modelling_error": (4,),
    "predicted_path": (None, 4),
    "tube.nominal": (9,),
    "tube.half_width": (9,),
    **dict.fromkeys(_NUMBERS, ()),
}
"""Shapes of what is logged of `Diagnostics`; None: any length."""
_OPTIONAL: Final = {"tracking_error", "modelling_error", "predicted_path", "tube", "solver"}
_MOST_POINTS: Final = 10_000  # of a predicted path
_MOST_TEXT: Final = 1000  # characters of a reason


class Answer(NamedTuple):
    """Checked answer of a user's controller."""

    command: FloatArray  # (3,), of any size
    diagnostics: Diagnostics  # empty ones for a bare command


@contextmanager
def user_part(error: type[GuidanceFailed], what: str) -> Iterator[None]:
    """Convert whatever a user's part raises to `error`; `what` was called starts the message.

    `SystemExit` and other exceptions that do not derive from `Exception` are converted, too: they
    would end the program of the caller. An interrupt is the caller's own and passes.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as reason:
        raise error(f"{what}: {type(reason).__name__}: {reason}") from reason


def checked_answer(answer: object, tick: int) -> Answer:
    """Return command and diagnostics of a controller's answer at a tick.

    Raises:
        ControllerFailed: it is no step that could be driven and logged.
    """
    step = ControlStep(answer) if isinstance(answer, Command) else answer
    about = f"the controller's step at tick {tick}: "
    if not isinstance(step, ControlStep):
        raise ControllerFailed(
            f"{about}must be Command or ControlStep, got {type(answer).__name__}"
        )
    command = step.command
    diagnostics = step.diagnostics
    if not isinstance(command, Command) or not isinstance(diagnostics, Diagnostics):
        raise ControllerFailed(f"{about}must hold Command and Diagnostics, got {answer!r:.200}")
    _check_numbers(diagnostics, about)
    _check_path(diagnostics.predicted_path, about)
    _check_text(diagnostics, about)
    try:
        numbers = [float(command.delta_t), float(command.delta_i), float(command.hp)]
    except (TypeError, ValueError) as error:
        raise ControllerFailed(f"{about}{command} is not of numbers: {error}") from None
    return Answer(np.array(numbers), diagnostics)


def _check_numbers(diagnostics: Diagnostics, about: str) -> None:
    """Refuse what is not an array of numbers of the shape that is logged."""
    for name, shape in _SHAPES.items():
        part = name.partition(".")[0]
        if part in _OPTIONAL and getattr(diagnostics, part) is None:
            continue
        try:
            value = attrgetter(name)(diagnostics)
        except AttributeError as error:
            raise ControllerFailed(f"{about}diagnostics.{name}: {error}") from None
        if not _fits(value, shape):
            raise ControllerFailed(
                f"{about}diagnostics.{name} must hold numbers of shape {shape}, got {value!r:.200}"
            )


def _fits(value: object, shape: tuple[int | None, ...]) -> bool:
    """Return whether a value is a number, or an array of numbers, of a shape."""
    array = value
    if not shape and np.ndim(value) == 0:  # pyright: ignore[reportArgumentType] - anything
        array = np.asarray(value)
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
        return False
    if array.ndim != len(shape):
        return False
    return all(wanted in (None, size) for wanted, size in zip(shape, array.shape, strict=True))


def _check_path(path: FloatArray | None, about: str) -> None:
    """Refuse a predicted path that is too long or not finite."""
    if path is not None and not (len(path) <= _MOST_POINTS and np.isfinite(path).all()):
        raise ControllerFailed(
            f"{about}diagnostics.predicted_path must be finite, {_MOST_POINTS} points at most"
        )


def _check_text(diagnostics: Diagnostics, about: str) -> None:
    """Refuse reasons that are no text, too long, or cannot be encoded."""
    texts = {"fallback": (diagnostics.fallback,), "learnt": diagnostics.learnt}
    for name, items in texts.items():
        if not all(map(_is_text, items)):
            raise ControllerFailed(
                f"{about}diagnostics.{name} must be text, {_MOST_TEXT} characters at most"
            )


def _is_text(value: object) -> bool:
    if not isinstance(value, str) or len(value) > _MOST_TEXT:
        return False
    return value.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in value)
