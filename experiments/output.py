"""Output of commands: files and folders that are never overwritten, and progress on stderr."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from ..testbed.atomic_write import atomic_write
from .errors import OutputExists

_EVERY_S: Final = 5.0  # between two lines of progress


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


@contextmanager
def progress(
    total: int, what: str, unit: str, shown: bool | None = None
) -> Iterator[Callable[[], object]]:
    """Yield a function that counts one unit of work as done.

    On a terminal a bar shows the progress, otherwise a line every few seconds.

    Args:
        total: units of work.
        what: is done.
        unit: name of a unit.
        shown: False: nothing is printed; None: a bar on a terminal, otherwise nothing.
    """
    terminal = sys.stderr.isatty()
    if shown is False or not (shown or terminal):
        yield lambda: None
        return
    from tqdm import tqdm

    begun = told = time.monotonic()
    done = 0

    def count() -> None:
        nonlocal done, told
        done += 1
        bar.update()
        if not terminal and (now := time.monotonic()) - told >= _EVERY_S and done < total:
            told = now
            text = f"{what}: {done} of {total} {unit}s in {now - begun:.0f} s"
            print(text, file=sys.stderr, flush=True)

    with tqdm(total=total, desc=what, unit=unit, leave=False, disable=not terminal) as bar:
        yield count


def announce_compilation() -> None:
    """Say how many kernels this process has compiled, and in what time, once."""
    jit = sys.modules.get("ttempc.jit")  # it loads numba, which help and refusals do without
    if jit is not None:
        jit.COMPILATION.announce()
