"""Errors of the plant side. Every one of them is a `TestbedError`."""


def first_line(error: Exception) -> str:
    """Return the first line of what an error of others says, its kind where it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0]


class TestbedError(Exception):
    """Root of all errors that the plant side raises on purpose."""

    __test__ = False  # not a test case, whatever its name says to pytest


class InvalidField(TestbedError):
    """Terrain or soil that cannot exist: a class, a size or a strength out of its range."""


class InvalidPlant(TestbedError):
    """A true vehicle or a plant setting that cannot exist."""


class PlantDiverged(TestbedError):
    """The simulation produced no valid state: NaN, a reset of MuJoCo, or a solver warning."""


class StageFailed(TestbedError):
    """A user's stage of the simulation loop raised; its exception is the `__cause__`."""


class LogError(TestbedError):
    """A log that cannot be written or read."""


class LiveError(TestbedError):
    """A live view that cannot be opened."""


class WindowClosed(TestbedError):
    """The user has seen enough of a run that went on for the window alone."""
