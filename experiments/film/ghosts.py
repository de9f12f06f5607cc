"""Ghosts: further poses of the vehicle in a picture, of its reference or of other runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE
from ..colours import SERIES_COLOURS
from .drawing.body_poses import rotation
from .drawing.colours import REFERENCE as REFERENCE_COLOUR
from .drawing.colours import Rgb, rgb
from .replay import Replay

_TRAILER: Final = ("drawbar", "trailer")  # beginnings of the names of bodies behind RJ1
_RUNS: Final = tuple(rgb(colour) for colour in SERIES_COLOURS[3:])  # not those of the points


class Ghost(Protocol):
    """A vehicle that is drawn translucent."""

    @property
    def name(self) -> str:
        """What the legend calls it."""
        ...

    @property
    def colour(self) -> Rgb:
        """Colour of vehicle and legend."""
        ...

    def poses(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return positions (bodies, 3) [m] and attitudes (bodies, 4) w, x, y, z of all bodies.

        The bodies are those of the run in the picture, in the order of its log.
        """
        ...


@dataclass(frozen=True)
class ReferenceGhost:
    """The vehicle of a run, moved to its reference.

    Tractor and trailer move on their own: each by the distance and the turn about the vertical from
    its axle point to the reference of that point. They keep the tilt that they have.
    """

    replay: Replay
    name: str = "reference"
    colour: Rgb = REFERENCE_COLOUR

    def poses(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the poses of all bodies, see `Ghost`."""
        replay = self.replay
        xyz, quat = replay.poses(time_s)
        placed, turned = xyz.copy(), quat.copy()
        terrain = replay.ground.terrain
        desired = replay.positions(REFERENCE, time_s)
        for point, (x, y), letter in zip(("tractor", "trailer"), desired, "ti", strict=True):
            rows = [
                row
                for row, name in enumerate(replay.motion.body_names)
                if name.startswith(_TRAILER) == (point == "trailer")
            ]
            origin = xyz[replay.body(point)]
            ahead = rotation(quat[replay.body(point)]).apply([1.0, 0.0, 0.0])
            yaw = replay.value(REFERENCE, f"psi_{letter}_rad", time_s)
            turn = Rotation.from_euler("z", yaw - math.atan2(ahead[1], ahead[0]))
            lift = float(terrain.height(x, y) - terrain.height(*origin[:2]))
            target = np.array([x, y, origin[2] + lift])
            placed[rows] = target + turn.apply(xyz[rows] - origin)
            turned[rows] = np.roll((turn * rotation(quat[rows])).as_quat(), 1, axis=1)
        return placed, turned


@dataclass(frozen=True)
class RunGhost:
    """The vehicle of another run at the same time, in the shape of the one in the picture."""

    replay: Replay
    bodies: tuple[str, ...]  # of the run in the picture
    colour: Rgb

    @property
    def name(self) -> str:
        """Controller and seed of the run."""
        run = self.replay.record.metadata
        return f"{run['controller']}, seed {run['seed']}"

    def poses(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the poses of all bodies, see `Ghost`."""
        xyz, quat = self.replay.poses(min(time_s, self.replay.end_s))
        rows = [self.replay.body(name) for name in self.bodies]
        return xyz[rows], quat[rows]


def ghosts_of(replay: Replay, others: Sequence[Replay], *, reference: bool) -> tuple[Ghost, ...]:
    """Return the ghosts of a picture: of the other runs, and of the reference if asked for."""
    bodies = replay.motion.body_names
    runs = [
        RunGhost(other, bodies, _RUNS[number % len(_RUNS)]) for number, other in enumerate(others)
    ]
    return (*([ReferenceGhost(replay)] if reference else []), *runs)
