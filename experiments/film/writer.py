"""A film being written: H.264 in MP4, whole where it exists."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray

from ..errors import InvalidFilm
from ..output import part_of, refuse_existing
from .shot import FRAME_RATE

_CODEC: Final = "libx264"
# yuv420p and the index at the front are what browsers play at once.
_PIXELS: Final = "yuv420p"
_QUALITY: Final = "23"  # constant rate factor
_EFFORT: Final = "veryfast"
_TICK: Final = Fraction(1, FRAME_RATE)


def check_writable(file: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a file that exists, has no folder, cannot be written or has a wrong ending.

    Raises:
        OutputExists: it does, or a part of it.
        InvalidFilm: with the reason otherwise.
    """
    if file.suffix.lower() not in suffixes:
        raise InvalidFilm(f"{file}: must end in {' or '.join(suffixes)}")
    for taken in (file, part_of(file)):
        refuse_existing(taken)
    folder = file.parent
    if not folder.is_dir():
        raise InvalidFilm(f"{file}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise InvalidFilm(f"{file}: the folder {folder} cannot be written to")


def check_codec() -> None:
    """Refuse where no film could be encoded.

    Raises:
        InvalidFilm: PyAV comes without H.264 here.
    """
    if _CODEC not in av.codecs_available:
        raise InvalidFilm(f"no H.264 encoder ({_CODEC}) in PyAV {av.__version__}: pip install av")


class FilmWriter:
    """Takes frames, one after the other; a context manager.

    The file has its name once the `with` block has ended well; else nothing is left of it.
    """

    def __init__(self, file: Path, size: tuple[int, int]) -> None:
        self._file, self._part, self._count = file, part_of(file), 0
        with self._writing():
            self._container = av.open(
                str(self._part), "w", format="mp4", options={"movflags": "+faststart"}
            )
            self._stream = self._container.add_stream(_CODEC, rate=FRAME_RATE)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = _PIXELS
        self._stream.options = {"crf": _QUALITY, "preset": _EFFORT}
        self._stream.time_base = _TICK

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add one frame, (height, width, 3).

        Raises:
            InvalidFilm: it cannot be written, as on a full disk.
        """
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        frame.pts, frame.time_base = self._count, _TICK
        self._count += 1
        with self._writing():
            self._container.mux(self._stream.encode(frame))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if error is None:
                with self._writing():
                    self._container.mux(self._stream.encode(None))
                    self._container.close()
                    self._part.rename(self._file)
            else:
                # The error on its way out says more than one of the closing could.
                with contextlib.suppress(FFmpegError, OSError):
                    self._container.close()
        finally:
            self._part.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn what the file system or the encoder says into an `InvalidFilm`."""
        try:
            yield
        except (FFmpegError, OSError) as error:
            raise InvalidFilm(f"{self._part}: cannot be written: {error.strerror}") from error
