"""Colours of films, distinguishable with every kind of colour vision (see `figures.style`)."""

from __future__ import annotations

from typing import Final

import numpy as np
from PIL import ImageColor

from ..figures.style import BODY_COLOURS

Rgb = tuple[int, int, int]

TRACTOR: Final[Rgb] = ImageColor.getrgb(BODY_COLOURS["tractor"])[:3]
TRAILER: Final[Rgb] = ImageColor.getrgb(BODY_COLOURS["trailer"])[:3]
REFERENCE: Final[Rgb] = (244, 244, 238)
PLAN: Final[Rgb] = (240, 228, 66)
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
