"""Colours, text and translucent boxes of pictures and films."""

from functools import cache
from typing import Final, Literal

import matplotlib
import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont

from .. import colours

Rgb = tuple[int, int, int]
_BRIGHTENING: Final = 0.35


def rgb(colour: str) -> Rgb:
    """Return the red, green and blue of a colour "#RRGGBB", 0 to 255."""
    return ImageColor.getrgb(colour)[:3]


def _brighter(colour: str) -> Rgb:
    """Return the colour as lines on dark boxes and on the ground have it, the same on both."""
    red, green, blue = (round(part + _BRIGHTENING * (255 - part)) for part in rgb(colour))
    return red, green, blue


POINTS: Final = {point: _brighter(each) for point, each in colours.BODY_COLOURS.items()}
REFERENCE: Final = rgb(colours.REFERENCE)
PLAN: Final = rgb(colours.PREDICTED)
GHOSTS: Final = tuple(
    map(rgb, (colours.PURPLE, colours.ORANGE, colours.GREEN, colours.SKY, colours.GREY))
)
"""Colours of ghosts: of the reference, then of other runs."""
INK: Final[Rgb] = (242, 244, 246)
FAINT: Final[Rgb] = (160, 170, 180)
ALARM: Final[Rgb] = (255, 140, 60)
DARK: Final[Rgb] = (16, 20, 24)

FULL_SLIP: Final = 0.30  # at which a wheel is red; traction peaks well below
_SLIP_STOPS: Final = (0.0, 0.4 * FULL_SLIP, FULL_SLIP)
_SLIP_COLOURS: Final = np.array([[26.0, 26.0, 28.0], [235.0, 170.0, 30.0], [225.0, 30.0, 20.0]])


def slip_colour(slip: float) -> Rgb:
    """Return the colour of a wheel: black without slip, then amber, then red."""
    red, green, blue = (int(np.interp(slip, _SLIP_STOPS, part)) for part in _SLIP_COLOURS.T)
    return red, green, blue


_BACKGROUND: Final = (*DARK, 176)  # red, green, blue, opacity
_BAR_BACKGROUND: Final = (52, 58, 64)
_CORNER_RADIUS: Final = 7
Align = Literal["left", "right", "middle"]


@cache
def font(points: float, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return the sans-serif font that matplotlib ships."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/{name}", points)


def text_length(text: str, points: float, *, bold: bool = False) -> float:
    """Return the width of a text in units of an `OverlayBox`."""
    return float(font(points, bold).getlength(text))


class OverlayBox:
    """A box whose lengths are in pixels of a frame 720 pixels high, multiplied by `scale`."""

    def __init__(self, width: float, height: float, scale: float) -> None:
        self.scale = scale
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        self.image = Image.new("RGBA", size)
        self._draw = ImageDraw.Draw(self.image)
        box = (0, 0, size[0] - 1, size[1] - 1)
        self._draw.rounded_rectangle(box, round(_CORNER_RADIUS * scale), fill=_BACKGROUND)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        points: float = 14.0,
        colour: Rgb = INK,
        bold: bool = False,
        align: Align = "left",
    ) -> None:
        """Write a text that is vertically centred at y."""
        # Neither rounded nor bounded: a box as wide as `text_length` says has to hold its text.
        shape = font(points * self.scale, bold)
        position = (x * self.scale, y * self.scale)
        self._draw.text(position, text, font=shape, fill=colour, anchor=f"{align[0]}m")

    def rectangle(self, x0: float, y0: float, x1: float, y1: float, colour: Rgb) -> None:
        """Fill a rectangle; x0 and x1 may be in either order."""
        left, right = sorted((x0 * self.scale, x1 * self.scale))
        self._draw.rectangle((left, y0 * self.scale, right, y1 * self.scale), fill=colour)

    def bar(
        self, box: tuple[float, float, float, float], fraction: float, colour: Rgb, zero: float = 0
    ) -> None:
        """Draw a bar from `zero` to `fraction`, fractions of the box, clipped to the box."""
        x0, y0, x1, y1 = box
        self.rectangle(x0, y0, x1, y1, _BAR_BACKGROUND)
        start, end = (x0 + (x1 - x0) * min(max(part, 0.0), 1.0) for part in (zero, fraction))
        self.rectangle(start, y0, end, y1, colour)
        if zero:
            self.rectangle(start - 0.5, y0 - 2, start + 0.5, y1 + 2, FAINT)

    def paste_onto(self, picture: Image.Image, x: float, y: float) -> None:
        """Lay the box on a picture with its upper left corner at (x, y) [pixels]."""
        picture.paste(self.image, (round(x), round(y)), self.image)
