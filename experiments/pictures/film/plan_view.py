"""Plan view of a run, drawn without OpenGL."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ttempc.types import FloatArray

from ....testbed.errors import first_line
from ....testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from ....testbed.truth import WHEELS
from ....testbed.vehicle.appearance import ground_colours
from ...errors import InvalidFilm
from .drawing import PLAN, POINTS, REFERENCE, Rgb, slip_colour
from .playback import Ghost, Playback, Poses, rotation
from .settings import FilmSettings

_MARGIN_M: Final = 3.0  # of ground around the path
_TRAIL_STEP_M: Final = 0.25
_LINE_M: Final = 0.14  # width of a drawn path [m]
_SUPERSAMPLING: Final = 2  # pictures are drawn this much larger and then reduced
_HEADLINE: Final = 0.1  # height of the display over that of the picture
_BEYOND: Final = (84, 94, 58)  # colour of the ground beyond the field
_PIXELS_PER_M: Final = 16.0  # of the picture of the ground, fewer where it is large
_MOST_PIXELS: Final = 50_000_000  # pixels of the background, at most
_SHAPES: Final = (  # of the vehicle, lower ones first: geom, colour
    ("bed", (88, 138, 96)),
    ("gearbox", (60, 62, 66)),
    ("bonnet", (214, 52, 38)),
    ("roof", (214, 52, 38)),
)


class _Outline(NamedTuple):
    """Outline of a box of the vehicle seen from above."""

    body: int  # row of the logged poses
    corners: FloatArray  # (4, 3) [m] body frame
    colour: Rgb | None  # None for a wheel, coloured by its slip
    wheel: int  # index in `WHEELS`, -1 for other boxes


class PlanView:
    """Plan view of one run at any time: the whole path, north up.

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
        self._playback = playback
        self._ghosts = ghosts
        self._outlines = _outlines(playback)
        width, height = (_SUPERSAMPLING * side for side in size)
        low = playback.path.min(axis=0) - _MARGIN_M
        high = playback.path.max(axis=0) + _MARGIN_M
        free = np.array([width, (1.0 - _HEADLINE) * height])
        self._scale = scale = float((free / (high - low)).min())  # [pixels/m]
        west, north = 0.5 * (low + high) + np.array([-0.5, 0.5]) * free / scale
        north += _HEADLINE * height / scale
        self._corner = west, north  # of the picture [m]
        self._background = self._ground((width, height))
        self._draw_line(ImageDraw.Draw(self._background), playback.path, REFERENCE)

    def picture(self, camera: str, time_s: float) -> NDArray[np.uint8]:
        """Return the picture of a time, (height, width, 3)."""
        playback = self._playback
        image = self._background.copy()
        draw = ImageDraw.Draw(image)
        colours = (POINTS["tractor"], POINTS["trailer"])
        for points, colour in zip(playback.driven(time_s, _TRAIL_STEP_M), colours, strict=True):
            self._draw_line(draw, points, colour)
        for points in playback.predicted_paths(time_s):
            self._draw_line(draw, points, PLAN)
        for ghost in self._ghosts:
            for _, pixels in self._polygons(ghost.poses(time_s)):
                draw.polygon(pixels, outline=ghost.colour, width=_SUPERSAMPLING)
        slips = playback.slips(time_s)
        for part, pixels in self._polygons(playback.poses(time_s)):
            colour = part.colour or slip_colour(float(slips[part.wheel]))
            draw.polygon(pixels, fill=colour, outline=(20, 20, 20))
        due = self._pixels(playback.positions(REFERENCE_ROWS, time_s))
        for centre, colour in zip(due, colours, strict=True):
            draw.circle(centre, 2.0 * _LINE_M * self._scale, fill=colour, outline=REFERENCE)
        return np.asarray(image.reduce(_SUPERSAMPLING))

    def _pixels(self, points: FloatArray) -> list[tuple[float, float]]:
        """Return the pixel coordinates of points (n, 2) [m]."""
        return list(map(tuple, (self._scale * (points - self._corner) * [1.0, -1.0]).tolist()))

    def _draw_line(self, draw: ImageDraw.ImageDraw, points: FloatArray, colour: Rgb) -> None:
        width = max(round(_LINE_M * self._scale), _SUPERSAMPLING)
        draw.line(self._pixels(points), fill=colour, width=width, joint="curve")

    def _polygons(self, poses: Poses) -> Iterator[tuple[_Outline, list[tuple[float, float]]]]:
        """Yield the outlines of a vehicle with bodies at these poses, and their pixels."""
        for part in self._outlines:
            xyz = poses[0][part.body]
            attitude = poses[1][part.body]
            if part.wheel >= 0:
                attitude = _without_roll(attitude)
            corners = rotation(attitude).apply(part.corners) + xyz
            yield part, self._pixels(corners[:, :2])

    def _ground(self, size: tuple[int, int]) -> Image.Image:
        """Return the picture of the ground in the colours of its soil."""
        ground = self._playback.ground
        terrain = ground.terrain
        fine = min(_PIXELS_PER_M, math.sqrt(_MOST_PIXELS / math.prod(terrain.size_m)))
        columns, rows = (math.ceil(fine * side) for side in terrain.size_m)
        colours = ground_colours(terrain, ground.cone_index, rows, columns)
        image = Image.fromarray((255.0 * colours[::-1]).astype(np.uint8))
        left = self._corner[0] - terrain.origin[0]
        top = terrain.origin[1] + terrain.size_m[1] - self._corner[1]
        corners = (left, top, left + size[0] / self._scale, top + size[1] / self._scale)
        box = tuple(fine * side for side in corners)
        extent = Image.Transform.EXTENT
        bilinear = Image.Resampling.BILINEAR
        return image.transform(size, extent, box, bilinear, fillcolor=_BEYOND)


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
