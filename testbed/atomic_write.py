"""Atomic writes: a file is complete, or it is unchanged."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


def partial_path(path: Path) -> Path:
    """Return the path under which a file is written until it is complete."""
    return path.with_name(f"{path.name}.part")


@contextmanager
def atomic_write(file: Path) -> Iterator[BinaryIO]:
    """Open a binary stream whose content replaces `file` when the block ends without an error.

    The content is flushed to the disk before the file is replaced. After an error the file is
    unchanged, and the partial file is removed.

    Raises:
        OSError: the content cannot be written.
    """
    partial = partial_path(file)
    try:
        # A partial file that is there already is of a process that was killed. It is removed, not
        # written: in a stranger's folder it may be a link to any file of the user's.
        partial.unlink(missing_ok=True)
        with partial.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(file)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
