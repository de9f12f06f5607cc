"""Errors of the control side. Every one of them is a `TtempcError`."""

from __future__ import annotations


class TtempcError(Exception):
    """Root of all errors that the control side raises on purpose."""


class InvalidVehicle(TtempcError):
    """A vehicle that cannot exist: a length, a limit or a constant out of its range."""


class InvalidPath(TtempcError):
    """A path that cannot be built or driven; the message names the place on it."""


class InvalidTuning(TtempcError):
    """A weight, a horizon or a gain out of its range."""


class InvalidReference(TtempcError):
    """A reference that the vehicle cannot follow in time: a speed out of its range."""


class UnknownSensor(TtempcError):
    """A sensor of which the filter has no model; the message lists those that it knows."""


class UnknownController(TtempcError):
    """A controller name that is not in the table; the message lists those that are."""


class MissingPackage(TtempcError):
    """An optional package that is asked for and not installed; the message says how to get it."""


class InvalidTube(TtempcError):
    """A tube that cannot be had, or does not belong to the vehicle or the reference at hand."""
