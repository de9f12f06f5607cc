"""Files and folders of strangers: bounded, regular files only, never followed out of their folder.

Everything that the project did not write in the same call is foreign. A file that the user names
may be a link, for the user made it; what lies in a folder that the user names may not, for the
folder may be another's.
"""

import errno
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final

MOST_TEXT_BYTES: Final = 64 * 2**20
"""Largest text file that is read: a million points of a path, or a million rows of a table."""

MOST_LINE_BYTES: Final = 2**20
"""Longest line of a file that is read line by line."""

_NO_FOLLOW: Final = getattr(os, "O_NOFOLLOW", 0)  # of systems that have links
_NO_WAIT: Final = getattr(os, "O_NONBLOCK", 0)  # a pipe whose other end nobody opens


def read_bounded(file: Path, most_bytes: int = MOST_TEXT_BYTES) -> bytes:
    """Return the content of a regular file of at most `most_bytes`; a link is followed.

    Devices and pipes, which may have no end, are not opened for reading.

    Raises:
        OSError: with one line as `strerror`: missing, not readable, not a regular file, too large,
            or a path that the system does not take.
    """
    try:
        status = file.stat()
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, f"not a path: {error}") from None
    _refuse_irregular(status)
    with os.fdopen(os.open(file, os.O_RDONLY | _NO_WAIT), "rb") as stream:
        return _content(stream, most_bytes)


def read_member(folder: Path, name: str, most_bytes: int = MOST_TEXT_BYTES) -> bytes:
    """Return the content of a regular file in a folder, as `read_bounded`; no link is followed.

    Raises:
        OSError: as `read_bounded`, and where the member is a link.
    """
    with open_member(folder, name) as stream:
        return _content(stream, most_bytes)


def open_member(folder: Path, name: str, flags: int = os.O_RDONLY) -> BinaryIO:
    """Open a regular file in a folder, without a buffer if it is written; no link is followed.

    Args:
        folder: that may be a stranger's.
        name: of the file in it.
        flags: of `os.open`, such as `os.O_RDWR | os.O_CREAT`.

    Raises:
        OSError: with one line as `strerror`: missing, a link, not a regular file, not allowed.
    """
    file = folder / name
    if file.is_symlink():
        raise OSError(errno.ELOOP, "is a link, which is not followed")
    if file.exists():
        _refuse_irregular(file.stat())
    opened = os.open(file, flags | _NO_FOLLOW | _NO_WAIT, 0o666)
    try:
        _refuse_irregular(os.fstat(opened))  # another process may have changed it meanwhile
        if flags & (os.O_WRONLY | os.O_RDWR):
            return os.fdopen(opened, "r+b" if flags & os.O_RDWR else "wb", buffering=0)
        return os.fdopen(opened, "rb")
    except BaseException:
        os.close(opened)
        raise


def bounded_lines(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the lines of a stream with their ends.

    Raises:
        ValueError: a line has more than `MOST_LINE_BYTES`.
    """
    while line := stream.readline(MOST_LINE_BYTES + 1):
        if len(line) > MOST_LINE_BYTES:
            raise ValueError(f"has more than {MOST_LINE_BYTES} bytes")
        yield line


def json_table(content: bytes) -> dict[str, Any]:
    """Return the object of a JSON text.

    Raises:
        ValueError: with one line: it is no JSON, nested too deeply, or no object.
    """
    try:
        table = json.loads(content)
    except ValueError as error:
        raise ValueError(f"is no JSON: {error}") from None
    except RecursionError:
        raise ValueError("is no JSON: nested too deeply") from None
    if not isinstance(table, dict):
        raise ValueError("must be an object")
    return table


def _refuse_irregular(status: os.stat_result) -> None:
    """Raise where a file is a folder, a device or a pipe."""
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file")


def _content(stream: BinaryIO, most_bytes: int) -> bytes:
    """Return all of a stream, refused where it is longer than allowed, also while it grows."""
    size = os.fstat(stream.fileno()).st_size
    if size <= most_bytes:
        content = stream.read(most_bytes + 1)
        size = len(content)
        if size <= most_bytes:
            return content
    raise OSError(errno.EFBIG, f"has {size} bytes, at most {most_bytes} are read")
