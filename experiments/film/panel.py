"""A plate with text and bars that lies over a picture; everything scales with its unit."""

from __future__ import annotations

from functools import cache
from typing import Final, Literal

import matplotlib
from PIL import Image, ImageDraw, ImageFont

from .colours import FAINT, INK, Rgb

_PLATE: Final = (16, 20, 24, 176)  # see-through
_ROUND: Final = 7  # radius of a corner
Side = Literal["left", "right", "middle"]
_ANCHORS: Final[dict[Side, str]] = {"left": "lm", "right": "rm", "middle": "mm"}


@cache
def font(points: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return matplotlib's own sans serif, which is wherever matplotlib is."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/{name}", points)


class Panel:
    """A plate; lengths are given for a frame 720 pixels high and multiplied by `scale`."""

    def __init__(self, width: float, height: float, scale: float) -> None:
        self.scale = scale
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        self.image = Image.new("RGBA", size)
        self._draw = ImageDraw.Draw(self.image)
        box = (0, 0, size[0] - 1, size[1] - 1)
        self._draw.rounded_rectangle(box, round(_ROUND * scale), fill=_PLATE)

    def text(
        self,
        x: float,
        y: float,
        words: str,
        *,
        points: float = 14.0,
        colour: Rgb = INK,
        bold: bool = False,
        side: Side = "left",
    ) -> None:
        """Write words whose middle line lies at y."""
        shape = font(max(6, round(points * self.scale)), bold)
        place = (x * self.scale, y * self.scale)
        self._draw.text(place, words, font=shape, fill=colour, anchor=_ANCHORS[side])

    def rectangle(self, x0: float, y0: float, x1: float, y1: float, colour: Rgb) -> None:
        """Fill a rectangle, whichever way round its corners are."""
        left, right = sorted((x0 * self.scale, x1 * self.scale))
        self._draw.rectangle((left, y0 * self.scale, right, y1 * self.scale), fill=colour)

    def bar(
        self, box: tuple[float, float, float, float], fraction: float, colour: Rgb, zero: float = 0
    ) -> None:
        """Draw a bar from `zero` to `fraction`, both fractions of the box, cut at its ends."""
        x0, y0, x1, y1 = box
        self.rectangle(x0, y0, x1, y1, (52, 58, 64))
        start, end = (x0 + (x1 - x0) * min(max(part, 0.0), 1.0) for part in (zero, fraction))
        self.rectangle(start, y0, end, y1, colour)
        if zero:
            self.rectangle(start - 0.5, y0 - 2, start + 0.5, y1 + 2, FAINT)

    def onto(self, picture: Image.Image, x: float, y: float) -> None:
        """Lay the plate on a picture with its upper left corner at (x, y) [pixels]."""
        picture.paste(self.image, (round(x), round(y)), self.image)
