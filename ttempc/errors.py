"""Errors of the control side, all of them subclasses of `TtempcError`."""

from __future__ import annotations

from collections.abc import Sequence


class TtempcError(Exception):
    """Base class of all errors that the control side raises on purpose."""


class InvalidVehicle(TtempcError):
    """A length, a limit or a constant of a vehicle is out of its range."""


class InvalidPath(TtempcError):
    """A path cannot be built or driven; the message names the place on it."""


class InvalidTuning(TtempcError):
    """A weight, a horizon or a gain is out of its range."""


class InvalidReference(TtempcError):
    """The vehicle cannot follow a reference in time: a speed is out of its range."""


class UnknownSensor(TtempcError):
    """The filter has no model of a sensor; the message lists the sensors with a model."""


class UnknownController(TtempcError):
    """No controller has this name; the message lists the names that exist."""


class MissingPackage(TtempcError):
    """An optional package is needed and not installed; the message says how to install it."""


class EmptySet(TtempcError):
    """A set has no point, for example a Pontryagin difference.

    Attributes:
        direction: a direction in which the two bounds of the set exclude each other.
        gap: by how much they do along that direction.
    """

    def __init__(self, direction: Sequence[float], gap: float) -> None:
        self.direction = tuple(float(entry) for entry in direction)
        self.gap = gap
        shown = ", ".join(f"{entry:.3g}" for entry in self.direction)
        super().__init__(f"the set is empty: along ({shown}) {gap:.4g} are missing")


class InvalidTube(TtempcError):
    """A tube does not exist, or belongs to another vehicle or reference."""
