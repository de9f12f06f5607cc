"""Rendering of films and single pictures to files."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...testbed.atomic_write import atomic_write
from ..errors import InvalidFilm
from .composition import FilmSetup, FrameSource
from .replay import read_replay
from .settings import FilmSettings
from .shot import Look, Shot
from .writer import AnimationWriter, FilmWriter, check_codec, check_writable

FILM_SUFFIXES: Final = (".mp4", ".webp")
STILL_SUFFIXES: Final = (".png", ".jpg")
_MIN_FRAMES_FOR_POOL: Final = 50  # fewer frames are rendered before a second process starts


REFERENCE_GHOST: Final = "reference"


@dataclass(frozen=True, slots=True)
class Film:
    """A picture or a film of one run, or of several side by side, that can be written."""

    setup: FilmSetup
    settings: FilmSettings

    @classmethod
    def of(
        cls, logs: Sequence[Path], settings: FilmSettings, ghosts: Sequence[str | Path] = ()
    ) -> Film:
        """Read the logs of runs; all that can be refused without writing is refused here.

        Args:
            logs: of the runs, or their folders: one, or several for a film side by side.
            settings: of the film.
            ghosts: further vehicles in the picture: logs of other runs, and "reference" for the
                vehicle on its reference.

        Raises:
            LogError: a file is not a log of this version.
            InvalidFilm: a log is torn, or a setting does not suit it.
            NoGraphics: the camera needs OpenGL, which is unavailable.
        """
        runs = tuple(read_replay(Path(log)) for log in logs)
        first_s, last_s = (max(getattr(run, end) for run in runs) for end in ("begin_s", "end_s"))
        times = settings.times(first_s, last_s)
        look = Look(settings.quality, settings.exaggeration, REFERENCE_GHOST in ghosts)
        begin_s = first_s if settings.begin_s is None else settings.begin_s
        end_s = last_s if settings.end_s is None else settings.end_s
        moving = settings.at_s is None
        shot = Shot(settings.camera, begin_s, end_s, settings.speed, settings.pixels, look)
        others = tuple(read_replay(Path(log)) for log in ghosts if log != REFERENCE_GHOST)
        film = cls(FilmSetup(runs, shot, moving, others), settings)
        assert film.frames == len(times) or not moving
        film.setup.check()
        return film

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.setup.shot.times) if self.settings.at_s is None else 1

    def write(
        self, file: Path, *, workers: int = 2, on_frame: Callable[[], object] = lambda: None
    ) -> None:
        """Write the picture (.png, .jpg) or the film (.mp4, .webp, .gif), whole or not at all.

        Args:
            file: to write.
            workers: processes that render frames; the file does not depend on their number.
            on_frame: called after each frame.

        Raises:
            OutputExists: the file or its partial file exists.
            InvalidFilm: the suffix or the folder is wrong, or the file cannot be written.
            MissingExtra: an .mp4 needs the extra `film`.
        """
        if self.settings.at_s is None:
            write_film(self.setup, file, workers, on_frame)
        else:
            write_still(self.setup, file, self.settings.at_s)


def render(
    logs: Sequence[Path],
    file: Path,
    settings: FilmSettings,
    ghosts: Sequence[str | Path] = (),
    *,
    workers: int = 2,
    on_frame: Callable[[], object] = lambda: None,
) -> int:
    """Write a picture or a film of logs, see `Film.of` and `Film.write`; return its frames.

    `settings.at_s` makes it a picture. A command that writes other files before the film takes
    `Film.of` first, which refuses bad input, and `Film.write` later.
    """
    film = Film.of(logs, settings, ghosts)
    film.write(file, workers=workers, on_frame=on_frame)
    return film.frames


def write_film(
    setup: FilmSetup, file: Path, workers: int, on_frame: Callable[[], object] = lambda: None
) -> None:
    """Write a film. Its content does not depend on the number of processes.

    Args:
        setup: runs and settings of the film.
        file: to write.
        workers: processes that render frames.
        on_frame: called after each frame.

    Raises:
        OutputExists: the file or its partial file exists.
        InvalidFilm: the film cannot be written; no file is left behind.
        NoGraphics: the camera needs OpenGL, which is unavailable.
    """
    check_writable(file, FILM_SUFFIXES)
    if file.suffix.lower() != ".webp":
        check_codec()
    setup.check()
    writer: FilmWriter | AnimationWriter
    if file.suffix.lower() == ".webp":
        writer = AnimationWriter(file, len(setup.shot.times))
    else:
        writer = FilmWriter(file, setup.shot.size, setup.shot.look.quality)
    with writer:
        for frame in render_frames(setup, workers):
            writer.add(frame)
            on_frame()


def write_still(setup: FilmSetup, file: Path, time_s: float) -> None:
    """Write one picture as PNG or JPEG.

    Raises:
        OutputExists, InvalidFilm, NoGraphics: as `write_film`.
    """
    check_writable(file, STILL_SUFFIXES)
    setup.check()
    image = Image.fromarray(setup.frame_source().picture(time_s))
    form = "png" if file.suffix.lower() == ".png" else "jpeg"
    try:
        with atomic_write(file) as stream:
            image.save(stream, format=form, quality=88)
    except OSError as error:
        raise InvalidFilm(f"{file}: cannot be written: {error.strerror or error}") from error


def render_frames(setup: FilmSetup, workers: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a film in order, (height, width, 3) each, from several processes.

    Raises:
        InvalidFilm: a process was killed.
    """
    times = setup.shot.times.tolist()
    if workers < 2 or len(times) < _MIN_FRAMES_FOR_POOL:
        source = setup.frame_source()
        yield from map(source.picture, times)
        return
    # Spawned, since a forked process inherits an unusable graphics context.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _prepare, (setup, workers)) as pool:
        try:
            with _ignored_interrupts():  # the pool starts its processes here
                pictures = pool.map(_picture, times)
            yield from pictures
        except BrokenProcessPool:
            raise InvalidFilm("a rendering process was killed: try --workers 1") from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _ignored_interrupts() -> Iterator[None]:
    """Start processes that ignore Ctrl-C: this process handles it, and ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)  # is inherited
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


_setup: FilmSetup | None = None  # of this process: sent once, not with each frame


def _prepare(setup: FilmSetup, workers: int) -> None:
    """Initialise a process of the pool."""
    global _setup
    _setup = setup
    # By default Mesa starts as many threads in each process as there are cores.
    os.environ.setdefault("LP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))


@cache
def _frame_source() -> FrameSource:
    """Return the frame source of this process.

    It is created with the first frame, not in `_prepare`, so that its errors reach the caller.
    """
    assert _setup is not None
    return _setup.frame_source()


def _picture(time_s: float) -> NDArray[np.uint8]:
    return _frame_source().picture(time_s)
