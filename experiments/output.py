"""Output files and folders: no overwriting."""

from __future__ import annotations

from pathlib import Path

from ..testbed.atomic_write import atomic_write, partial_path
from .errors import OutputExists


def refuse_existing(*paths: Path) -> None:
    """Raise if one of the files or folders exists.

    Raises:
        OutputExists: for the first path that exists.
    """
    for path in paths:
        if path.exists():
            kind = "folder " if path.is_dir() else ""
            raise OutputExists(f"output {kind}{path}: exists already, give another or remove it")


def make_folder(folder: Path) -> None:
    """Create a new folder and its parents.

    Raises:
        OutputExists: the folder exists or cannot be created.
    """
    refuse_existing(folder)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputExists(f"output folder {folder}: cannot be made: {error.strerror}") from None


def write_file(file: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, in a folder that is made.

    Raises:
        OutputExists: it cannot be written, as on a full disk; no file is left.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(file) as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        raise OutputExists(f"output {file}: cannot be written: {error.strerror}") from None


def create_partial(file: Path) -> Path:
    """Create the empty partial file of a new file, and its folder, and return its path.

    The caller writes to the partial file and renames it to `file` at the end. An interrupted
    command therefore leaves its results so far in the partial file.

    Raises:
        OutputExists: the file or its partial file exists, or the folder cannot be written to.
    """
    partial = partial_path(file)
    refuse_existing(file, partial)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        partial.touch()
    except OSError as error:
        raise OutputExists(f"output {file}: cannot be written: {error.strerror}") from None
    return partial
