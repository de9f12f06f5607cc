"""The run from straight above, drawn without OpenGL: for every machine, and for orientation."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from proving_ground.testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.vehicle.appearance import ground_colours
from ttempc.types import FloatArray

from ..errors import InvalidFilm
from .camera import Operator
from .colours import PLAN, REFERENCE, TRACTOR, TRAILER, Rgb, slip_colour
from .posing import rotation_matrices
from .replay import Replay

_MARGIN_M: Final = 3.0  # of ground around the path
_TRAIL_STEP_M: Final = 0.25
_FINER: Final = 2  # all is drawn this much larger and then reduced: smooth edges
_MAP: Final = (0.0, 0.08, 0.68, 0.77)  # left, top, right, bottom of the path in the frame
_CLOSE: Final = (0.695, 0.09, 0.29)  # left and top of the close-up, its side over the width
_CLOSE_SPAN: Final = 9.0  # [m] across the close-up for a vehicle of the paper's length
_BEYOND: Final = (84, 94, 58)  # what is not on the field
_PIXELS_PER_M: Final = 16.0  # of the ground's picture
_SHAPES: Final = (  # of the vehicle, the lower first: geom, colour
    ("bed", (88, 138, 96)),
    ("gearbox", (60, 62, 66)),
    ("bonnet", (214, 52, 38)),
    ("roof", (214, 52, 38)),
)


@dataclass(frozen=True, slots=True)
class Sheet:
    """A north-up map: metres to pixels."""

    centre: tuple[float, float]  # [m] at the middle of the sheet
    scale: float  # [pixels/m]
    size: tuple[int, int]

    def pixels(self, points: FloatArray) -> list[tuple[float, float]]:
        """Return where points (n, 2) [m] lie on the sheet."""
        width, height = self.size
        x = 0.5 * width + self.scale * (points[:, 0] - self.centre[0])
        y = 0.5 * height - self.scale * (points[:, 1] - self.centre[1])
        return list(zip(x.tolist(), y.tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class Outline:
    """A box of the vehicle as it is seen from above."""

    body: int  # row of the logged poses
    corners: FloatArray  # (4, 3) [m] body frame
    colour: Rgb | None  # None for a wheel, whose slip colours it
    wheel: int = -1


class PlanView:
    """Draws any moment of one run in plan.

    Raises:
        InvalidFilm: the log's model is not one.
    """

    def __init__(self, replay: Replay, size: tuple[int, int]) -> None:
        self._replay = replay
        width, height = (_FINER * side for side in size)
        self._outlines, unit = _outlines(replay)
        low, high = replay.path.min(axis=0) - _MARGIN_M, replay.path.max(axis=0) + _MARGIN_M
        left, top, right, bottom = _MAP
        room = ((right - left) * width, (bottom - top) * height)
        scale = float(min(room[0] / (high[0] - low[0]), room[1] / (high[1] - low[1])))
        east, north = (0.5 * (low + high)).tolist()
        self._sheet = Sheet(
            (
                east + (0.5 - 0.5 * (left + right)) * width / scale,
                north - (0.5 - 0.5 * (top + bottom)) * height / scale,
            ),
            scale,
            (width, height),
        )
        self._close_side = round(_CLOSE[2] * width)
        self._close_scale = self._close_side / (_CLOSE_SPAN * unit)
        self._ground = _ground_image(replay)
        self._background = self._paper(self._sheet, width_m=0.4)

    def picture(self, time_s: float) -> NDArray[np.uint8]:
        """Return the whole path and a close-up of the vehicle, (height, width, 3)."""
        whole = self._background.copy()
        self._draw(whole, self._sheet, time_s, trail_m=0.3)
        xyz, _ = self._replay.poses(time_s)
        ends = xyz[[self._replay.body("tractor"), self._replay.body("trailer")], :2]
        east, north = ends.mean(axis=0).tolist()
        side = self._close_side
        close = Sheet((east, north), self._close_scale, (side, side))
        inset = self._paper(close, width_m=0.12)
        self._draw(inset, close, time_s, trail_m=0.08)
        frame = (0, 0, side - 1, side - 1)
        ImageDraw.Draw(inset).rectangle(frame, outline=REFERENCE, width=2 * _FINER)
        left, top, _ = _CLOSE
        whole.paste(inset, (round(left * whole.width), round(top * whole.height)))
        return np.asarray(whole.reduce(_FINER))

    def _paper(self, sheet: Sheet, width_m: float) -> Image.Image:
        """Return the ground under a sheet, with the reference path on it."""
        terrain = self._replay.ground.terrain
        (x0, y0), (size_x, size_y) = terrain.origin, terrain.size_m
        columns, rows = self._ground.size
        per_x, per_y = columns / size_x, rows / size_y  # of the ground's picture [pixels/m]
        width, height = sheet.size
        west = sheet.centre[0] - 0.5 * width / sheet.scale
        top = sheet.centre[1] + 0.5 * height / sheet.scale
        affine = (
            *(per_x / sheet.scale, 0.0, (west - x0) * per_x),
            *(0.0, per_y / sheet.scale, (y0 + size_y - top) * per_y),
        )
        paper = self._ground.transform(
            sheet.size,
            Image.Transform.AFFINE,
            affine,
            Image.Resampling.BILINEAR,
            fillcolor=_BEYOND,
        )
        _line(ImageDraw.Draw(paper), sheet, self._replay.path, REFERENCE, width_m)
        return paper

    def _draw(self, image: Image.Image, sheet: Sheet, time_s: float, trail_m: float) -> None:
        """Draw what changes: driven and predicted paths, the vehicle, where it should be."""
        draw = ImageDraw.Draw(image)
        trails = self._replay.driven(time_s, _TRAIL_STEP_M)
        for points, colour in zip(trails, (TRACTOR, TRAILER), strict=True):
            _line(draw, sheet, points, colour, trail_m)
        for points in self._replay.plan(time_s):
            _line(draw, sheet, points, PLAN, trail_m)
        xyz, quat = self._replay.poses(time_s)
        slips = self._replay.slips(time_s)
        for part in self._outlines:
            attitude = quat[part.body]
            if part.wheel >= 0:
                attitude = _without_roll(attitude)
            turned = _rotated(part.corners, attitude) + xyz[part.body]
            colour = part.colour or slip_colour(float(slips[part.wheel]))
            draw.polygon(sheet.pixels(turned[:, :2]), fill=colour, outline=(20, 20, 20))
        radius = max(0.5 * trail_m * sheet.scale, 1.5 * _FINER)
        due = self._replay.places(REFERENCE_ROWS, time_s)
        for (x, y), colour in zip(sheet.pixels(due), (TRACTOR, TRAILER), strict=True):
            box = (x - 2 * radius, y - 2 * radius, x + 2 * radius, y + 2 * radius)
            draw.ellipse(box, fill=colour, outline=REFERENCE, width=_FINER)


def _line(
    draw: ImageDraw.ImageDraw, sheet: Sheet, points: FloatArray, colour: Rgb, width_m: float
) -> None:
    width = max(round(width_m * sheet.scale), _FINER)
    draw.line(sheet.pixels(points), fill=colour, width=width, joint="curve")


def _ground_image(replay: Replay) -> Image.Image:
    terrain = replay.ground.terrain
    columns, rows = (math.ceil(_PIXELS_PER_M * side) for side in terrain.size_m)
    colours = ground_colours(terrain, replay.ground.cone_index, rows, columns)
    return Image.fromarray((255.0 * colours[::-1]).astype(np.uint8))


def _outlines(replay: Replay) -> tuple[list[Outline], float]:
    """Return what of the vehicle is drawn, wheels first, and its length over the paper's."""
    try:
        model = mujoco.MjSpec.from_string(replay.mjcf).compile()
        boxes = [(f"{wheel}_tyre", None, k) for k, wheel in enumerate(WHEELS)]
        boxes += [(name, colour, -1) for name, colour in _SHAPES]
        outlines = []
        for name, colour, wheel in boxes:
            geom = model.geom(name)
            body = replay.body(model.body(int(geom.bodyid[0])).name)
            half = geom.size if wheel < 0 else [geom.size[0], geom.size[1], geom.size[0]]
            signs = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
            # A tyre's own axes lie otherwise, its body's are those of the vehicle.
            flat = signs * half if wheel >= 0 else _rotated(signs * half, geom.quat)
            outlines.append(Outline(body, flat + geom.pos, colour, wheel))
    except (ValueError, KeyError) as error:
        raise InvalidFilm(f"{replay.file}: its model cannot be drawn: {error}") from None
    return outlines, Operator(replay, 1.0).unit


def _without_roll(quat: FloatArray) -> FloatArray:
    """Return the attitude of a wheel that has not turned about its axle: upright, same heading."""
    (axle,) = _rotated(np.array([[0.0, 1.0, 0.0]]), quat)
    half = 0.5 * math.atan2(-axle[0], axle[1])
    return np.array([math.cos(half), 0.0, 0.0, math.sin(half)])


def _rotated(points: FloatArray, quat: FloatArray) -> FloatArray:
    """Return points (n, 3) turned by a unit quaternion w, x, y, z."""
    return points @ rotation_matrices(quat[None])[0].T
