"""Errors of the control library; all derive from `TtempcError`."""

import math
from collections.abc import Collection


class TtempcError(Exception):
    """Root of all errors that the library raises on purpose."""


class InvalidVehicle(TtempcError):
    """A length, a limit or a constant of a vehicle is out of its range."""


class InvalidPath(TtempcError):
    """A path cannot be built or driven; the message names the place on it."""


class InvalidTuning(TtempcError):
    """An option of a controller is out of its range: a weight, a horizon, a gain."""


class InvalidReference(TtempcError):
    """A speed of a reference is out of the vehicle's range."""


class UnknownSensor(TtempcError):
    """The filter has no model of a sensor; the message lists the sensors that it has models of."""


class UnknownController(TtempcError):
    """No controller has this name; the message lists the names that exist."""


class MissingPackage(TtempcError):
    """An optional package is needed and not installed; the message contains the command."""


class UnknownEstimator(TtempcError):
    """No estimator has this name; the message lists the names that exist."""


class InvalidTime(TtempcError):
    """A time stamp is not finite or runs backwards; the message gives both times."""


class InvalidSamples(TtempcError):
    """Samples have another shape or sensor than allowed, or are not numbers."""


class GuidanceFailed(TtempcError):
    """A controller or an estimator raised an exception, or returned what cannot be used.

    The exception of the user's code is the `__cause__` of this one.
    """


class ControllerFailed(GuidanceFailed):
    """A controller raised an exception, or returned no step that can be driven and logged."""


class EstimatorFailed(GuidanceFailed):
    """An estimator raised an exception, or returned no `Estimate`."""


class InvalidTube(TtempcError):
    """A tube does not exist, or was made for another vehicle or control period."""


def check_flag(name: str, value: object) -> None:
    """Refuse anything but True and False."""
    if not isinstance(value, bool):
        raise InvalidTuning(f"{name}: got {value!r}, must be true or false")


def check_choice(name: str, value: object, allowed: Collection[str | int]) -> None:
    """Refuse a value that is not one of the `allowed` ones."""
    if not any(type(value) is type(choice) and value == choice for choice in allowed):
        choices = ", ".join(repr(choice) for choice in allowed)
        raise InvalidTuning(f"{name}: got {value!r}, must be one of {choices}")


def check_count(name: str, value: object, most: int | None = None) -> None:
    """Refuse anything but an integer from 1 to `most`."""
    if not _is_count(value, most):
        allowed = "of 1 or more" if most is None else f"from 1 to {most}"
        raise InvalidTuning(f"{name}: got {value!r}, must be an integer {allowed}")


def check_positive(name: str, value: object, *, zero: bool = False) -> None:
    """Refuse anything but a finite number above 0, or of 0 or more where `zero`."""
    if not _is_positive(value, zero):
        allowed = "0 or more" if zero else "above 0"
        raise InvalidTuning(f"{name}: got {value!r}, must be finite and {allowed}")


def check_vector(name: str, values: object, length: int, *, zero: bool = False) -> None:
    """Refuse anything but `length` finite numbers above 0, or of 0 or more where `zero`."""
    if (
        not isinstance(values, tuple | list)
        or len(values) != length
        or not all(_is_positive(value, zero) for value in values)
    ):
        allowed = "of 0 or more" if zero else "above 0"
        raise InvalidTuning(f"{name}: got {values!r}, must be {length} finite numbers {allowed}")


def _is_count(value: object, most: int | None) -> bool:
    """Return whether a value is an integer from 1 to `most`, without a limit where that is None."""
    if not isinstance(value, int) or isinstance(value, bool):
        return False
    return value >= 1 and (most is None or value <= most)


def _is_positive(value: object, zero: bool) -> bool:
    """Return whether a value is a finite number above 0, or of 0 or more where `zero`."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return False
    return value > 0.0 or (zero and value == 0.0)
