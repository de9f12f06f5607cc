"""Plan view of a run, drawn without OpenGL."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ttempc.types import FloatArray

from ...testbed.errors import first_line
from ...testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from ...testbed.truth import WHEELS
from ...testbed.vehicle.appearance import ground_colours
from ..errors import InvalidFilm
from .camera import FollowCamera
from .drawing import DARK, PLAN, POINTS, REFERENCE, Rgb, font, slip_colour
from .playback import Ghost, Playback, rotation
from .settings import FilmSettings

_MARGIN_M: Final = 3.0  # of ground around the path
_TRAIL_STEP_M: Final = 0.25
_SUPERSAMPLING: Final = 2  # pictures are drawn this much larger and then reduced
_MAP: Final = (0.0, 0.10, 0.68, 1.0)  # left, top, right, bottom of the path in the picture
_CLOSE: Final = (0.695, 0.12, 0.29)  # left and top of the close-up, its side over the width
_CLOSE_SPAN: Final = 9.0  # [m] across the close-up for a vehicle of the paper's length
_BEYOND: Final = (84, 94, 58)  # colour of the ground beyond the field
_SCALE_AT: Final = 0.92  # height of the scale bar in the picture
_BARS_M: Final = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4)
_PIXELS_PER_M: Final = 16.0  # of the picture of the ground
_MOST_PIXELS: Final = 100_000_000  # of that picture
_COLOURS: Final = (POINTS["tractor"], POINTS["trailer"])
_SHAPES: Final = (  # of the vehicle, lower ones first: geom, colour
    ("bed", (88, 138, 96)),
    ("gearbox", (60, 62, 66)),
    ("bonnet", (214, 52, 38)),
    ("roof", (214, 52, 38)),
)


@dataclass(frozen=True, slots=True)
class _Sheet:
    """A map with north up."""

    centre: tuple[float, float]  # [m] east, north
    scale: float  # [pixels/m]
    size: tuple[int, int]  # width, height [pixels]

    def pixels(self, points: FloatArray) -> list[tuple[float, float]]:
        """Return the pixel coordinates of points (n, 2) [m]."""
        width, height = self.size
        x = 0.5 * width + self.scale * (points[:, 0] - self.centre[0])
        y = 0.5 * height - self.scale * (points[:, 1] - self.centre[1])
        return list(zip(x.tolist(), y.tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class _Outline:
    """Outline of a box of the vehicle seen from above."""

    body: int  # row of the logged poses
    corners: FloatArray  # (4, 3) [m] body frame
    colour: Rgb | None  # None for a wheel, coloured by its slip
    wheel: int = -1  # index in `WHEELS`, -1 for other boxes


class PlanView:
    """Plan view of one run at any time.

    Args:
        playback: of the run.
        settings: of the film.
        size: width and height of the picture [pixels].
        ghosts: vehicles that are drawn as outlines.

    Raises:
        InvalidFilm: the log's model cannot be read.
    """

    def __init__(
        self,
        playback: Playback,
        settings: FilmSettings,
        size: tuple[int, int],
        ghosts: Sequence[Ghost] = (),
    ) -> None:
        self._playback, self._ghosts, self._factor = playback, ghosts, settings.exaggeration
        width, height = (_SUPERSAMPLING * side for side in size)
        self._outlines = _outlines(playback)
        low, high = playback.path.min(axis=0) - _MARGIN_M, playback.path.max(axis=0) + _MARGIN_M
        left, top, right, bottom = _MAP
        free = ((right - left) * width, (bottom - top) * height)
        scale = float(min(free[0] / (high[0] - low[0]), free[1] / (high[1] - low[1])))
        east, north = (0.5 * (low + high)).tolist()
        centre = (
            east + (0.5 - 0.5 * (left + right)) * width / scale,
            north - (0.5 - 0.5 * (top + bottom)) * height / scale,
        )
        self._sheet = _Sheet(centre, scale, (width, height))
        self._close_side = min(round(_CLOSE[2] * width), round(0.75 * height))
        self._close_scale = self._close_side / (_CLOSE_SPAN * FollowCamera(playback, 1.0).unit)
        self._ground = _ground_image(playback)
        self._background = self._ground_map(self._sheet, width_m=0.4)
        _draw_scale(self._background, self._sheet)

    def picture(self, camera: str, time_s: float) -> NDArray[np.uint8]:
        """Return the whole path and a close-up of the vehicle, (height, width, 3)."""
        whole = self._background.copy()
        self._draw(whole, self._sheet, time_s, trail_m=0.3)
        xyz, _ = self._playback.poses(time_s)
        ends = xyz[[self._playback.body("tractor"), self._playback.body("trailer")], :2]
        east, north = ends.mean(axis=0).tolist()
        side = self._close_side
        close = _Sheet((east, north), self._close_scale, (side, side))
        inset = self._ground_map(close, width_m=0.12)
        self._draw(inset, close, time_s, trail_m=0.08)
        frame = (0, 0, side - 1, side - 1)
        ImageDraw.Draw(inset).rectangle(frame, outline=REFERENCE, width=2 * _SUPERSAMPLING)
        left, top, _ = _CLOSE
        whole.paste(inset, (round(left * whole.width), round(top * whole.height)))
        return np.asarray(whole.reduce(_SUPERSAMPLING))

    def _ground_map(self, sheet: _Sheet, width_m: float) -> Image.Image:
        """Return the picture of the ground for a sheet, with the reference path."""
        terrain = self._playback.ground.terrain
        (x0, y0), (size_x, size_y) = terrain.origin, terrain.size_m
        columns, rows = self._ground.size
        per_x, per_y = columns / size_x, rows / size_y  # of the ground's picture [pixels/m]
        width, height = sheet.size
        west = sheet.centre[0] - 0.5 * width / sheet.scale
        top = sheet.centre[1] + 0.5 * height / sheet.scale
        x_row = (per_x / sheet.scale, 0.0, (west - x0) * per_x)
        y_row = (0.0, per_y / sheet.scale, (y0 + size_y - top) * per_y)
        image = self._ground.transform(
            sheet.size,
            Image.Transform.AFFINE,
            x_row + y_row,
            Image.Resampling.BILINEAR,
            fillcolor=_BEYOND,
        )
        _draw_line(ImageDraw.Draw(image), sheet, self._playback.path, REFERENCE, width_m)
        return image

    def _draw(self, image: Image.Image, sheet: _Sheet, time_s: float, trail_m: float) -> None:
        """Draw driven and predicted paths, the vehicle, and the references of both points."""
        draw = ImageDraw.Draw(image)
        trails = self._playback.driven(time_s, _TRAIL_STEP_M, self._factor)
        for points, colour in zip(trails, _COLOURS, strict=True):
            _draw_line(draw, sheet, points, colour, trail_m)
        for points in self._playback.predicted_paths(time_s):
            _draw_line(draw, sheet, points, PLAN, trail_m)
        for ghost in self._ghosts:
            for _, pixels in self._polygons(sheet, *ghost.poses(time_s)):
                draw.polygon(pixels, outline=ghost.colour, width=_SUPERSAMPLING)
        slips = self._playback.slips(time_s)
        for part, pixels in self._polygons(sheet, *self._playback.poses(time_s)):
            colour = part.colour or slip_colour(float(slips[part.wheel]))
            draw.polygon(pixels, fill=colour, outline=(20, 20, 20))
        radius = max(0.5 * trail_m * sheet.scale, 1.5 * _SUPERSAMPLING)
        desired = self._playback.positions(REFERENCE_ROWS, time_s)
        for (x, y), colour in zip(sheet.pixels(desired), _COLOURS, strict=True):
            box = (x - 2 * radius, y - 2 * radius, x + 2 * radius, y + 2 * radius)
            draw.ellipse(box, fill=colour, outline=REFERENCE, width=_SUPERSAMPLING)

    def _polygons(
        self, sheet: _Sheet, xyz: FloatArray, quat: FloatArray
    ) -> Iterator[tuple[_Outline, list[tuple[float, float]]]]:
        """Yield the outlines of a vehicle with bodies at these poses, and their pixels."""
        for part in self._outlines:
            attitude = quat[part.body]
            if part.wheel >= 0:
                attitude = _without_roll(attitude)
            corners = rotation(attitude).apply(part.corners) + xyz[part.body]
            yield part, sheet.pixels(corners[:, :2])


def _draw_scale(image: Image.Image, sheet: _Sheet) -> None:
    """Draw a scale bar and an arrow to the north in the lower right corner of a map."""
    draw, unit = ImageDraw.Draw(image), image.width / 1280.0
    length_m = next(step for step in _BARS_M if step * sheet.scale >= 90.0 * unit)
    length, y = length_m * sheet.scale, _SCALE_AT * image.height
    left, thick = image.width - length - 64.0 * unit, 3.0 * unit
    draw.rectangle((left, y - thick, left + length, y + thick), fill=REFERENCE)
    draw.rectangle((left, y - thick, left + 0.5 * length, y + thick), fill=DARK)
    letters = font(round(15.0 * unit), bold=True)
    place = (left + 0.5 * length, y - 14.0 * unit)
    draw.text(place, f"{length_m:g} m", font=letters, fill=REFERENCE, anchor="mm")
    x = image.width - 30.0 * unit
    head = [(x, y - 30.0 * unit), (x - 8.0 * unit, y), (x, y - 7.0 * unit), (x + 8.0 * unit, y)]
    draw.polygon(head, fill=REFERENCE)
    draw.text((x, y + 12.0 * unit), "N", font=letters, fill=REFERENCE, anchor="mm")


def _draw_line(
    draw: ImageDraw.ImageDraw, sheet: _Sheet, points: FloatArray, colour: Rgb, width_m: float
) -> None:
    width = max(round(width_m * sheet.scale), _SUPERSAMPLING)
    draw.line(sheet.pixels(points), fill=colour, width=width, joint="curve")


def _ground_image(playback: Playback) -> Image.Image:
    terrain = playback.ground.terrain
    columns, rows = (math.ceil(_PIXELS_PER_M * side) for side in terrain.size_m)
    if columns * rows > _MOST_PIXELS:
        raise InvalidFilm(
            f"{playback.file}: the plan has {columns} x {rows} pixels, at most {_MOST_PIXELS}"
        )
    colours = ground_colours(terrain, playback.ground.cone_index, rows, columns)
    return Image.fromarray((255.0 * colours[::-1]).astype(np.uint8))


def _outlines(playback: Playback) -> list[_Outline]:
    """Return the outlines of the vehicle, wheels first."""
    try:
        model = mujoco.MjSpec.from_string(playback.mjcf).compile()
        boxes = [(f"{wheel}_tyre", None, k) for k, wheel in enumerate(WHEELS)]
        boxes += [(name, colour, -1) for name, colour in _SHAPES]
        outlines = []
        for name, colour, wheel in boxes:
            geom = model.geom(name)
            body = playback.body(model.body(int(geom.bodyid[0])).name)
            half = geom.size if wheel < 0 else [geom.size[0], geom.size[1], geom.size[0]]
            signs = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
            # The axes of a tyre's geom are rotated, those of its body are the vehicle's.
            corners = signs * half if wheel >= 0 else rotation(geom.quat).apply(signs * half)
            outlines.append(_Outline(body, corners + geom.pos, colour, wheel))
    except (ValueError, KeyError) as error:
        raise InvalidFilm(
            f"{playback.file}: its model cannot be drawn: {first_line(error)}"
        ) from None
    return outlines


def _without_roll(quat: FloatArray) -> FloatArray:
    """Return an upright attitude with the heading of a rolling wheel, w, x, y, z, (4,)."""
    axle = rotation(quat).apply([0.0, 1.0, 0.0])
    half = 0.5 * math.atan2(-axle[0], axle[1])
    return np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
