"""Exceptions of `experiments`. All of them derive from `ExperimentError`."""


class ExperimentError(Exception):
    """Root of all errors that `experiments` raises deliberately."""


class InvalidScenario(ExperimentError):
    """The scenario cannot be run. The message names the file, the key and the allowed values."""


class OutputExists(ExperimentError):
    """The output file or folder exists already or cannot be written."""


class InvalidController(ExperimentError):
    """The controller cannot be imported or created. The message names it and the reason."""


class InvalidWaypoints(ExperimentError):
    """The waypoint file is invalid. The message names the file and the line or point."""


class UnreadableFile(ExperimentError):
    """A file of another program cannot be read. The message says what it is and what to do."""


class InvalidStudy(ExperimentError):
    """The study is invalid. The message names the file, the axis and the allowed values."""


class SweepRefused(ExperimentError):
    """The sweep cannot start because its folder, scheduler or workers are unusable."""


class SweepStopped(ExperimentError):
    """The sweep cannot continue. The rows written so far are kept."""


class MissingExtra(ExperimentError):
    """An optional dependency is not installed. The message names the extra."""


class BadOptions(ExperimentError):
    """The command-line options contradict each other."""


class InvalidFilm(ExperimentError):
    """The log or the options allow no film or picture. The message names the allowed values."""


class NotComparable(ExperimentError):
    """The runs do not share one reference or are unusable for a comparison."""


class InvalidRows(ExperimentError):
    """A results file cannot be read or compared. The message names the line."""


class InvalidScoreCard(ExperimentError):
    """The score card is invalid or not comparable. The message names the file or what differs."""


class InvalidFit(ExperimentError):
    """The data do not allow a tube to be fitted, or the tube file is invalid."""


class InvalidReplay(ExperimentError):
    """The log or the settings allow no replay of the estimator. The message names the reason."""


class InvalidPage(ExperimentError):
    """A page of the documentation has no place for a table, or its record cannot be read."""


class ServeError(ExperimentError):
    """The address cannot be listened on, or no peer came. The message names the address or time."""
