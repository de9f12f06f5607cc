"""Errors of the control library; all derive from `TtempcError`."""

from __future__ import annotations


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
    """The filter has no model of a sensor; the message lists the sensors that it has one of."""


class UnknownController(TtempcError):
    """No controller has this name; the message lists the names that exist."""


class MissingPackage(TtempcError):
    """An optional package is needed and not installed; the message contains the command."""


class InvalidTube(TtempcError):
    """A tube does not exist, or was made for another vehicle or control period."""
