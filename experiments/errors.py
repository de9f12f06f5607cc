"""Errors of the experiments. Every one of them is an `ExperimentError`."""


class ExperimentError(Exception):
    """Root of all errors that the experiments raise on purpose."""


class InvalidScenario(ExperimentError):
    """A scenario that cannot be run; the message names file, key and what is allowed."""


class OutputExists(ExperimentError):
    """A folder or file that would have been written over, or that cannot be made."""


class InvalidController(ExperimentError):
    """A controller that cannot be found or made; the message says where and what is asked for."""


class InvalidWaypoints(ExperimentError):
    """A waypoint file that cannot be used; the message names file and line or point."""


class InvalidStudy(ExperimentError):
    """A study that cannot be made; the message names file, axis and what is allowed."""


class SweepRefused(ExperimentError):
    """A sweep that cannot begin: its folder, its scheduler or its workers do not fit."""


class SweepStopped(ExperimentError):
    """A sweep that could not go on; what it had found is kept."""


class MissingExtra(ExperimentError):
    """A part of the project that is installed on request only; the message names it."""


class BadOptions(ExperimentError):
    """Options that do not go together."""


class InvalidFilm(ExperimentError):
    """A film or picture that cannot be made of this log; the message says what is allowed."""


class NoGraphics(ExperimentError):
    """Off-screen rendering is not to be had; the message names what to install."""


class NotComparable(ExperimentError):
    """Runs that do not belong side by side."""


class InvalidRows(ExperimentError):
    """A file of finished runs that cannot be read or compared; the message names the place."""


class InvalidFit(ExperimentError):
    """Data from which a tube cannot be fitted, or a tube file that cannot be used."""
