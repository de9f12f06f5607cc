"""What one frame is composed of: a view, two views of one run, or a view of each of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import InvalidFilm
from .hud import Overlay, error_scale
from .plan import PlanView
from .replay import Replay
from .screen import check_graphics
from .shot import LEAST_SIZE, Camera, Shot
from .stage import Stage

_SPLIT: tuple[Camera, Camera] = ("chase", "top")


class Scene(Protocol):
    """Makes the frame of any moment."""

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        ...


class View:
    """One camera on one run, with everything written over it.

    `rivals` are the runs beside which it is seen, itself among them.
    """

    def __init__(
        self, replay: Replay, shot: Shot, *, moving: bool, rivals: Sequence[Replay] = ()
    ) -> None:
        speed, scale = shot.speed if moving else 0.0, error_scale(rivals or [replay])
        self._overlay = Overlay(replay, shot.size, speed, scale, brief=bool(rivals))
        self._bare = _bare(replay, shot)

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        image = Image.fromarray(self._bare.picture(time_s))
        self._overlay.onto(image, time_s)
        return np.asarray(image)


class Split:
    """Behind the vehicle and from above, side by side, written over as one picture."""

    def __init__(self, replay: Replay, shot: Shot, *, moving: bool) -> None:
        speed = shot.speed if moving else 0.0
        self._overlay = Overlay(replay, shot.size, speed, error_scale([replay]))
        widths = _shares(shot.size[0], len(_SPLIT))
        self._views = [
            _bare(replay, replace(shot, camera=camera, size=(width, shot.size[1])))
            for camera, width in zip(_SPLIT, widths, strict=True)
        ]

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        image = Image.fromarray(np.hstack([view.picture(time_s) for view in self._views]))
        self._overlay.onto(image, time_s)
        return np.asarray(image)


class Abreast:
    """The same camera on several runs at the same moment, side by side.

    A run that has ended stays at its last moment.
    """

    def __init__(self, replays: Sequence[Replay], shot: Shot, *, moving: bool) -> None:
        widths = _shares(shot.size[0], len(replays))
        self._ends = [replay.end_s for replay in replays]
        self._views = [
            View(replay, replace(shot, size=(width, shot.size[1])), moving=moving, rivals=replays)
            for replay, width in zip(replays, widths, strict=True)
        ]

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        views = zip(self._views, self._ends, strict=True)
        return np.hstack([view.picture(min(time_s, end_s)) for view, end_s in views])


@dataclass(frozen=True, slots=True)
class Setup:
    """How to make the scene of a film, in whichever process renders it."""

    replays: tuple[Replay, ...]
    shot: Shot
    moving: bool = True  # a film, not a still

    def check(self) -> None:
        """Refuse what could not be drawn.

        Raises:
            InvalidFilm: too many runs for the width.
            NoGraphics: the camera needs OpenGL, and there is none.
        """
        runs, width = len(self.replays), self.shot.size[0]
        if runs > 1 and width // runs < LEAST_SIZE[0]:
            raise InvalidFilm(
                f"--size: {runs} runs abreast need a width of {runs * LEAST_SIZE[0]} or more, "
                f"got {width}"
            )
        if runs > 1 and self.shot.camera == "split":
            raise InvalidFilm("--camera split: shows one run; take another for several abreast")
        if self.shot.camera != "plan":
            check_graphics()

    def scene(self) -> Scene:
        """Return the scene.

        Raises:
            InvalidFilm, NoGraphics: it cannot be made.
        """
        first, *others = self.replays
        if others:
            return Abreast(self.replays, self.shot, moving=self.moving)
        make = Split if self.shot.camera == "split" else View
        return make(first, self.shot, moving=self.moving)


@dataclass(frozen=True, slots=True)
class _Rendered:
    stage: Stage
    camera: Camera

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        return self.stage.picture(self.camera, time_s)


def _bare(replay: Replay, shot: Shot) -> Scene:
    """Return the picture without anything written over it."""
    if shot.camera == "plan":
        return PlanView(replay, shot.size)
    return _Rendered(Stage(replay, shot.size, shot.speed), shot.camera)


def _shares(width: int, parts: int) -> list[int]:
    """Return whole widths that differ by no more than a pixel and sum up to `width`."""
    edges = [round(width * k / parts) for k in range(parts + 1)]
    return [end - start for start, end in pairwise(edges)]
