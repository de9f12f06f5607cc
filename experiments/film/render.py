"""Rendering of films and single pictures to files."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...testbed.atomic_write import atomic_write
from ..errors import InvalidFilm
from .composition import FilmSetup, FrameSource
from .writer import AnimationWriter, FilmWriter, check_codec, check_writable

FILM_SUFFIXES: Final = (".mp4", ".webp")
STILL_SUFFIXES: Final = (".png", ".jpg")
_MIN_FRAMES_FOR_POOL: Final = 50  # fewer frames are rendered before a second process starts


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
