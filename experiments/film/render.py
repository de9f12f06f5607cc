"""Pictures and films of logs: composition of a frame, and the files."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ttempc.types import FloatArray

from ...testbed.atomic_write import atomic_write, partial_path
from ..errors import InvalidFilm, MissingExtra
from ..output import refuse_existing
from .drawing import DARK, GHOSTS
from .hud import Hud, error_scale_m
from .mujoco_scene import MujocoScene, check_graphics
from .plan_view import PlanView
from .playback import Ghost, Playback, read_playback
from .settings import FRAME_RATE, MIN_SIZE, Camera, FilmSettings, Quality

REFERENCE_GHOST: Final = "reference"
FILM_SUFFIXES: Final = (".mp4", ".webp", ".gif")
STILL_SUFFIXES: Final = (".png", ".jpg")

Picture = NDArray[np.uint8]
"""A picture, (height, width, 3)."""

_SPLIT: Final[tuple[Camera, Camera]] = ("chase", "top")
_MIN_FRAMES_FOR_POOL: Final = 50  # fewer frames are rendered before a second process starts
_CODEC: Final = "libx264"
# Browsers need yuv420p, and the index at the front of the file to start at once.
_PIXELS: Final = "yuv420p"
_RATES: Final[dict[Quality, dict[str, str]]] = {  # constant rate factor, effort
    "draft": {"crf": "23", "preset": "veryfast"},
    "high": {"crf": "19", "preset": "slow"},
}
_TICK: Final = Fraction(1, FRAME_RATE)  # [s]
_EVERY: Final = 2  # frames of a film to one of an animation
_MOST_FRAMES: Final = 500  # of a film as an animation: 0.7 GB at 1280x720
_WEBP_QUALITY: Final = 45


@dataclass(frozen=True, slots=True)
class Film:
    """A picture or a film of one run, or of several side by side, that can be written."""

    runs: tuple[Playback, ...]
    ghosts: tuple[tuple[Ghost, ...], ...]  # of each run
    settings: FilmSettings
    times: FloatArray  # of the frames, (n,) [s of the run]

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
        runs = tuple(read_playback(Path(log)) for log in logs)
        times = settings.times(
            *(max(getattr(run, end) for run in runs) for end in ("begin_s", "end_s"))
        )
        others = [read_playback(Path(log)) for log in ghosts if log != REFERENCE_GHOST]
        bodies = runs[0].motion.body_names
        for other in others:
            if missing := set(bodies) - set(other.motion.body_names):
                raise InvalidFilm(f"--ghost {other.file}: has no {', '.join(sorted(missing))}")
        colours = itertools.cycle(GHOSTS[1:])
        drawn = [Ghost(other, bodies, next(colours)) for other in others]
        references = [[Ghost(run, (), GHOSTS[0], True)] for run in runs]
        each = [(own if REFERENCE_GHOST in ghosts else []) + drawn for own in references]
        count, width = len(runs), settings.pixels[0]
        if width // count < MIN_SIZE[0]:
            raise InvalidFilm(
                f"--size: {count} runs abreast need a width of {count * MIN_SIZE[0]} or more, "
                f"got {width}"
            )
        if count > 1 and settings.camera == "split":
            raise InvalidFilm("--camera split: shows one run; take another for several abreast")
        if settings.camera != "plan":
            check_graphics()
        return cls(runs, tuple(map(tuple, each)), settings, times)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def pictures(self, workers: int = 1) -> Iterator[Picture]:
        """Yield the frames in order, from several processes if there are many.

        Raises:
            InvalidFilm: a process was killed.
        """
        if workers < 2 or self.frames < _MIN_FRAMES_FOR_POOL:
            yield from map(self._frame_maker(), self.times.tolist())
            return
        # Spawned, since a forked process inherits an unusable graphics context.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context, _prepare, (self, workers)) as pool:
            try:
                yield from pool.map(_picture, self.times.tolist())
            except BrokenProcessPool:
                raise InvalidFilm("a rendering process was killed: try --workers 1") from None
            finally:
                pool.shutdown(cancel_futures=True)

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
        moving = self.settings.at_s is None
        _check_writable(file, FILM_SUFFIXES if moving else STILL_SUFFIXES)
        suffix = file.suffix.lower()
        if suffix == ".mp4":
            _check_codec()
        elif moving and self.frames > _MOST_FRAMES:
            raise InvalidFilm(
                f"{file}: {self.frames} frames, at most {_MOST_FRAMES} as {suffix}: a shorter span "
                "or a larger --speed"
            )

        def frames(film: Film, every: int = 1) -> Iterator[Picture]:
            for picture in film.pictures(workers):
                yield picture
                for _ in range(every):
                    on_frame()

        try:
            with atomic_write(file) as stream:
                if suffix == ".mp4":
                    _encode(stream.name, frames(self), self.settings)
                else:
                    fewer = replace(self, times=self.times[::_EVERY])
                    images = [Image.fromarray(each) for each in frames(fewer, _EVERY)]
                    form = {".jpg": "jpeg"}.get(suffix, suffix[1:])
                    animation = {
                        "save_all": True,
                        "append_images": images[1:],
                        "duration": round(1000 * _EVERY / FRAME_RATE),
                        "loop": 0,
                    }
                    quality = _WEBP_QUALITY if moving else 88
                    more = animation if moving else {}
                    images[0].save(stream, format=form, quality=quality, **more)
        except OSError as error:
            reason = error.strerror or error
            raise InvalidFilm(f"{partial_path(file)}: cannot be written: {reason}") from error

    def _frame_maker(self) -> Callable[[float], Picture]:
        """Return the function that draws the frame of a time."""
        settings, (width, height) = self.settings, self.settings.pixels
        error_m, count = error_scale_m(self.runs), len(self.runs)
        edges = [round(width * k / count) for k in range(count + 1)]
        panels = []
        for run, ghosts, (left, right) in zip(
            self.runs, self.ghosts, itertools.pairwise(edges), strict=True
        ):
            hud = Hud(
                run,
                (right - left, height),
                error_m,
                speed=settings.speed if settings.at_s is None else 0.0,
                ghosts=ghosts,
                exaggeration=settings.exaggeration,
                brief=count > 1,
                plan=settings.camera == "plan",
            )
            panels.append(self._panel(run, hud))
        return lambda time_s: np.hstack([panel(time_s) for panel in panels])

    def _panel(self, run: Playback, hud: Hud) -> Callable[[float], Picture]:
        """Return the function that draws one run: its views side by side, and the display."""
        camera, (width, height) = self.settings.camera, hud.view_size
        cameras = _SPLIT if camera == "split" else (camera,)
        make = PlanView if camera == "plan" else MujocoScene
        view = make(run, self.settings, (width // len(cameras), height), hud.ghosts)

        def panel(time_s: float) -> Picture:
            time_s = min(time_s, run.end_s)  # a run that has ended stays at its last record
            image = Image.new("RGB", hud.size, DARK)
            shown = np.hstack([view.picture(name, time_s) for name in cameras])
            image.paste(Image.fromarray(shown))
            hud.draw_onto(image, time_s)
            return np.asarray(image)

        return panel


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


_film: Film | None = None  # of this process: sent once, not with each frame


def _prepare(film: Film, workers: int) -> None:
    """Initialise a process of the pool."""
    global _film
    _film = film
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C, and ends this process
    # By default Mesa starts as many threads in each process as there are cores.
    os.environ.setdefault("LP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // workers)))


@cache
def _maker() -> Callable[[float], Picture]:
    """Return the frame maker of this process.

    It is made with the first frame, not in `_prepare`, so that its errors reach the caller.
    """
    assert _film is not None
    return _film._frame_maker()


def _picture(time_s: float) -> Picture:
    return _maker()(time_s)


def _check_writable(file: Path, suffixes: tuple[str, ...]) -> None:
    """Raise if a file exists, has another suffix, or lies in no writable folder."""
    if file.suffix.lower() not in suffixes:
        raise InvalidFilm(f"{file}: must end in {', '.join(suffixes)}")
    refuse_existing(file, partial_path(file))
    folder = file.parent
    if not folder.is_dir():
        raise InvalidFilm(f"{file}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise InvalidFilm(f"{file}: the folder {folder} cannot be written to")


def _check_codec() -> None:
    """Raise if there is no H.264 encoder."""
    try:
        import av
    except ImportError:
        raise MissingExtra(
            ".mp4: needs PyAV, pip install 'ttempc-proving-ground[film]'; .webp and .gif do not"
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
            stream.pix_fmt, stream.options = _PIXELS, dict(_RATES[settings.quality])
            stream.time_base = _TICK
            for number, picture in enumerate(frames):
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                frame.pts, frame.time_base = number, _TICK
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    except FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error  # as of any other file
