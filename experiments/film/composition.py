"""Composition of a frame: one view, two views of one run, or one view of each of several runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..errors import InvalidFilm
from .drawing.offscreen import check_graphics
from .ghosts import Ghost, ghosts_of
from .hud import Overlay, Scales
from .mujoco_scene import MujocoScene
from .plan_view import PlanView
from .replay import Replay
from .shot import MIN_SIZE, Camera, Shot

_SPLIT: tuple[Camera, Camera] = ("chase", "top")


class FrameSource(Protocol):
    """Source of the frames of a film."""

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame of a time, (height, width, 3)."""
        ...


class SingleView:
    """One camera on one run, with overlay.

    Args:
        replay: the run.
        shot: settings of the film.
        moving: False for a still.
        compared: all runs of a side-by-side film, this one included; none for a single run.
        others: runs that are drawn as ghosts.
    """

    def __init__(
        self,
        replay: Replay,
        shot: Shot,
        *,
        moving: bool,
        compared: Sequence[Replay] = (),
        others: Sequence[Replay] = (),
    ) -> None:
        ghosts = ghosts_of(replay, others, reference=shot.look.reference_ghost)
        scales = Scales.of(compared or [replay])
        self._overlay = Overlay(replay, shot, scales, ghosts, moving=moving, brief=bool(compared))
        self._bare = _bare_view(replay, shot, ghosts)

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        image = Image.fromarray(self._bare.picture(time_s))
        self._overlay.draw_onto(image, time_s)
        return np.asarray(image)


class SplitView:
    """The cameras `_SPLIT` on one run side by side, with a common overlay."""

    def __init__(
        self, replay: Replay, shot: Shot, *, moving: bool, others: Sequence[Replay] = ()
    ) -> None:
        ghosts = ghosts_of(replay, others, reference=shot.look.reference_ghost)
        self._overlay = Overlay(replay, shot, Scales.of([replay]), ghosts, moving=moving)
        widths = _shares(shot.size[0], len(_SPLIT))
        self._views = [
            _bare_view(replay, replace(shot, camera=camera, size=(width, shot.size[1])), ghosts)
            for camera, width in zip(_SPLIT, widths, strict=True)
        ]

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        image = Image.fromarray(np.hstack([view.picture(time_s) for view in self._views]))
        self._overlay.draw_onto(image, time_s)
        return np.asarray(image)


class SideBySide:
    """The same camera on several runs at the same time, side by side.

    A run that has ended stays at its last record.
    """

    def __init__(self, replays: Sequence[Replay], shot: Shot, *, moving: bool) -> None:
        widths = _shares(shot.size[0], len(replays))
        self._ends = [replay.end_s for replay in replays]
        self._views = [
            SingleView(
                replay, replace(shot, size=(width, shot.size[1])), moving=moving, compared=replays
            )
            for replay, width in zip(replays, widths, strict=True)
        ]

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the frame, (height, width, 3)."""
        views = zip(self._views, self._ends, strict=True)
        return np.hstack([view.picture(min(time_s, end_s)) for view, end_s in views])


@dataclass(frozen=True, slots=True)
class FilmSetup:
    """Runs and settings of a film, from which each rendering process creates a `FrameSource`."""

    replays: tuple[Replay, ...]
    shot: Shot
    moving: bool = True  # a film, not a still
    ghosts: tuple[Replay, ...] = ()  # further runs, drawn into the picture of the only one

    def check(self) -> None:
        """Raise if the film cannot be rendered.

        Raises:
            InvalidFilm: there are too many runs for the width or the camera.
            NoGraphics: the camera needs OpenGL, which is unavailable.
        """
        runs, width = len(self.replays), self.shot.size[0]
        for ghost in self.ghosts:
            missing = set(self.replays[0].motion.body_names) - set(ghost.motion.body_names)
            if missing:
                raise InvalidFilm(f"--ghost {ghost.file}: has no {', '.join(sorted(missing))}")
        if runs > 1 and width // runs < MIN_SIZE[0]:
            raise InvalidFilm(
                f"--size: {runs} runs abreast need a width of {runs * MIN_SIZE[0]} or more, "
                f"got {width}"
            )
        if runs > 1 and self.shot.camera == "split":
            raise InvalidFilm("--camera split: shows one run; take another for several abreast")
        if self.shot.camera != "plan":
            check_graphics()

    def frame_source(self) -> FrameSource:
        """Create the source of the frames.

        Raises:
            InvalidFilm, NoGraphics: a view cannot be created.
        """
        first, *others = self.replays
        if others:
            return SideBySide(self.replays, self.shot, moving=self.moving)
        view = SplitView if self.shot.camera == "split" else SingleView
        return view(first, self.shot, moving=self.moving, others=self.ghosts)


@dataclass(frozen=True, slots=True)
class _RenderedView:
    """One camera in a MuJoCo scene."""

    scene: MujocoScene
    camera: Camera

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        return self.scene.picture(self.camera, time_s)


def _bare_view(replay: Replay, shot: Shot, ghosts: Sequence[Ghost]) -> FrameSource:
    """Return a view without overlay."""
    if shot.camera == "plan":
        return PlanView(replay, shot, ghosts)
    return _RenderedView(MujocoScene(replay, shot, ghosts), shot.camera)


def _shares(width: int, parts: int) -> list[int]:
    """Split a width into whole widths that differ by at most one pixel."""
    edges = [round(width * k / parts) for k in range(parts + 1)]
    return [end - start for start, end in pairwise(edges)]
