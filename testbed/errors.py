"""Errors of the testbed; each is a `TestbedError`."""


def first_line(error: Exception) -> str:
    """Return the first line of an exception's message, or its type where it has none."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def install_hint(extra: str) -> str:
    """Return the command that installs an optional dependency into the checkout."""
    # The empty variable keeps pip from replacing the editable `ttempc` by a copy.
    return f"in the checkout: TTEMPC_LIBRARY= .venv/bin/pip install -e '.[{extra}]'"


class TestbedError(Exception):
    """Base class of all errors that the testbed raises deliberately."""

    __test__ = False  # pytest would collect it by its name


class InvalidField(TestbedError):
    """Terrain or soil is impossible: a class, a size or a strength is out of its range."""


class InvalidPlant(TestbedError):
    """A vehicle or a plant setting is impossible."""


class InvalidFault(TestbedError):
    """A fault cannot act in its scenario, or has no place in it."""


class PlantDiverged(TestbedError):
    """The simulation has no valid state: NaN, a reset of MuJoCo, or a solver warning."""


class StageFailed(TestbedError):
    """A user's stage of the simulation loop raised; its exception is the `__cause__`."""


class LogError(TestbedError):
    """A log cannot be written or read."""


class LiveError(TestbedError):
    """A live view cannot be opened."""


class WindowClosed(TestbedError):
    """The user closed the window of an interactive run."""


class NoGraphics(TestbedError):
    """Off-screen rendering is unavailable. The message names the packages to install."""
