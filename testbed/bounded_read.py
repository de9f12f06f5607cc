"""Reading of files that may not be what they are taken for."""

import errno
import os
import stat
from pathlib import Path
from typing import Final

MOST_TEXT_BYTES: Final = 64 * 2**20
"""Largest text file that is read: a million points of a path, or a million rows of a table."""


def read_bounded(file: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file of at most `most_bytes`.

    Devices and pipes, which may have no end, are not opened for reading.

    Raises:
        OSError: with one line as `strerror`: missing, not readable, not a regular file, too large,
            or a path that the system does not take.
    """
    try:
        status = file.stat()
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, f"not a path: {error}") from None
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file")
    if status.st_size > most_bytes:
        raise OSError(errno.EFBIG, f"has {status.st_size} bytes, at most {most_bytes} are read")
    with file.open("rb") as stream:
        return stream.read(most_bytes)
