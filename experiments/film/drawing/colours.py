"""Colours of films as numbers; those of points and paths are `experiments.colours`."""

from __future__ import annotations

from typing import Final

import numpy as np
from PIL import ImageColor

from ... import colours

Rgb = tuple[int, int, int]


def rgb(colour: str) -> Rgb:
    """Return the red, green and blue of a colour "#RRGGBB", 0 to 255."""
    return ImageColor.getrgb(colour)[:3]


TRACTOR: Final = rgb(colours.BODY_COLOURS["tractor"])
TRAILER: Final = rgb(colours.BODY_COLOURS["trailer"])
REFERENCE: Final = rgb(colours.REFERENCE)
PLAN: Final = rgb(colours.PREDICTED)
INK: Final[Rgb] = (242, 244, 246)
FAINT: Final[Rgb] = (160, 170, 180)
ALARM: Final[Rgb] = (255, 140, 60)

FULL_SLIP: Final = 0.30  # at which a wheel is red; traction peaks well below
_SLIP_STOPS: Final = (0.0, 0.4 * FULL_SLIP, FULL_SLIP)
_SLIP_COLOURS: Final = np.array([[26.0, 26.0, 28.0], [235.0, 170.0, 30.0], [225.0, 30.0, 20.0]])


def slip_colour(slip: float) -> Rgb:
    """Return the colour of a wheel: black without slip, then amber, then red."""
    red, green, blue = (int(np.interp(slip, _SLIP_STOPS, part)) for part in _SLIP_COLOURS.T)
    return red, green, blue


def unit_rgb(colour: Rgb) -> tuple[float, float, float]:
    """Return a colour in fractions of 1, as in OpenGL."""
    red, green, blue = colour
    return red / 255.0, green / 255.0, blue / 255.0


_BRIGHTENING: Final = 0.35


def brighter(colour: Rgb) -> Rgb:
    """Return the colour as lines on dark boxes and on the ground have it, the same on both."""
    red, green, blue = (round(part + _BRIGHTENING * (255 - part)) for part in colour)
    return red, green, blue
