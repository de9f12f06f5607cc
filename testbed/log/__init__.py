"""MCAP logs: writer, reader, scene. Here: the place of a log, without anything heavy."""

from pathlib import Path
from typing import Final

from ..atomic_write import partial_path

LOG_NAME: Final = "log.mcap"
"""Name of the log in the folder of a run."""


def log_path(place: str | Path) -> Path:
    """Return the log that is meant: the file itself, or that in the folder of a run.

    Of a run that was killed it is the part that was written, `log.mcap.part`. A folder without a
    log is returned as it is.
    """
    path = Path(place)
    whole = path / LOG_NAME
    inside = (whole, partial_path(whole))
    return next((file for file in inside if file.is_file()), path)
