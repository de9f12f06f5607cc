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


class UnknownEstimator(TtempcError):
    """An estimator name that is not in the table; the message lists those that are."""


class InvalidTime(TtempcError):
    """A time stamp that is not finite or runs backwards; the message gives both times."""


class GuidanceFailed(TtempcError):
    """A controller or an estimator raised, or returned what cannot be used.

    The exception of the user's code is its `__cause__`.
    """


class ControllerFailed(GuidanceFailed):
    """A controller raised, or returned no step that could be driven and logged."""


class EstimatorFailed(GuidanceFailed):
    """An estimator raised, or returned no `Estimate`."""


class InvalidTube(TtempcError):
    """A tube does not exist, or was made for another vehicle or control period."""
