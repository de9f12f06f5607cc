"""Film a run, or take one picture of it."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import InvalidFilm
from ..output import in_place_of
from .scenes import Scene, Setup
from .writer import FilmWriter, check_codec, check_writable

FILM_SUFFIXES: Final = (".mp4",)
STILL_SUFFIXES: Final = (".png", ".jpg")
_WORTH_A_PROCESS: Final = 50  # frames; fewer are made before a second process has started


def film(
    setup: Setup, file: Path, workers: int, on_frame: Callable[[], object] = lambda: None
) -> None:
    """Write a film; the processes share its frames, and their order changes nothing.

    Raises:
        InvalidFilm: it cannot be written; nothing is left.
        NoGraphics: the camera needs OpenGL, and there is none.
    """
    check_writable(file, FILM_SUFFIXES)
    check_codec()
    setup.check()
    with FilmWriter(file, setup.shot.size) as writer:
        for picture in pictures(setup, workers):
            writer.add(picture)
            on_frame()


def still(setup: Setup, file: Path, time_s: float) -> None:
    """Write one picture.

    Raises:
        InvalidFilm, NoGraphics: as `film`.
    """
    check_writable(file, STILL_SUFFIXES)
    setup.check()
    image = Image.fromarray(setup.scene().picture(time_s))
    form = "png" if file.suffix.lower() == ".png" else "jpeg"
    try:
        with in_place_of(file) as stream:
            image.save(stream, format=form, quality=88)
    except OSError as error:
        raise InvalidFilm(f"{file}: cannot be written: {error.strerror or error}") from error


def pictures(setup: Setup, workers: int) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames of a film in their order, made by as many processes.

    Raises:
        InvalidFilm: a process was killed.
    """
    times = setup.shot.times.tolist()
    if workers < 2 or len(times) < _WORTH_A_PROCESS:
        scene = setup.scene()
        yield from map(scene.picture, times)
        return
    # A fresh process each: a copy of one with an open graphics context would be broken.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context, _prepare, (setup, workers)) as pool:
        try:
            yield from pool.map(_picture, times)
        except BrokenProcessPool:
            raise InvalidFilm("a rendering process was killed: try --workers 1") from None
        finally:
            pool.shutdown(cancel_futures=True)


_setup: Setup | None = None  # of this process: it is sent once, not with every frame


def _prepare(setup: Setup, workers: int) -> None:
    global _setup
    _setup = setup
    # Mesa would else start as many threads in each process as there are cores.
    os.environ.setdefault("LP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))


@cache
def _scene() -> Scene:
    """Return the scene of this process, made at its first frame, where errors find their way."""
    assert _setup is not None
    return _setup.scene()


def _picture(time_s: float) -> NDArray[np.uint8]:
    return _scene().picture(time_s)
