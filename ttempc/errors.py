"""Errors of the control side. Every one of them is a `TtempcError`."""

from __future__ import annotations

from collections.abc import Sequence


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


class EmptySet(TtempcError):
    """A set without a point, as what is left where more is taken off than there is."""

    def __init__(self, direction: Sequence[float], gap: float) -> None:
        self.direction = tuple(float(entry) for entry in direction)
        self.gap = gap
        shown = ", ".join(f"{entry:.3g}" for entry in self.direction)
        super().__init__(f"the set is empty: along ({shown}) {gap:.4g} are missing")


class InvalidTube(TtempcError):
    """A tube that cannot be had, or does not belong to the vehicle or the reference at hand."""
