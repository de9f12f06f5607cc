"""Where results go: whole or not at all, and over nothing that was not meant."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .errors import OutputExists


def refuse_existing(path: Path) -> None:
    """Refuse a file or folder that exists.

    Raises:
        OutputExists: it does.
    """
    if path.exists():
        what = "folder " if path.is_dir() else ""
        raise OutputExists(f"output {what}{path}: exists already, give another or remove it")


def make_folder(folder: Path) -> None:
    """Make a folder that does not exist, and those above it.

    Raises:
        OutputExists: it exists, or it cannot be made.
    """
    refuse_existing(folder)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputExists(f"output folder {folder}: cannot be made: {error.strerror}") from None


def part_of(file: Path) -> Path:
    """Return the name of a file as long as it is not whole."""
    return file.with_name(f"{file.name}.part")


def begin_part(file: Path) -> Path:
    """Return the part of a new file: empty, and in a folder that is made where there is none.

    What is known is written to the part as it comes; renamed, it is the file.

    Raises:
        OutputExists: the file or its part exists, or the part cannot be written.
    """
    part = part_of(file)
    for taken in (file, part):
        refuse_existing(taken)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
    except OSError as error:
        raise OutputExists(f"output {file}: cannot be written: {error.strerror}") from None
    return part


@contextmanager
def in_place_of(file: Path) -> Iterator[BinaryIO]:
    """Open what takes the place of a file once the block ends well and the disk has it.

    Otherwise the file is as it was, there or not, and nothing is left beside it.

    Raises:
        OSError: the disk does not take it.
    """
    part = part_of(file)
    try:
        with part.open("wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(file)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
