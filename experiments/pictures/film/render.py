"""Pictures and films of a log: composition of a frame, and the files."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ttempc.types import FloatArray

from ....testbed.atomic_write import atomic_write, partial_path
from ....testbed.errors import NoGraphics, install_hint
from ....testbed.viewers.off_screen import graphics_context
from ...errors import InvalidFilm, MissingExtra
from ...output import refuse_existing
from .drawing import DARK, GHOSTS
from .hud import Hud
from .mujoco_scene import MujocoScene
from .plan_view import PlanView
from .playback import Ghost, Playback, read_playback
from .settings import FRAME_RATE, Camera, FilmSettings

REFERENCE_GHOST: Final = "reference"
FILM_SUFFIXES: Final = (".mp4", ".webp")
STILL_SUFFIXES: Final = (".png", ".jpg")

Picture = NDArray[np.uint8]
"""A picture, (height, width, 3)."""

_SPLIT: Final[tuple[Camera, Camera]] = ("chase", "top")
_CODEC: Final = "libx264"
# Browsers need yuv420p, and the index at the front of the file to start at once.
_PIXELS: Final = "yuv420p"
_RATE: Final = {"crf": "23", "preset": "veryfast"}  # constant rate factor, effort
_TICK: Final = Fraction(1, FRAME_RATE)  # [s]
_EVERY: Final = 2  # frames of a film to one of an animation
_MOST_FRAMES: Final = 500  # of a film as an animation: 0.7 GB at 1280x720
_WEBP_QUALITY: Final = 45


@dataclass(frozen=True, slots=True)
class Film:
    """A picture or a film of a run that can be written."""

    run: Playback
    ghosts: Sequence[Ghost]
    settings: FilmSettings
    times: FloatArray  # of the frames, (n,) [s of the run]

    @classmethod
    def of(cls, log: Path, settings: FilmSettings, ghosts: Sequence[str | Path] = ()) -> Film:
        """Read the log of a run; all that can be refused without writing is refused here.

        Args:
            log: of the run, or its folder.
            settings: of the film.
            ghosts: further vehicles in the picture: logs of other runs, and "reference" for the
                vehicle on its reference.

        Raises:
            LogError: a file is not a log of this version.
            InvalidFilm: a log is torn, or a setting does not suit it.
            NoGraphics: the camera needs OpenGL, which is unavailable.
        """
        run = read_playback(log)
        times = settings.times(run.begin_s, run.end_s)
        bodies = run.motion.body_names
        others = [read_playback(Path(log)) for log in ghosts if log != REFERENCE_GHOST]
        for other in others:
            if missing := set(bodies) - set(other.motion.body_names):
                raise InvalidFilm(f"--ghost {other.file}: has no {', '.join(sorted(missing))}")
        drawn = [Ghost("reference", GHOSTS[0], run.reference_poses)] * (REFERENCE_GHOST in ghosts)
        for other, colour in zip(others, itertools.cycle(GHOSTS[1:])):
            drawn.append(Ghost(other.label, colour, other.poses_of(bodies)))
        if settings.camera != "plan":
            _check_graphics()
        return cls(run, drawn, settings, times)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def pictures(self) -> Iterator[Picture]:
        """Yield the frames in order: views side by side, and the display where it is asked for."""
        settings = self.settings
        cameras = _SPLIT if settings.camera == "split" else (settings.camera,)
        make = PlanView if settings.camera == "plan" else MujocoScene
        speed = settings.speed if settings.at_s is None else 0.0
        hud = Hud(self.run, settings.pixels, speed, self.ghosts)
        width, height = hud.view_size if settings.display else hud.size
        view = make(self.run, settings, (width // len(cameras), height), self.ghosts)
        for time_s in self.times.tolist():
            image = Image.new("RGB", hud.size, DARK)
            views = [view.picture(name, time_s) for name in cameras]
            image.paste(Image.fromarray(np.hstack(views)))
            if settings.display:
                hud.draw_onto(image, time_s)
            yield np.asarray(image)

    def write(self, file: Path, on_frame: Callable[[], object] = lambda: None) -> None:
        """Write the picture (.png, .jpg) or the film (.mp4, .webp), whole or not at all.

        Raises:
            OutputExists: the file exists.
            InvalidFilm: the suffix or the folder is wrong, or the file cannot be written.
            MissingExtra: an .mp4 needs the extra `film`.
        """
        moving = self.settings.at_s is None
        suffix = file.suffix.lower()
        _check_writable(file, FILM_SUFFIXES if moving else STILL_SUFFIXES)
        if suffix == ".mp4":
            _check_codec()
        elif self.frames > _MOST_FRAMES:
            raise InvalidFilm(
                f"{file}: {self.frames} frames, at most {_MOST_FRAMES} as {suffix}: a shorter span "
                "or a larger --speed"
            )

        def frames(every: int) -> Iterator[Picture]:
            for picture in replace(self, times=self.times[::every]).pictures():
                yield picture
                for _ in range(every):
                    on_frame()

        try:
            with atomic_write(file) as stream:
                if suffix == ".mp4":
                    _encode(stream.name, frames(1), self.settings)
                else:
                    first, *others = map(Image.fromarray, frames(_EVERY))
                    more: dict[str, Any] = {"format": "jpeg" if suffix == ".jpg" else suffix[1:]}
                    if moving:
                        more |= {"save_all": True, "append_images": others, "loop": 0}
                        more |= {"duration": round(1000 * _EVERY / FRAME_RATE)}
                    first.save(stream, quality=_WEBP_QUALITY if moving else 88, **more)
        except OSError as error:
            reason = error.strerror or error
            raise InvalidFilm(f"{partial_path(file)}: cannot be written: {reason}") from error


def _check_writable(file: Path, suffixes: tuple[str, ...]) -> None:
    """Raise if a file exists, has another suffix, or lies in no writable folder."""
    if file.suffix.lower() not in suffixes:
        raise InvalidFilm(f"{file}: must end in {', '.join(suffixes)}")
    refuse_existing(file)
    if not os.access(file.parent, os.W_OK):
        raise InvalidFilm(f"{file}: there is no folder {file.parent} that can be written to")


def _check_codec() -> None:
    """Raise if there is no H.264 encoder."""
    try:
        import av
    except ImportError:
        raise MissingExtra(
            f".mp4: needs PyAV, which .webp does not; {install_hint('film')}"
        ) from None
    if _CODEC not in av.codecs_available:
        raise InvalidFilm(f"no H.264 encoder ({_CODEC}) in PyAV {av.__version__}: pip install av")


def _encode(file: str, frames: Iterable[Picture], settings: FilmSettings) -> None:
    """Encode frames as H.264 in MP4."""
    import av
    from av.error import FFmpegError

    try:
        with av.open(file, "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream = container.add_stream(_CODEC, rate=FRAME_RATE)
            stream.width, stream.height = settings.pixels
            stream.pix_fmt = _PIXELS
            stream.options = dict(_RATE)
            stream.time_base = _TICK
            for number, picture in enumerate(frames):
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                frame.pts = number
                frame.time_base = _TICK
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    except FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error  # as of any other file


def _check_graphics() -> None:
    """Raise where the cameras of MuJoCo cannot be used.

    Raises:
        NoGraphics: the message names the packages to install, and the camera that needs none.
    """
    try:
        graphics_context().free()
    except NoGraphics as error:
        raise NoGraphics(f"{error}, or take --camera plan, which needs none") from None
