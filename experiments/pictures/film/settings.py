"""Settings of pictures and films: camera, time span, speed and size."""

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from ttempc.types import FloatArray

from ...errors import InvalidFilm

Camera = Literal["chase", "top", "side", "hitch", "split", "plan"]
CAMERAS: Final[tuple[Camera, ...]] = get_args(Camera)
FRAME_RATE: Final = 25  # frames a second of film
MIN_SIZE: Final = (320, 180)  # smaller text cannot be read
_MAX_SIZE: Final = (3840, 2160)
_SPEEDS: Final = (0.05, 100.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmSettings:
    """Settings of a picture or a film; times are simulated times of the run.

    Raises:
        InvalidFilm: a value is out of range. The message names the option and the range.
    """

    camera: Camera = "chase"  # "split" is chase and top, "plan" needs no OpenGL
    at_s: float | None = None  # moment of a single picture; None for a film
    begin_s: float | None = None  # None: begin of the log
    end_s: float | None = None  # None: end of the log
    speed: float = 8.0  # seconds of the run per second of film
    size: tuple[int, int] | None = None  # width, height [pixels]; None: 1280, 720
    display: bool = True  # texts, bars and legend; without them the picture fills the frame

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InvalidFilm(f"--camera: got {self.camera!r}, allowed are {', '.join(CAMERAS)}")
        width, height = self.pixels
        low_w, low_h = MIN_SIZE
        high_w, high_h = _MAX_SIZE
        if width % 2 or height % 2 or not (low_w <= width <= high_w and low_h <= height <= high_h):
            raise InvalidFilm(
                f"--size: got {width}x{height}, must be even and from {low_w}x{low_h} to "
                f"{high_w}x{high_h}"
            )
        low, high = _SPEEDS
        if not low <= self.speed <= high:
            raise InvalidFilm(f"--speed: got {self.speed:g}, must be from {low:g} to {high:g}")

    @property
    def pixels(self) -> tuple[int, int]:
        """Width and height of a frame [pixels]."""
        return self.size or (1280, 720)

    def times(self, first_s: float, last_s: float) -> FloatArray:
        """Return the time of each frame [s of the run], (n,), n at least 1.

        Args:
            first_s: begin of the log.
            last_s: end of the log.

        Raises:
            InvalidFilm: a time is outside the log, or the span is empty.
        """
        options = (("--at", self.at_s), ("--from", self.begin_s), ("--to", self.end_s))
        for option, time_s in options:
            if time_s is not None and not first_s <= time_s <= last_s:
                raise InvalidFilm(
                    f"{option}: got {time_s:g} s, the log reaches from {first_s:g} to "
                    f"{last_s:.2f} s"
                )
        if self.at_s is not None:
            return np.array([self.at_s])
        begin_s = first_s if self.begin_s is None else self.begin_s
        end_s = last_s if self.end_s is None else self.end_s
        if not begin_s < end_s:
            raise InvalidFilm(
                f"--from {begin_s:g} --to {end_s:g}: the film must end after it begins"
            )
        count = max(1, int((end_s - begin_s) / self.speed * FRAME_RATE + 1e-6))
        return begin_s + np.arange(count) * self.speed / FRAME_RATE
