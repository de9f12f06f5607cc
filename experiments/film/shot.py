"""Settings of a film: camera, time span, speed and size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidFilm

Camera = Literal["chase", "top", "side", "hitch", "split", "plan"]
CAMERAS: Final[tuple[Camera, ...]] = get_args(Camera)

FRAME_RATE: Final = 25  # frames a second of film
Quality = Literal["draft", "high"]
QUALITIES: Final[tuple[Quality, ...]] = get_args(Quality)
SIZES: Final[dict[Quality, tuple[int, int]]] = {"draft": (1280, 720), "high": (1920, 1080)}
MIN_SIZE: Final = (320, 180)  # smaller text cannot be read
_MAX_SIZE: Final = (3840, 2160)
_SPEEDS: Final = (0.05, 100.0)
_EXAGGERATIONS: Final = (1.0, 100.0)


@dataclass(frozen=True, slots=True)
class Look:
    """How the pictures of a film look.

    Raises:
        InvalidFilm: the exaggeration is out of range.
    """

    quality: Quality = "draft"
    exaggeration: float = 1.0  # factor of the cross-track error of the driven paths
    reference_ghost: bool = False  # whether the vehicle is also drawn at its reference

    def __post_init__(self) -> None:
        low, high = _EXAGGERATIONS
        if not low <= self.exaggeration <= high:
            raise InvalidFilm(
                f"--exaggerate: got {self.exaggeration:g}, must be from {low:g} to {high:g}"
            )


@dataclass(frozen=True, slots=True)
class Shot:
    """Settings of one film.

    Raises:
        InvalidFilm: a value is out of range. The message names the allowed range.
    """

    camera: Camera
    begin_s: float  # time of the run
    end_s: float
    speed: float  # seconds of the run per second of film
    size: tuple[int, int]  # width, height of a frame
    look: Look = Look()

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InvalidFilm(f"--camera: got {self.camera!r}, allowed are {', '.join(CAMERAS)}")
        width, height = self.size
        (low_w, low_h), (high_w, high_h) = MIN_SIZE, _MAX_SIZE
        if width % 2 or height % 2:
            raise InvalidFilm(
                f"--size: got {width}x{height}, H.264 needs an even width and an even height"
            )
        if not (low_w <= width <= high_w and low_h <= height <= high_h):
            raise InvalidFilm(
                f"--size: got {width}x{height}, must be from {low_w}x{low_h} to {high_w}x{high_h}"
            )
        if not _SPEEDS[0] <= self.speed <= _SPEEDS[1]:
            raise InvalidFilm(
                f"--speed: got {self.speed:g}, must be from {_SPEEDS[0]:g} to {_SPEEDS[1]:g}"
            )
        if not self.begin_s < self.end_s:
            raise InvalidFilm(
                f"--from {self.begin_s:g} --to {self.end_s:g}: the film must end after it begins"
            )

    @property
    def times(self) -> FloatArray:
        """Time of each frame [s of the run], (n,), n at least 1."""
        seconds = (self.end_s - self.begin_s) / self.speed
        count = max(1, int(seconds * FRAME_RATE + 1e-6))
        return self.begin_s + np.arange(count) * self.speed / FRAME_RATE


def check_within(option: str, time_s: float, begin_s: float, end_s: float) -> None:
    """Raise if a time is outside a run.

    Raises:
        InvalidFilm: the time is outside. The message names the option and the run's span.
    """
    if not begin_s <= time_s <= end_s:
        raise InvalidFilm(
            f"{option}: got {time_s:g} s, the log reaches from {begin_s:g} to {end_s:.2f} s"
        )


def make_shot(
    camera: Camera,
    *,
    span_s: tuple[float | None, float | None],
    logged_s: tuple[float, float],
    speed: float,
    size: tuple[int, int],
    look: Look,
) -> Shot:
    """Return a shot of a part of a log.

    Args:
        camera: of the film.
        span_s: begin and end of the part; None for that of the log.
        logged_s: begin and end of the log.
        speed: seconds of the run per second of film.
        size: width and height [pixels].
        look: of the pictures.

    Raises:
        InvalidFilm: as `Shot`, or the part extends beyond the log.
    """
    (begin_s, end_s), (first_s, last_s) = span_s, logged_s
    for option, time_s in (("--from", begin_s), ("--to", end_s)):
        if time_s is not None:
            check_within(option, time_s, first_s, last_s)
    return Shot(
        camera=camera,
        begin_s=first_s if begin_s is None else begin_s,
        end_s=last_s if end_s is None else end_s,
        speed=speed,
        size=size,
        look=look,
    )
