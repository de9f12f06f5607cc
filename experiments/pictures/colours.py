"""Colours of points and lines, the same in figures, films and viewers.

Those of Okabe and Ito (2008), "Color Universal Design", distinguishable with every kind of colour
vision.
"""

from typing import Final

BLACK: Final = "#000000"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
RED: Final = "#D55E00"
PURPLE: Final = "#CC79A7"
YELLOW: Final = "#F0E442"
GREY: Final = "#8A8A8A"
# Two more for comparisons, of Tol (2021), "Colour schemes", muted.
WINE: Final = "#882255"
OLIVE: Final = "#999933"

BODY_COLOURS: Final = {"tractor": BLUE, "trailer": RED, "tool": GREEN}
SERIES_COLOURS: Final = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY, WINE, OLIVE)
REFERENCE: Final = "#F4F4EE"  # the path, on ground and on the dark background of viewers
PREDICTED: Final = YELLOW
