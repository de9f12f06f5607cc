"""Film writer: H.264 in MP4. The file appears when it is complete."""

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
from PIL import Image

from ...testbed.atomic_write import atomic_write, partial_path
from ..errors import InvalidFilm
from ..output import refuse_existing
from .shot import FRAME_RATE, Quality

_CODEC: Final = "libx264"
# Browsers need yuv420p, and the index at the front of the file to start at once.
_PIXELS: Final = "yuv420p"
_RATES: Final[dict[Quality, dict[str, str]]] = {  # constant rate factor, effort
    "draft": {"crf": "23", "preset": "veryfast"},
    "high": {"crf": "19", "preset": "slow"},
}
_EVERY: Final = 2  # frames of a film to one of an animation
_MOST_FRAMES: Final = 500  # of a film as an animation: 0.7 GB at 1280x720
_WEBP_QUALITY: Final = 45
_TICK: Final = Fraction(1, FRAME_RATE)


def check_writable(file: Path, suffixes: tuple[str, ...]) -> None:
    """Raise if a file exists, has another suffix, or lies in no writable folder.

    Raises:
        OutputExists: the file or its partial file exists.
        InvalidFilm: the suffix or the folder is wrong.
    """
    if file.suffix.lower() not in suffixes:
        raise InvalidFilm(f"{file}: must end in {' or '.join(suffixes)}")
    refuse_existing(file, partial_path(file))
    folder = file.parent
    if not folder.is_dir():
        raise InvalidFilm(f"{file}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise InvalidFilm(f"{file}: the folder {folder} cannot be written to")


def check_codec() -> None:
    """Raise if PyAV has no H.264 encoder.

    Raises:
        InvalidFilm: the encoder is missing.
    """
    if _CODEC not in av.codecs_available:
        raise InvalidFilm(f"no H.264 encoder ({_CODEC}) in PyAV {av.__version__}: pip install av")


class FilmWriter:
    """Context manager that encodes frames to a file.

    The file is renamed from its partial path when the `with` block ends without an error. After
    an error the partial file is removed.

    Args:
        file: to write.
        size: width and height of a frame [pixels].
        quality: of the compression.
    """

    def __init__(self, file: Path, size: tuple[int, int], quality: Quality = "draft") -> None:
        self._file, self._partial, self._count = file, partial_path(file), 0
        with self._writing():
            self._container = av.open(
                str(self._partial), "w", format="mp4", options={"movflags": "+faststart"}
            )
            self._stream = self._container.add_stream(_CODEC, rate=FRAME_RATE)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = _PIXELS
        self._stream.options = dict(_RATES[quality])
        self._stream.time_base = _TICK

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add one frame, (height, width, 3).

        Raises:
            InvalidFilm: the frame cannot be written, for example on a full disk.
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
                    self._partial.rename(self._file)
            else:
                # An error of the closing must not hide the original error.
                with contextlib.suppress(FFmpegError, OSError):
                    self._container.close()
        finally:
            self._partial.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Convert errors of the file system and of the encoder to `InvalidFilm`."""
        try:
            yield
        except (FFmpegError, OSError) as error:
            raise InvalidFilm(f"{self._partial}: cannot be written: {error.strerror}") from error


class AnimationWriter:
    """Context manager that writes frames as an animated WebP, which plays inside a page.

    It holds its pictures until the `with` block ends, every second frame of a film.

    Args:
        file: to write.
        count: frames that will be added.

    Raises:
        InvalidFilm: more frames than are kept in memory.
    """

    def __init__(self, file: Path, count: int) -> None:
        if count > _MOST_FRAMES:
            raise InvalidFilm(
                f"{file}: {count} frames, at most {_MOST_FRAMES} as WebP: a shorter span or a "
                "larger --speed"
            )
        self._file, self._count = file, 0
        self._pictures: list[Image.Image] = []

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add one frame, (height, width, 3)."""
        if self._count % _EVERY == 0:
            self._pictures.append(Image.fromarray(picture))
        self._count += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            return
        first, *others = self._pictures
        try:
            with atomic_write(self._file) as stream:
                first.save(
                    stream,
                    format="webp",
                    save_all=True,
                    append_images=others,
                    duration=round(1000 * _EVERY / FRAME_RATE),
                    loop=0,
                    quality=_WEBP_QUALITY,
                )
        except OSError as failure:
            reason = failure.strerror or failure
            raise InvalidFilm(f"{self._file}: cannot be written: {reason}") from failure
